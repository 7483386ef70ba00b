//! Growth, and low and high frequencies apart.

use super::group::group;
use super::{Gate, Growth, LidarCloud, SigmaLearning};

group! {
    /// Growth and pruning of the set of splats.
    pub struct Density("Density control") {
        /// Growth begins after this step
        #[arg(value_name = "N")]
        pub densify_from: u32 = 500,
        /// Growth ends before this step
        #[arg(value_name = "N")]
        pub densify_until: u32 = 15_000,
        /// Steps between density changes
        #[arg(value_name = "N")]
        pub densify_interval: u32 = 100,
        /// Which splats grow: threshold (all whose gradient reaches it are cloned or split) or sampled (a sample of these is split along
        /// their longest axis)
        #[arg(value_name = "RULE")]
        pub growth: Growth = Growth::Threshold,
        /// Mean screen-space gradient (normalised device coordinates) from which a splat is cloned or split
        #[arg(value_name = "G")]
        pub grad_threshold: f64 = 2e-4,
        /// The same for splats of low frequencies (mask value 0) in the low-frequency stage, where growth is sampled
        #[arg(value_name = "G")]
        pub low_grad_threshold: f64 = 2e-4,
        /// Probability that a splat at the threshold is split, where growth is sampled
        #[arg(value_name = "P")]
        pub sample_rate: f64 = 0.5,
        /// How much of that probability is in proportion to the splat's mask value, from 0 to 1
        #[arg(value_name = "SHARE")]
        pub sample_mask_share: f64 = 0.0,
        /// How much of it is in proportion to the share of views in which the splat is wrong, from 0 to 1
        #[arg(value_name = "SHARE")]
        pub sample_error_share: f64 = 0.0,
        /// Mean absolute difference to the photograph above which the render is wrong at a splat
        #[arg(value_name = "E")]
        pub sample_error: f64 = 0.05,
        /// What opacities are multiplied by at each density change, where growth is sampled
        #[arg(value_name = "SHARE")]
        pub keep_opacity: f64 = 1.0,
        /// Splats larger than this share of the scene's extent are split, smaller ones cloned
        #[arg(value_name = "SHARE")]
        pub percent_dense: f64 = 0.01,
        /// Splats less opaque than this are pruned
        #[arg(value_name = "O")]
        pub prune_opacity: f64 = 0.005,
        /// Drop splats whose weight (alpha times transmittance) is below this in every pixel of every photograph that is trained on, when
        /// growth has ended (--prune-young) and after four fifths of the steps (0: keep them)
        #[arg(value_name = "W")]
        pub prune_weight: f64 = 0.0,
        /// Drop no splats below --prune-weight before this step: until opacities have been learned, weights say little
        #[arg(value_name = "STEP")]
        pub prune_weight_from: u32 = 500,
        /// When growth has ended, take this share of --prune-weight, as what is young weighs little yet (0: drop none then)
        #[arg(value_name = "SHARE")]
        pub prune_young: f64 = 1.0,
        /// Where --max-splats holds growth up, drop this share of the splats, those of the least weight, after some density changes, which
        /// makes room for others (0: none)
        #[arg(value_name = "SHARE")]
        pub recycle_share: f64 = 0.0,
        /// Splats larger than this share of the scene's extent are pruned once opacities have been reset (0: keep them)
        #[arg(value_name = "SHARE")]
        pub prune_extent: f64 = 0.1,
        /// When growth has ended, drop splats that are larger than this share of their distance from the cameras' mean, or of the scene's extent
        /// within it: 0.2 takes away what stands in the air over a flight (not before --prune-weight-from; 0: keep them)
        #[arg(value_name = "SHARE")]
        pub prune_distance: f64 = 0.0,
        /// Where depths of less than this share of the pixels are known before the first step, growth ends at --grow-on-until and is from
        /// --grow-on-threshold (0: as everywhere)
        #[arg(value_name = "SHARE")]
        pub grow_on: f64 = 0.0,
        /// Last step of growth there
        #[arg(value_name = "STEP")]
        pub grow_on_until: u32 = 15_000,
        /// Mean gradient from which splats grow there
        #[arg(value_name = "G")]
        pub grow_on_threshold: f64 = 6e-4,
        /// Steps between opacity resets (0: none)
        #[arg(value_name = "N")]
        pub opacity_reset_interval: u32 = 3000,
        /// Splats farther than this share of the scene's extent from the cloud of --lidar do not grow
        #[arg(value_name = "SHARE")]
        pub lidar_distance: f64 = 0.02,
    }
    flags {
        /// Judge splits by sums of absolute gradients of pixels, which do not cancel; with sampled growth all of it
        pub absgrad,
        /// Prune splats that have blended into no pixel since the last density change, where growth is sampled and the steps since then are
        /// as many as there are photographs
        pub prune_unseen,
        /// Where growth is sampled, split splats along that of their axes along which the loss changes most, by the optimiser's mean
        /// gradient of their centres, in place of the longest
        pub split_along_gradient,
    }
    optional {
        /// The threshold for splits where it is not that for clones
        #[arg(value_name = "G")]
        pub split_grad_threshold: f64,
        /// Have at most this many splats, those to begin with included; only a model of --init stays whole
        #[arg(value_name = "N")]
        pub max_splats: u32,
        /// Splats grow only near this cloud: a laser scan in the dataset's coordinates (PLY, LAS or LAZ), or mvs for the surfaces that
        /// stereo finds
        #[arg(value_name = "FILE")]
        pub lidar: LidarCloud,
    }
}

group! {
    /// Low and high frequencies apart.
    pub struct Frequencies("Low and high frequencies") {
        /// Share of the steps that the low-frequency stage takes (0: there is none)
        #[arg(value_name = "SHARE")]
        pub low_stage: f64 = 0.0,
        /// What tells texture from the rest: spectral, phase, gradient, random or off (nothing does)
        #[arg(value_name = "GATE")]
        pub gate: Gate = Gate::Spectral,
        /// Width of the filter of the spectral gate, in bins of a spectrum of 256
        #[arg(value_name = "BINS")]
        pub sigma: f64 = 3.0,
        /// How that width is learned for each photograph: off, errors (a mask is to tell where the model fails) or composite (a mask is to be
        /// where the splats after the low-frequency stage are worth their price)
        #[arg(value_name = "HOW")]
        pub sigma_learning: SigmaLearning = SigmaLearning::Off,
        /// Steps between updates of what is learned
        #[arg(value_name = "N")]
        pub sigma_every: u32 = 15,
        /// Weight of texture in the loss of the low-frequency stage (1: that of the rest)
        #[arg(value_name = "W")]
        pub low_texture_weight: f64 = 1.0,
        /// Share of the steps that see photographs of half the size or less
        #[arg(value_name = "SHARE")]
        pub coarse_steps: f64 = 0.0,
        /// Share of those that see a quarter of the size, the first ones
        #[arg(value_name = "SHARE")]
        pub coarse_quarter: f64 = 0.25,
    }
    flags {
        /// Make the coarse steps as many as reduced photographs keep of the spectra: --coarse-steps times the share that half the size
        /// keeps, and among them as many with a quarter of the size as that keeps
        pub coarse_spectrum,
    }
    optional {}
}
