//! Settings of growth and pruning, and of low and high frequencies.

use super::group::group;
use super::{Gate, Growth, Housekeeping, LidarCloud, Range, SigmaLearning};

group! {
    /// Growth and pruning of the set of splats.
    pub struct Density("Growth")
    options {
        /// Begin growth after this step
        #[arg(value_name = "STEP")]
        pub densify_from: u32 = 500,
        /// End growth before this step; later makes more splats and finer texture
        #[arg(value_name = "STEP")]
        pub densify_until: u32 = 15_000,
        /// Grow and prune every N steps; fewer steps between make more splats
        #[arg(value_name = "N")]
        pub densify_interval: u32 = 100; Range::COUNT,
        /// Grow splats whose mean gradient on the screen (normalised device coordinates) is at least G; a higher G
        /// makes fewer splats
        #[arg(value_name = "G")]
        pub grad_threshold: f64 = 2e-4; Range::THRESHOLD,
        /// Keep splats few as published (opacity resets, pruning by opacity and size) or lean (pruning by weight,
        /// no resets, fading with sampled growth, steps of visible splats alone); lean makes fewer splats and takes
        /// less time
        #[arg(value_name = "KIND")]
        pub housekeeping: Housekeeping = Housekeeping::Published,
        /// Prune splats with an opacity below this, from 0 to 1; higher keeps fewer splats
        #[arg(value_name = "OPACITY")]
        pub prune_opacity: f64 = 0.005; Range::BELOW_1,
        /// Prune splats whose weight (alpha times transmittance) is below W in every pixel of every training
        /// photograph, when growth has ended and after four fifths of the steps; higher keeps fewer splats (0: prune
        /// none)
        #[arg(value_name = "W")]
        pub prune_weight: f64 = 0.0; Range::BELOW_1,
        /// Reset opacities every N steps, which removes floaters and costs steps (0: never)
        #[arg(value_name = "N")]
        pub opacity_reset_interval: u32 = 3000,
    }
    flags {
        /// Keep the set of splats as it begins: no growth, no pruning, no opacity resets
        pub no_densify,
    }
    optional {
        /// Limit the number of splats, those at the start included; more splats show finer texture and need more memory
        /// and time
        #[arg(value_name = "N", help_heading = super::MOST_USED, display_order = 8)]
        pub max_splats: u32; Range::COUNT,
        /// Grow splats only near the points of this cloud: a laser scan in the dataset's coordinates (PLY, LAS or LAZ),
        /// or `mvs` for the surfaces that stereo finds
        #[arg(value_name = "FILE", help_heading = "Model")]
        pub lidar: LidarCloud,
    }
    constants {
        /// Rule of growth. `threshold`: all splats whose gradient reaches grad-threshold are cloned or split.
        /// `sampled`: a sample of these splats is split along their longest axis. `relocated`: splats of prune-opacity or
        /// less go to the places of others, drawn by opacity, and relocate-growth more are added there up to max-splats
        pub growth: Growth = Growth::Threshold,
        /// As grad-threshold, for splats of low frequencies (mask value 0) in the low-frequency stage, with sampled
        /// growth
        pub low_grad_threshold: f64 = 2e-4; Range::THRESHOLD,
        /// Probability that a splat at the threshold is split, with sampled growth
        pub sample_rate: f64 = 0.5; Range::SHARE,
        /// Share of sample-rate that is in proportion to the splat's mask value
        pub sample_mask_share: f64 = 0.0; Range::SHARE,
        /// Share of sample-rate that is in proportion to the share of photographs in which the splat's render is wrong
        pub sample_error_share: f64 = 0.0; Range::SHARE,
        /// Mean absolute difference from the photograph, in colours from 0 to 1, above which the render is wrong at a
        /// splat
        pub sample_error: f64 = 0.05; Range::WEIGHT,
        /// Factor of all opacities at each density change, with sampled growth
        pub keep_opacity: f64 = 1.0; Range::SHARE_ABOVE_0,
        /// Share by which the number of splats grows every densify-interval steps, with relocated growth
        pub relocate_growth: f64 = 0.05; Range::SHARE,
        /// Factor of the noise on the means of faint splats, in learning rates of the means and covariances of the
        /// splats (0: no noise)
        pub noise_means: f64 = 0.0; Range::WEIGHT,
        /// Share of the scene's extent from which a splat is split; a smaller splat is cloned
        pub percent_dense: f64 = 0.01; Range::THRESHOLD,
        /// First step at which prune-weight may drop splats
        pub prune_weight_from: u32 = 500,
        /// Share of prune-weight that counts when growth has just ended (0: drop none then)
        pub prune_young: f64 = 1.0; Range::SHARE,
        /// Share of the splats, those of the least weight, that is dropped after some density changes where max-splats
        /// stops growth (0: none)
        pub recycle_share: f64 = 0.0; Range::BELOW_1,
        /// Share of the scene's extent above which splats are pruned once opacities have been reset (0: keep splats of
        /// any size)
        pub prune_extent: f64 = 0.1; Range::new("a positive number, or 0 to keep splats of any size", |v| v >= 0.0),
        /// Most splats where max-splats is not set, as a multiple of the first ones; one for every 512 pixels of the
        /// photographs is allowed in any case (0: no limit)
        pub growth_room: f64 = 0.0; Range::WEIGHT,
        /// Share of the scene's extent from the cloud of lidar beyond which splats do not grow
        pub lidar_distance: f64 = 0.02; Range::THRESHOLD,
        /// Whether splits are judged by sums of absolute gradients of pixels, which do not cancel; with sampled growth
        /// all growth is
        pub absgrad: bool = false,
        /// Whether splats are pruned that were blended into no pixel since the last density change, with sampled growth
        pub prune_unseen: bool = false,
        /// Splats are split once, early, along the axes along which they are more than this many times as wide (two
        /// standard deviations) as the local spacing, by wavelength, stereo-error-low and stereo-error-high (0: none)
        pub split_wavelength: f64 = 0.0; Range::WEIGHT,
        /// Share of the steps after which they are, with the next density change
        pub split_wavelength_at: f64 = 0.1; Range::SHARE,
        /// Whether splats are split along the axis along which the loss changes most, in place of the longest, with
        /// sampled growth
        pub split_along_gradient: bool = false,
    }
    unset {
        /// Threshold for splits where it differs from the threshold for clones
        pub split_grad_threshold: f64; Range::THRESHOLD,
    }
}

