//! Splats that add next to nothing to any photograph are dropped.

use super::Engine;
use crate::pass::counters;
use crate::raster::OPACITIES;
use crate::train::Error;
use crate::train::density::DensityRules;
use crate::vk::Memory;

/// Below the logit of every opacity that is kept, and finite: what is not counts as a bad splat.
const DOOMED_LOGIT: f32 = -1e30;
/// Between the two.
const PRUNE_OPACITY: f64 = 1e-30;

impl Engine {
    /// Drops the splats whose largest weight (alpha times transmittance) in any pixel of any training photograph is below `least`, moments
    /// and all; gives how many (after RadSplat, Niemeyer et al. 2024). Statistics of growth begin anew. To be called when everything
    /// submitted is done. Waits.
    pub fn prune_faint(&mut self, least: f64, sh_degree: u32) -> Result<u32, Error> {
        let splats = self.splats()?;
        if splats == 0 {
            return Ok(0);
        }
        let weights = self.gpu.buffer("weights", 4 * u64::from(splats), Memory::Device)?;
        let mut recorder = self.gpu.recorder("no weights")?;
        recorder.fill(&weights, 0)?;
        recorder.submit()?;
        for camera in self.cameras.clone() {
            let shot = self.view_shot(&camera, sh_degree, [0.0; 3]);
            self.viewer.weigh(&self.model, splats, &shot, &weights)?;
        }
        let weights: Vec<f32> = self.gpu.read_at(&weights, 0, splats as usize)?;
        let opacities = &self.model.buffers()[OPACITIES];
        let mut logits: Vec<f32> = self.gpu.read_at(opacities, 0, splats as usize)?;
        for (logit, weight) in logits.iter_mut().zip(&weights) {
            if f64::from(*weight) < least {
                *logit = DOOMED_LOGIT;
            }
        }
        self.gpu.write(opacities, &logits)?;
        let rules = DensityRules {
            clone_threshold: f32::INFINITY,
            split_threshold: f32::INFINITY,
            prune_opacity: PRUNE_OPACITY,
            ..DensityRules::reference(self.extent, 0)
        };
        let mut recorder = self.gpu.recorder("prune")?;
        self.density.record(&mut recorder, &self.density_model(), &rules, 0)?;
        self.gpu.wait(recorder.submit()?)?;
        let words: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        Ok(splats.saturating_sub(words[counters::SPLATS]))
    }
}
