//! Checks that the values of settings fit one another.

use super::{
    Background, DepthPrior, Gate, Growth, LidarCloud, Method, Run, Settings, SettingsError, SigmaLearning, Spacing,
    Start, Transparent,
};
use crate::saliency::LearnSettings;

impl Settings {
    /// Whether any setting needs texture masks.
    pub fn needs_masks(&self) -> bool {
        let (density, frequencies) = (&self.density, &self.frequencies);
        let by_stage = frequencies.low_texture_weight != 1.0
            || (density.growth == Growth::Sampled && density.low_grad_threshold != density.grad_threshold);
        self.texture.lambda_perceptual > 0.0
            || self.texture.wants_gradients()
            || self.geometry.depth_prior != DepthPrior::None
            || (frequencies.low_stage > 0.0 && by_stage)
            || (density.growth == Growth::Sampled && density.sample_mask_share > 0.0)
            || (density.split_wavelength > 0.0 && !density.no_densify)
            || (self.geometry.begins_on_surfaces() && self.geometry.stereo_spacing == Spacing::Frequency)
    }

    /// Whether stereo runs before the first step.
    pub fn needs_stereo(&self) -> bool {
        self.geometry.depth_prior == DepthPrior::Stereo
            || self.geometry.begins_on_surfaces()
            || self.density.lidar == Some(LidarCloud::Mvs)
    }

    /// Whether the constrained set is rendered beside the full one.
    pub fn wants_constrained(&self) -> bool {
        self.texture.lambda_constrained > 0.0
    }

    /// Checks that every value is in its range, and that the values fit one another.
    pub fn check(&self) -> Result<(), SettingsError> {
        self.run.in_range()?;
        self.photographs.in_range()?;
        self.model.in_range()?;
        self.optimiser.in_range()?;
        self.density.in_range()?;
        self.frequencies.in_range()?;
        self.geometry.in_range()?;
        self.texture.in_range()?;
        self.shortcuts.in_range()?;
        self.scoring.in_range()?;
        self.device.in_range()?;
        self.host.in_range()?;
        self.blending.in_range()?;
        self.stepping.in_range()?;
        for (holds, key, want) in self.together().into_iter().chain(self.of_stereo()).chain(self.of_masks()) {
            if !holds {
                return Err(SettingsError::Value { key: key.into(), want });
            }
        }
        Ok(())
    }

    /// Constraints between harmonics, background and losses.
    fn together(&self) -> [Constraint; 9] {
        let Self { run, model, texture, shortcuts, density, geometry, .. } = self;
        let schedule = if run.scale_schedule { Run::default().iterations } else { run.iterations };
        let growth_ends = density.no_densify || density.densify_until < schedule;
        let one_colour = self.photographs.transparent == Transparent::LeftOut || model.background != Background::Random;
        let plain = model.sh_share >= 1.0 && shortcuts.moment_bits == 32;
        let wants_cloud = run.method == Method::Rsgs || geometry.depth_prior == DepthPrior::Lidar;
        let kept_to_cloud =
            density.lidar.is_some() && (run.method == Method::Rsgs || geometry.depth_prior != DepthPrior::Lidar);
        [
            (
                one_colour,
                "transparent",
                "left-out where background is random: `background` needs one colour, black or white",
            ),
            (
                model.sh_share == 1.0 || growth_ends,
                "sh-share",
                "1 where growth does not end before the last step: a smaller densify-until, more iterations, or scale-schedule",
            ),
            (
                model.sh_share == 1.0 || geometry.depth_prior != DepthPrior::Propagation,
                "sh-share",
                "1 where depths are propagated",
            ),
            (
                model.sh_share == 1.0 || density.split_wavelength == 0.0,
                "split-wavelength",
                "0 where sh-share is below 1",
            ),
            (
                density.growth != Growth::Relocated || model.sh_share == 1.0,
                "growth",
                "threshold or sampled where sh-share is below 1",
            ),
            (
                density.growth != Growth::Relocated || !kept_to_cloud,
                "growth",
                "threshold or sampled where splats grow near a cloud (lidar)",
            ),
            (
                texture.lambda_constrained == 0.0 || self.frequencies.low_stage > 0.0,
                "lambda-constrained",
                "0 where low-stage is 0",
            ),
            (
                texture.views_at_once() == 1 || plain,
                "perceptual-views",
                "1 where sh-share is below 1 or moment-bits is 16",
            ),
            (
                density.lidar.is_some() || !wants_cloud,
                "lidar",
                "a laser scan (PLY, LAS or LAZ), or `mvs` for the cloud that stereo makes, where method is rsgs or depth-prior is lidar",
            ),
        ]
    }

    /// Constraints of the settings for stereo's splats.
    fn of_stereo(&self) -> [Constraint; 3] {
        let Self { geometry, frequencies, .. } = self;
        let start = geometry.start == Start::Stereo;
        [
            (
                geometry.stereo_texture >= 1.0 || frequencies.gate != Gate::Off,
                "stereo-texture",
                "1 where gate is off, as nothing is texture then",
            ),
            (geometry.stereo_splats == 0 || start, "stereo-splats", "0 unless start is stereo"),
            (geometry.stereo_skirt == 0.0 || start, "stereo-skirt", "0 unless start is stereo"),
        ]
    }

    /// Constraints of learned masks.
    fn of_masks(&self) -> [Constraint; 4] {
        let frequencies = &self.frequencies;
        let learned = frequencies.sigma_learning != SigmaLearning::Off;
        let LearnSettings { lowest, highest, .. } = LearnSettings::default();
        let inside = frequencies.sigma > lowest && frequencies.sigma < highest;
        [
            (!learned || inside, "sigma", "between 0.5 and 12 where it is learned"),
            (!learned || frequencies.gate == Gate::Spectral, "sigma-learning", "off unless gate is spectral"),
            (!learned || self.needs_masks(), "sigma-learning", "off where nothing looks at masks"),
            (
                frequencies.sigma_learning != SigmaLearning::Composite || frequencies.low_stage > 0.0,
                "sigma-learning",
                "other than composite where low-stage is 0",
            ),
        ]
    }
}

/// Whether the constraint holds, else the key that is wrong, and the values that the key takes.
type Constraint = (bool, &'static str, &'static str);