group! {
    /// Settings of low and high frequencies.
    pub struct Frequencies("Model")
    options {
        /// Tell texture from the rest by a mask of each photograph: spectral, phase, gradient, random or off (no mask)
        #[arg(value_name = "MASK")]
        pub gate: Gate = Gate::Spectral,
    }
    flags {}
    optional {}
    constants {
        /// Share of the steps that the low-frequency stage takes (0: there is none)
        pub low_stage: f64 = 0.0; Range::SHARE,
        /// Width of the filter of the spectral mask, in bins of a spectrum of 256
        pub sigma: f64 = 3.0; Range::new("a number from 0 to 1000", |v| (0.0..=1000.0).contains(&v)),
        /// How sigma is learned for each photograph. `errors`: the mask is to tell where the model fails. `composite`:
        /// the mask is to be where the splats after the low-frequency stage are worth their price. `off`: sigma stays
        /// as it is
        pub sigma_learning: SigmaLearning = SigmaLearning::Off,
        /// Steps between updates of sigma
        pub sigma_every: u32 = 15; Range::COUNT,
        /// Weight of texture in the loss of the low-frequency stage, against 1 of the rest
        pub low_texture_weight: f64 = 1.0; Range::SHARE,
        /// Share of the steps that see photographs of half the size or less
        pub coarse_steps: f64 = 0.0; Range::SHARE,
        /// Share of the coarse steps, the first ones, that see a quarter of the size
        pub coarse_quarter: f64 = 0.25; Range::SHARE,
    }
    unset {}
}
