//! Splats that add next to nothing to any photograph, or are too large for where they are, are dropped.

use super::Engine;
use crate::raster::{MEANS, OPACITIES, SCALES};
use crate::scene::Camera;
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

    /// Gives splats that are too large for where they are (`--prune-distance`) a weight below every other. To be called when everything
    /// submitted is done. Waits.
    pub fn take_weight_of_large(&self, weights: &mut [f32]) -> Result<(), Error> {
        if weights.is_empty() {
            return Ok(());
        }
        let share = self.settings.density.prune_distance;
        let planes = self.model.buffers();
        let means: Vec<f32> = self.gpu.read_at(&planes[MEANS], 0, 3 * weights.len())?;
        let scales: Vec<f32> = self.gpu.read_at(&planes[SCALES], 0, 3 * weights.len())?;
        let surroundings = Surroundings::of(&self.views.cameras, self.needs.extent);
        for ((weight, mean), scales) in weights.iter_mut().zip(means.chunks_exact(3)).zip(scales.chunks_exact(3)) {
            if surroundings.largest(share, mean) < largest(scales) {
                *weight = -1.0;
            }
        }
        Ok(())
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

/// Where the cameras are, as far as the size of splats is concerned.
struct Surroundings {
    /// Mean of the cameras' centres.
    center: [f64; 3],
    /// The cameras' extent.
    extent: f64,
}

impl Surroundings {
    fn of(cameras: &[Camera], extent: f64) -> Self {
        let count = cameras.len().max(1) as f64;
        let centers: Vec<[f64; 3]> = cameras.iter().map(Camera::center).collect();
        Self { center: std::array::from_fn(|k| centers.iter().map(|c| c[k]).sum::<f64>() / count), extent }
    }

    /// The largest standard deviation of a splat at `mean`: the share of its distance from the cameras' mean, or of their extent where it is
    /// not farther.
    fn largest(&self, share: f64, mean: &[f32]) -> f64 {
        let squares = mean.iter().zip(self.center).map(|(m, c)| (f64::from(*m) - c).powi(2));
        share * squares.sum::<f64>().sqrt().max(self.extent)
    }
}

/// The largest standard deviation of a splat with these logarithmic scales.
fn largest(scales: &[f32]) -> f64 {
    f64::from(scales.iter().copied().fold(f32::MIN, f32::max)).exp()
}

#[cfg(test)]
mod tests {
    use super::{Surroundings, largest};

    #[test]
    fn the_largest_splat_grows_with_distance_only_beyond_the_extent() {
        let surroundings = Surroundings { center: [1.0, 2.0, 3.0], extent: 5.0 };
        let at = |distance: f32| surroundings.largest(0.2, &[1.0, 2.0, 3.0 + distance]);
        assert_eq!([at(0.0), at(4.5), at(5.0), at(50.0)], [1.0, 1.0, 1.0, 10.0]);
    }

    #[test]
    fn a_splat_is_as_large_as_its_longest_axis() {
        assert_eq!(largest(&[-1.0, 0.0, -2.0]), 1.0);
        assert_eq!(largest(&[f32::NEG_INFINITY; 3]), 0.0);
    }
}
