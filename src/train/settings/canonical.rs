//! Ignores settings that have no effect.

use super::{DepthPrior, Growth, Housekeeping, LidarCloud, Settings, Spacing, Start};

impl Settings {
    /// These settings with defaults in place of values that have no effect: settings that are equal here train the same
    /// model. For example, the weight of a loss on depth becomes 0 without known depths, and the shares of sampling
    /// become 0 with growth by a threshold.
    pub fn in_use(&self) -> Self {
        let (mut s, plain) = (self.clone(), Self::default());
        // A name for values that are settings of their own.
        s.density.housekeeping = Housekeeping::default();
        if s.density.growth == Growth::Relocated {
            s.density.grad_threshold = plain.density.grad_threshold;
            s.density.split_grad_threshold = plain.density.split_grad_threshold;
            s.density.percent_dense = plain.density.percent_dense;
            s.density.absgrad = plain.density.absgrad;
            s.density.prune_unseen = plain.density.prune_unseen;
            s.density.prune_extent = plain.density.prune_extent;
            s.density.keep_opacity = plain.density.keep_opacity;
            s.density.recycle_share = plain.density.recycle_share;
        } else {
            s.density.relocate_growth = plain.density.relocate_growth;
        }
        if s.density.growth != Growth::Sampled {
            s.density.sample_rate = plain.density.sample_rate;
            s.density.sample_mask_share = plain.density.sample_mask_share;
            s.density.sample_error_share = plain.density.sample_error_share;
            s.density.sample_error = plain.density.sample_error;
            s.density.split_along_gradient = plain.density.split_along_gradient;
        }
        if s.density.growth != Growth::Sampled || s.frequencies.low_stage == 0.0 {
            s.density.low_grad_threshold = s.density.grad_threshold;
        }
        if s.density.prune_weight == 0.0 {
            s.density.prune_young = plain.density.prune_young;
            s.density.prune_weight_from = plain.density.prune_weight_from;
        }
        if s.density.max_splats.is_some() || s.density.no_densify {
            s.density.growth_room = plain.density.growth_room;
        }
        if s.density.split_wavelength == 0.0 || s.density.no_densify {
            s.density.split_wavelength = plain.density.split_wavelength;
            s.density.split_wavelength_at = plain.density.split_wavelength_at;
        }
        if s.frequencies.low_stage == 0.0 {
            s.frequencies.low_texture_weight = plain.frequencies.low_texture_weight;
        }
        if s.frequencies.coarse_steps == 0.0 {
            s.frequencies.coarse_quarter = plain.frequencies.coarse_quarter;
        }
        if !s.geometry.has_loss() {
            s.geometry.depth_steps = plain.geometry.depth_steps;
            s.geometry.depth_every = plain.geometry.depth_every;
            s.geometry.depth_left = plain.geometry.depth_left;
            s.geometry.depth_huber = plain.geometry.depth_huber;
            s.geometry.depth_edges = plain.geometry.depth_edges;
            s.geometry.lambda_smooth = plain.geometry.lambda_smooth;
            s.geometry.smooth_edge_stop = plain.geometry.smooth_edge_stop;
        }
        if s.geometry.depth_prior == DepthPrior::None {
            s.geometry.lambda_depth = plain.geometry.lambda_depth;
            s.geometry.lambda_normal = plain.geometry.lambda_normal;
        }
        if s.geometry.depth_prior != DepthPrior::Stereo
            && s.geometry.start != Start::Stereo
            && s.density.lidar != Some(LidarCloud::Mvs)
        {
            s.geometry.stereo_share = plain.geometry.stereo_share;
            s.geometry.stereo_texture = plain.geometry.stereo_texture;
        }
        if s.geometry.start != Start::Stereo || s.model.sh_share < 1.0 {
            s.geometry.stereo_skirt = plain.geometry.stereo_skirt;
        }
        if !s.geometry.begins_on_surfaces() {
            s.geometry.stereo_splats = plain.geometry.stereo_splats;
            s.geometry.stereo_spacing = plain.geometry.stereo_spacing;
            s.geometry.stereo_width = plain.geometry.stereo_width;
            s.geometry.stereo_axes = plain.geometry.stereo_axes;
            s.geometry.stereo_thickness = plain.geometry.stereo_thickness;
            s.geometry.stereo_opacity = plain.geometry.stereo_opacity;
            s.geometry.stereo_alone = plain.geometry.stereo_alone;
        }
        let spaced = s.geometry.stereo_spacing == Spacing::Frequency || s.density.split_wavelength > 0.0;
        if !spaced && s.geometry.stereo_splats > 0 {
            s.geometry.stereo_error_low = plain.geometry.stereo_error_low;
            s.geometry.stereo_error_high = plain.geometry.stereo_error_high;
        }
        if s.shortcuts.early_steps == 0.0 {
            s.shortcuts.early_cutoff = plain.shortcuts.early_cutoff;
        }
        if s.texture.lambda_constrained == 0.0 {
            s.texture.constrained_against = plain.texture.constrained_against;
        }
        if s.texture.lambda_perceptual == 0.0 {
            s.texture.perceptual_every = plain.texture.perceptual_every;
            s.texture.perceptual_views = plain.texture.perceptual_views;
        }
        if !s.needs_masks() && s.geometry.stereo_texture >= 1.0 {
            s.frequencies.gate = plain.frequencies.gate;
            s.frequencies.sigma = plain.frequencies.sigma;
            s.frequencies.sigma_learning = plain.frequencies.sigma_learning;
            s.frequencies.sigma_every = plain.frequencies.sigma_every;
        }
        s
    }
}
