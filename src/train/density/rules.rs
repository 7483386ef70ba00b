//! The rules by which splats are cloned, split and pruned.

use crate::pass::{densify_classify, densify_sample};

/// The rules of a density change; lengths in scene units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DensityRules {
    /// Mean gradient norm in normalised device coordinates from which a small splat is cloned.
    pub clone_threshold: f32,
    /// Mean gradient norm from which a large splat is split.
    pub split_threshold: f32,
    /// Whether splits are judged by sums of absolute per-pixel gradients (AbsGS) instead of signed ones (3DGS).
    pub split_absolute: bool,
    /// Largest standard deviation of a small splat; `percent_dense` times the extent in 3DGS.
    pub split_scale: f64,
    /// Opacity below which a splat is pruned.
    pub prune_opacity: f64,
    /// Standard deviation above which a splat is pruned.
    pub prune_scale: Option<f64>,
    /// Most splats after growth.
    pub max_splats: Option<u32>,
    /// Growth by sampling, in place of the thresholds above.
    pub sampled: Option<SampledGrowth>,
    /// Factor of every opacity at a density change.
    pub keep_opacity: f32,
    /// The run's seed.
    pub seed: u32,
}

/// Growth by sampling (see [`densify_sample`]). Splits place their children along an axis of the parent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampledGrowth {
    /// Mean gradient norm in normalised device coordinates from which a splat with mask value 0 may be split.
    pub low_threshold: f32,
    /// Mean gradient norm from which a splat with mask value 1 may be split.
    pub high_threshold: f32,
    /// Whether splats are judged by sums of absolute per-pixel gradients instead of signed ones.
    pub absolute: bool,
    /// Probability of a split at the threshold.
    pub rate: f32,
    /// Share of the probability that is proportional to the mask value.
    pub mask_share: f32,
    /// Share of the probability that is proportional to the share of views in which the splat is wrong.
    pub error_share: f32,
    /// Whether splats that blended into no pixel since the last change are pruned.
    pub prune_unseen: bool,
    /// Whether children are placed along the axis of the parent along which the loss changes most, instead of the
    /// longest.
    pub along_gradient: bool,
}

/// Logit of an opacity as f32. The opacity is clamped to the numbers next to 0 and 1, so the logit is finite.
pub fn logit(opacity: f64) -> f32 {
    let opacity = opacity.clamp(f64::MIN_POSITIVE, 1.0 - f64::EPSILON);
    (opacity / (1.0 - opacity)).ln() as f32
}

impl DensityRules {
    /// The values of the reference implementation (Kerbl et al. 2023, current code) for a scene of the given extent.
    pub fn reference(extent: f64, seed: u32) -> Self {
        Self {
            clone_threshold: 2e-4,
            split_threshold: 2e-4,
            split_absolute: false,
            split_scale: 0.01 * extent,
            prune_opacity: 0.005,
            prune_scale: None,
            max_splats: None,
            sampled: None,
            keep_opacity: 1.0,
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

    /// The rules of sampled growth as the shader compares them.
    pub fn sample_push(&self, sampled: &SampledGrowth, stride: u32, event: u32) -> densify_sample::Push {
        densify_sample::Push {
            stride,
            low_threshold: sampled.low_threshold,
            high_threshold: sampled.high_threshold,
            absolute: u32::from(sampled.absolute),
            rate: sampled.rate,
            mask_share: sampled.mask_share,
            error_share: sampled.error_share,
            prune_opacity: logit(self.prune_opacity),
            prune_scale: self.prune_scale.map_or(f32::MAX, |s| s.ln() as f32),
            prune_large: u32::from(self.prune_scale.is_some()),
            prune_unseen: u32::from(sampled.prune_unseen),
            seed: self.seed,
            event,
        }
    }
}
