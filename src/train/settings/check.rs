//! What settings ask for together, and whether it makes sense.

use super::{Background, DepthPrior, Gate, Growth, Method, Settings, SettingsError, SigmaLearning, Transparent};
use crate::raster::Approximation;
use crate::saliency::LearnSettings;

impl Settings {
    /// Whether pixels are told apart by masks.
    pub fn needs_masks(&self) -> bool {
        let (density, frequencies) = (&self.density, &self.frequencies);
        let by_stage = frequencies.low_texture_weight != 1.0
            || (density.growth == Growth::Sampled && density.low_grad_threshold != density.grad_threshold);
        self.texture.lambda_perceptual > 0.0
            || self.texture.wants_gradients()
            || self.geometry.depth_prior != DepthPrior::None
            || (frequencies.low_stage > 0.0 && by_stage)
            || (density.growth == Growth::Sampled && density.sample_mask_share > 0.0)
    }

    /// Whether the constrained set is rendered beside the full one.
    pub fn wants_constrained(&self) -> bool {
        self.texture.lambda_constrained > 0.0
    }

    /// Whether the values make sense together; the error names the option and what it takes.
    pub fn check(&self) -> Result<(), SettingsError> {
        let ok = |good: bool, key: &'static str, want: &'static str| {
            if good { Ok(()) } else { Err(SettingsError::Value { key, want }) }
        };
        let (run, density, optimiser) = (&self.run, &self.density, &self.optimiser);
        ok(run.iterations >= 1, "iterations", "at least 1")?;
        ok((1..=64).contains(&run.bands), "bands", "a number from 1 to 64")?;
        ok(self.photographs.max_side >= 16, "max-side", "at least 16 pixels")?;
        let white = self.photographs.white_level;
        ok(white.is_none_or(|v| v > 0.0 && v.is_finite()), "white-level", "a positive number")?;
        let one_colour =
            self.photographs.transparent == Transparent::LeftOut || self.model.background != Background::Random;
        ok(
            one_colour,
            "transparent",
            "left-out with --background random: `background` needs one colour, black or white",
        )?;
        ok(self.model.sh_degree <= 3, "sh-degree", "0, 1, 2 or 3")?;
        ok(self.model.sh_interval >= 1, "sh-interval", "at least 1")?;
        ok((0.0..=1.0).contains(&self.model.sh_share), "sh-share", "a number from 0 to 1")?;
        let ends = run.no_densify || run.scale_schedule || self.density.densify_until < run.iterations;
        ok(
            self.model.sh_share == 1.0 || ends,
            "sh-share",
            "1 where growth does not end before the last step: a smaller --densify-until, more --iterations, or --scale-schedule",
        )?;
        let alone = self.geometry.depth_prior != DepthPrior::Propagation;
        ok(self.model.sh_share == 1.0 || alone, "sh-share", "1 where depths are propagated")?;
        ok((0.0..=1.0).contains(&optimiser.lambda_dssim), "lambda-dssim", "a number from 0 to 1")?;
        let shrinks = optimiser.lambda_sh >= 0.0 && optimiser.lambda_sh.is_finite();
        ok(shrinks, "lambda-sh", "a number that is not negative")?;
        ok(optimiser.lr_means > 0.0 && optimiser.lr_means.is_finite(), "lr-means", "a positive number")?;
        ok(
            optimiser.lr_means_final > 0.0 && optimiser.lr_means_final.is_finite(),
            "lr-means-final",
            "a positive number",
        )?;
        ok(optimiser.lr_means_steps >= 1, "lr-means-steps", "at least 1")?;
        for (rate, key) in [(optimiser.lr_exposure, "lr-exposure"), (optimiser.lr_exposure_final, "lr-exposure-final")]
        {
            ok(rate > 0.0 && rate.is_finite(), key, "a positive number")?;
        }
        for (rate, key) in [
            (optimiser.lr_sh_base, "lr-sh-base"),
            (optimiser.lr_sh_rest, "lr-sh-rest"),
            (optimiser.lr_opacities, "lr-opacities"),
            (optimiser.lr_scales, "lr-scales"),
            (optimiser.lr_rotations, "lr-rotations"),
        ] {
            ok(rate >= 0.0 && rate.is_finite(), key, "a number that is not negative")?;
        }
        for (exponent, key) in [
            (optimiser.lr_scaling, "lr-scaling"),
            (optimiser.lr_scaling_sh, "lr-scaling-sh"),
            (optimiser.lr_decay, "lr-decay"),
            (optimiser.beta2_scaling, "beta2-scaling"),
        ] {
            ok((0.0..=1.0).contains(&exponent), key, "a number from 0 to 1")?;
        }
        ok(matches!(self.shortcuts.moment_bits, 16 | 32), "moment-bits", "16 or 32")?;
        ok(self.shortcuts.sh_every >= 1, "sh-every", "at least 1")?;
        let rate = self.shortcuts.sh_rate;
        ok(rate >= 0.0 && rate.is_finite(), "sh-rate", "a number that is not negative")?;
        let Approximation { alpha_cutoff, transmittance_cutoff, .. } = self.shortcuts.approximation();
        ok(Approximation::ALPHA_CUTOFFS.contains(&alpha_cutoff), "alpha-cutoff", "a whole number from 2 to 65535")?;
        let super::Shortcuts { early_steps, early_cutoff, .. } = self.shortcuts;
        ok((0.0..=1.0).contains(&early_steps), "early-steps", "a number from 0 to 1")?;
        ok(Approximation::ALPHA_CUTOFFS.contains(&early_cutoff), "early-cutoff", "a whole number from 2 to 65535")?;
        ok(
            Approximation::TRANSMITTANCE_CUTOFFS.contains(&transmittance_cutoff),
            "transmittance-cutoff",
            "a whole number from 2 to 1000000",
        )?;
        ok(density.densify_interval >= 1, "densify-interval", "at least 1")?;
        for (share, key) in [
            (density.sample_rate, "sample-rate"),
            (density.sample_mask_share, "sample-mask-share"),
            (density.sample_error_share, "sample-error-share"),
            (self.frequencies.low_stage, "low-stage"),
            (self.frequencies.low_texture_weight, "low-texture-weight"),
            (self.frequencies.coarse_steps, "coarse-steps"),
            (self.frequencies.coarse_quarter, "coarse-quarter"),
            (self.geometry.depth_steps, "depth-steps"),
        ] {
            ok((0.0..=1.0).contains(&share), key, "a number from 0 to 1")?;
        }
        ok(density.keep_opacity > 0.0 && density.keep_opacity <= 1.0, "keep-opacity", "a number above 0, at most 1")?;
        ok(
            density.sample_error >= 0.0 && density.sample_error.is_finite(),
            "sample-error",
            "a number that is not negative",
        )?;
        let (geometry, texture) = (&self.geometry, &self.texture);
        for (weight, key) in [
            (geometry.lambda_depth, "lambda-depth"),
            (geometry.depth_edges, "depth-edges"),
            (geometry.lambda_smooth, "lambda-smooth"),
            (geometry.smooth_edge_stop, "smooth-edge-stop"),
            (geometry.lambda_normal, "lambda-normal"),
            (geometry.lambda_flatten, "lambda-flatten"),
            (geometry.propagate_ratio, "propagate-ratio"),
            (geometry.propagate_ratio_final, "propagate-ratio-final"),
            (texture.lambda_gradients, "lambda-gradients"),
            (texture.lambda_variation, "lambda-variation"),
            (texture.lambda_constrained, "lambda-constrained"),
            (texture.lambda_perceptual, "lambda-perceptual"),
        ] {
            ok(weight >= 0.0 && weight.is_finite(), key, "a number that is not negative")?;
        }
        ok(geometry.depth_left > 0.0 && geometry.depth_left <= 1.0, "depth-left", "a number above 0, at most 1")?;
        ok(geometry.depth_huber > 0.0 && geometry.depth_huber.is_finite(), "depth-huber", "a positive number")?;
        let (width, thickness) = (geometry.stereo_width, geometry.stereo_thickness);
        ok(width > 0.0 && width.is_finite(), "stereo-width", "a positive number")?;
        ok(thickness > 0.0 && thickness <= 1.0, "stereo-thickness", "a number above 0, at most 1")?;
        let opacity = geometry.stereo_opacity;
        ok(opacity > 0.0 && opacity < 1.0, "stereo-opacity", "a number above 0, below 1")?;
        let skirt = geometry.stereo_skirt;
        ok((0.0..=1.0).contains(&skirt), "stereo-skirt", "a number from 0 to 1")?;
        ok(geometry.stereo_side >= 16, "stereo-side", "at least 16 pixels")?;
        let share = geometry.stereo_share;
        ok(share > 0.0 && share.is_finite(), "stereo-share", "a positive number")?;
        let from = geometry.stereo_texture;
        ok(from > 0.0 && from <= 1.0, "stereo-texture", "a number above 0, at most 1")?;
        let masked = from >= 1.0 || self.frequencies.gate != Gate::Off;
        ok(masked, "stereo-texture", "1 where --gate is off, as nothing is texture then")?;
        ok(geometry.depth_every >= 1, "depth-every", "at least 1")?;
        ok(geometry.propagate_every >= 1, "propagate-every", "at least 1")?;
        ok(texture.gradients_every >= 1, "gradients-every", "at least 1")?;
        let staged = texture.lambda_constrained == 0.0 || self.frequencies.low_stage > 0.0;
        ok(staged, "lambda-constrained", "0 where there is no --low-stage")?;
        ok(texture.perceptual_every >= 1, "perceptual-every", "at least 1")?;
        ok((1..=8).contains(&texture.perceptual_views), "perceptual-views", "from 1 to 8")?;
        let super::Shortcuts { sh_every, moment_bits, .. } = self.shortcuts;
        let plain = self.model.sh_share >= 1.0 && sh_every <= 1 && moment_bits == 32;
        let several = "1 where there is --sh-share, --sh-every or --moment-bits 16";
        ok(texture.views_at_once() == 1 || plain, "perceptual-views", several)?;
        for (splats, key) in [(geometry.stereo_splats, "stereo-splats"), (geometry.stereo_density, "stereo-density")] {
            ok(splats == 0 || geometry.depth_prior == DepthPrior::Stereo, key, "0 unless --depth-prior is stereo")?;
        }
        let by_surface = geometry.stereo_densest == 0 || geometry.stereo_density > 0;
        ok(by_surface, "stereo-densest", "0 where there is no --stereo-density")?;
        let densest = geometry.stereo_densest == 0 || geometry.stereo_densest >= geometry.stereo_density;
        ok(densest, "stereo-densest", "at least --stereo-density, or 0")?;
        let any = geometry.stereo_splats_for == 0 || geometry.begins_on_surfaces();
        ok(any, "stereo-splats-for", "0 where there is neither --stereo-splats nor --stereo-density")?;
        let wants_cloud = run.method == Method::Rsgs || geometry.depth_prior == DepthPrior::Lidar;
        ok(
            density.lidar.is_some() || !wants_cloud,
            "lidar",
            "a laser scan (--lidar CLOUD.ply, .las or .laz), or the cloud that stereo makes (--lidar mvs), where --method is rsgs or \
             --depth-prior is lidar",
        )?;
        let frequencies = &self.frequencies;
        if frequencies.sigma_learning != SigmaLearning::Off {
            let LearnSettings { lowest, highest, .. } = LearnSettings::default();
            let inside = frequencies.sigma > lowest && frequencies.sigma < highest;
            ok(inside, "sigma", "between 0.5 and 12 where it is learned")?;
            ok(frequencies.gate == Gate::Spectral, "sigma-learning", "off unless --gate is spectral")?;
            ok(frequencies.sigma_every >= 1, "sigma-every", "at least 1")?;
            ok(self.needs_masks(), "sigma-learning", "off where nothing looks at masks")?;
        }
        let staged = frequencies.sigma_learning != SigmaLearning::Composite || frequencies.low_stage > 0.0;
        ok(staged, "sigma-learning", "other than composite where there is no --low-stage")?;
        ok((0.0..=1000.0).contains(&self.frequencies.sigma), "sigma", "a number from 0 to 1000")?;
        for (share, key) in [
            (density.low_grad_threshold, "low-grad-threshold"),
            (density.split_grad_threshold.unwrap_or(1.0), "split-grad-threshold"),
            (density.grad_threshold, "grad-threshold"),
            (density.percent_dense, "percent-dense"),
            (density.lidar_distance, "lidar-distance"),
            (density.grow_on_threshold, "grow-on-threshold"),
        ] {
            ok(share > 0.0 && !share.is_nan(), key, "a positive number")?;
        }
        ok(density.prune_extent >= 0.0, "prune-extent", "a positive number, or 0 to keep splats of any size")?;
        ok(density.prune_distance >= 0.0, "prune-distance", "a positive number, or 0 to keep splats of any size")?;
        ok((0.0..1.0).contains(&density.prune_opacity), "prune-opacity", "a number from 0 to 1")?;
        ok((0.0..1.0).contains(&density.prune_weight), "prune-weight", "a number from 0 to 1")?;
        ok((0.0..=1.0).contains(&density.grow_on), "grow-on", "a number from 0 to 1")?;
        ok((0.0..=1.0).contains(&density.prune_young), "prune-young", "a number from 0 to 1")?;
        ok((0.0..1.0).contains(&density.recycle_share), "recycle-share", "a number from 0 to 1")?;
        ok(density.max_splats != Some(0), "max-splats", "at least 1")
    }
}
