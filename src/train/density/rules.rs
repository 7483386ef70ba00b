//! Which splats are cloned, split and pruned, as settings.

use crate::pass::densify_classify;

/// The rules of a density change, in scene units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DensityRules {
    /// Mean gradient norm (normalised device coordinates) from which a small splat is cloned.
    pub clone_threshold: f32,
    /// Mean gradient norm from which a large splat is split.
    pub split_threshold: f32,
    /// Splits are judged by sums of absolute per-pixel gradients (AbsGS) rather than signed ones (3DGS).
    pub split_absolute: bool,
    /// Largest standard deviation of a small splat: percent_dense times the extent.
    pub split_scale: f64,
    /// Opacity below which a splat is pruned.
    pub prune_opacity: f64,
    /// Standard deviation above which a splat is pruned.
    pub prune_scale: Option<f64>,
    /// Number of splats that growth does not pass.
    pub max_splats: Option<u32>,
    /// The run's seed.
    pub seed: u32,
}

/// Logit of an opacity, in the precision in which opacities are stored.
pub fn logit(opacity: f64) -> f32 {
    (opacity / (1.0 - opacity)).ln() as f32
}

impl DensityRules {
    /// The reference's values (Kerbl et al. 2023, current code) for a scene of the given extent.
    pub fn reference(extent: f64, seed: u32) -> Self {
        Self {
            clone_threshold: 2e-4,
            split_threshold: 2e-4,
            split_absolute: false,
            split_scale: 0.01 * extent,
            prune_opacity: 0.005,
            prune_scale: None,
            max_splats: None,
            seed,
        }
    }

    /// The rules as the shader compares them: logarithms of scales and logits of opacities.
    pub fn classify_push(&self, stride: u32) -> densify_classify::Push {
        densify_classify::Push {
            stride,
            clone_threshold: self.clone_threshold,
            split_threshold: self.split_threshold,
            split_absolute: u32::from(self.split_absolute),
            split_scale: self.split_scale.ln() as f32,
            prune_opacity: logit(self.prune_opacity),
            prune_scale: self.prune_scale.map_or(f32::MAX, |s| s.ln() as f32),
            prune_large: u32::from(self.prune_scale.is_some()),
        }
    }
}
