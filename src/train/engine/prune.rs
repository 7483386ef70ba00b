//! Splats that add next to nothing to any photograph are dropped.

use super::Engine;
use crate::raster::OPACITIES;
use crate::train::Error;
use crate::train::density::DensityRules;
use crate::vk::Memory;

/// Below the logit of every opacity that is kept, and finite: what is not counts as a bad splat.
const DOOMED_LOGIT: f32 = -1e30;
/// Between the two.
const PRUNE_OPACITY: f64 = 1e-30;

impl Engine {
    /// The largest weight (alpha times transmittance) of every splat in any pixel of any training photograph. To be called when
    /// everything submitted is done. Waits.
    pub fn weights(&mut self, sh_degree: u32) -> Result<Vec<f32>, Error> {
        let splats = self.splats()?;
        if splats == 0 {
            return Ok(Vec::new());
        }
        let weights = self.gpu.buffer("weights", 4 * u64::from(splats), Memory::Device)?;
        let mut recorder = self.gpu.recorder("no weights")?;
        recorder.fill(&weights, 0)?;
        recorder.submit()?;
        for camera in self.views.cameras.clone() {
            let shot = self.view_shot(&camera, sh_degree, [0.0; 3]);
            self.viewer.weigh(&self.model, splats, &shot, &weights)?;
        }
        Ok(self.gpu.read(&weights)?)
    }

    /// Drops the splats whose weight is below `least`, moments and all; gives how many (after RadSplat, Niemeyer et al. 2024).
    /// Statistics of growth begin anew. To be called when everything submitted is done. Waits.
    pub fn drop_below(&mut self, least: f64, weights: &[f32]) -> Result<u32, Error> {
        if weights.is_empty() {
            return Ok(0);
        }
        if self.has_plain_splats() {
            let kept: Vec<bool> = weights.iter().map(|weight| f64::from(*weight) >= least).collect();
            self.keep_rows(&kept)?;
            return Ok(kept.iter().filter(|kept| !**kept).count() as u32);
        }
        let opacities = &self.model.buffers()[OPACITIES];
        let mut logits: Vec<f32> = self.gpu.read_at(opacities, 0, weights.len())?;
        for (logit, weight) in logits.iter_mut().zip(weights) {
            if f64::from(*weight) < least {
                *logit = DOOMED_LOGIT;
            }
        }
        self.gpu.write(opacities, &logits)?;
        let rules = DensityRules {
            clone_threshold: f32::INFINITY,
            split_threshold: f32::INFINITY,
            prune_opacity: PRUNE_OPACITY,
            ..DensityRules::reference(self.needs.extent, 0)
        };
        let mut recorder = self.gpu.recorder("prune")?;
        self.density.record(&mut recorder, &self.density_model(), &rules, 0)?;
        self.gpu.wait(recorder.submit()?)?;
        Ok((weights.len() as u32).saturating_sub(self.splats()?))
    }
}
