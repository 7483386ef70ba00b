//! Methods: named sets of values for the settings. Apart from [`Method::black_learns`], training depends on the
//! settings only.

use std::fmt;
use std::str::FromStr;

use super::{DepthPrior, Exposure, Gate, Growth, Run, Settings, SigmaLearning};

/// A training method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Method {
    /// `3dgs`: the reference method of Kerbl et al. 2023 with its published schedule and quirks.
    Reference3dgs,
    /// `absgs`: 3dgs that splits by sums of absolute gradients (Ye et al. 2024).
    AbsGs,
    /// `gspro`: 3dgs that propagates depths and normals from its renders and adds splats where they differ much
    /// (GaussianPro, Cheng et al. 2024).
    GsPro,
    /// `rsgs`: 3dgs whose splats only grow near a LiDAR cloud, with the cloud's depths and planes in the loss (after Li
    /// et al. 2024).
    Rsgs,
    /// `lean`: 3dgs with sampled growth, fading opacities instead of resets, and coarse photographs first; no part of
    /// the psrgs paper.
    Lean,
    /// `psrgs`: progressive spectral residual splatting with the parts that pay, with exposures if these vary, and with
    /// surfaces continued to places that few photographs see.
    Psrgs,
    /// `psrgs-paper`: progressive spectral residual splatting with every part of the paper, whether it pays or not.
    PsrgsPaper,
}

impl Method {
    /// All methods, with their names.
    pub const ALL: [(Self, &str); 7] = [
        (Self::Reference3dgs, "3dgs"),
        (Self::AbsGs, "absgs"),
        (Self::GsPro, "gspro"),
        (Self::Rsgs, "rsgs"),
        (Self::Lean, "lean"),
        (Self::Psrgs, "psrgs"),
        (Self::PsrgsPaper, "psrgs-paper"),
    ];

    /// The method's name.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(method, _)| *method == self).map_or("", |(_, name)| name)
    }

    /// Whether a colour at its lower bound has a gradient where a descent step would raise it. In the reference it has
    /// none and a black splat stays black, which the published methods follow.
    pub fn black_learns(self) -> bool {
        match self {
            Self::Reference3dgs | Self::AbsGs | Self::GsPro | Self::Rsgs => false,
            Self::Lean | Self::Psrgs | Self::PsrgsPaper => true,
        }
    }

    /// Sets the method's values for keys that are not `named`.
    pub fn apply(self, settings: &mut Settings, named: impl Fn(&str) -> bool) {
        settings.run.method = self;
        match self {
            Self::Reference3dgs => {}
            Self::AbsGs => absgs(settings, &named),
            Self::GsPro => gspro(settings, &named),
            Self::Rsgs => rsgs(settings, &named),
            Self::Lean => lean(settings, &named),
            Self::Psrgs => {
                lean(settings, &named);
                psrgs(settings, &named);
                beyond_the_paper(settings, &named);
            }
            Self::PsrgsPaper => {
                lean(settings, &named);
                psrgs(settings, &named);
                psrgs_paper(settings, &named);
            }
        }
    }
}

/// Settings that are steps in a schedule of 30,000 steps.
const STEPS_OF_THE_SCHEDULE: [&str; 8] = [
    "densify-from",
    "densify-until",
    "grow-on-until",
    "opacity-reset-interval",
    "sh-interval",
    "lr-means-steps",
    "propagate-from",
    "propagate-until",
];

/// Sets values of keys that are not named.
macro_rules! unless_named {
    ($named:ident, $settings:ident: $($key:literal $group:ident . $field:ident = $value:expr),+ $(,)?) => {
        $(if !$named($key) {
            $settings.$group.$field = $value;
        })+
    };
}

fn absgs(settings: &mut Settings, named: &impl Fn(&str) -> bool) {
    unless_named!(named, settings:
        "absgrad" density.absgrad = true,
        "split-grad-threshold" density.split_grad_threshold = Some(4e-4),
        "percent-dense" density.percent_dense = 0.001,
    );
}

/// Only normals are compared, with the same weight in every step. The publication weighs the mean over visible splats
/// by 100, which equals this weight per splat for 50,000 visible splats.
fn gspro(settings: &mut Settings, named: &impl Fn(&str) -> bool) {
    unless_named!(named, settings:
        "depth-prior" geometry.depth_prior = DepthPrior::Propagation,
        "depth-steps" geometry.depth_steps = 1.0,
        "depth-left" geometry.depth_left = 1.0,
        "lambda-depth" geometry.lambda_depth = 0.0,
        "lambda-normal" geometry.lambda_normal = 0.01,
        "lambda-flatten" geometry.lambda_flatten = 0.01,
        "gate" frequencies.gate = Gate::Off,
    );
}

/// Depths and planes count everywhere, because there is no texture mask.
fn rsgs(settings: &mut Settings, named: &impl Fn(&str) -> bool) {
    unless_named!(named, settings:
        "depth-prior" geometry.depth_prior = DepthPrior::Lidar,
        "gate" frequencies.gate = Gate::Off,
    );
}

fn lean(settings: &mut Settings, named: &impl Fn(&str) -> bool) {
    // Midway through the published schedule nothing has been pruned and no surface continued, so shorter runs scale
    // the schedule. The published methods do not: a model of theirs after 7,000 steps is known to be an intermediate
    // one. A run in which a step of the schedule is named keeps the schedule.
    if !["scale-schedule"].into_iter().chain(STEPS_OF_THE_SCHEDULE).any(named)
        && settings.run.iterations < Run::default().iterations
    {
        settings.run.scale_schedule = true;
    }
    unless_named!(named, settings:
        "growth" density.growth = Growth::Sampled,
        "absgrad" density.absgrad = true,
        "grad-threshold" density.grad_threshold = 8e-4,
        "low-grad-threshold" density.low_grad_threshold = 8e-4,
        "prune-unseen" density.prune_unseen = true,
        // The extent is that of the cameras. Splats of distant walls and of the sky are larger than any share of it.
        "prune-extent" density.prune_extent = 0.0,
        "prune-weight" density.prune_weight = 0.03,
        "recycle-share" density.recycle_share = 0.2,
        "keep-opacity" density.keep_opacity = 0.98,
        "opacity-reset-interval" density.opacity_reset_interval = 0,
        "coarse-steps" frequencies.coarse_steps = 0.2,
        "lambda-sh" optimiser.lambda_sh = 0.2,
    );
}

fn psrgs(settings: &mut Settings, named: &impl Fn(&str) -> bool) {
    unless_named!(named, settings:
        "grad-threshold" density.grad_threshold = 6e-4,
        "low-grad-threshold" density.low_grad_threshold = 6e-4,
        "low-stage" frequencies.low_stage = 0.25,
        "sample-mask-share" density.sample_mask_share = 0.5,
        "sample-error-share" density.sample_error_share = 0.5,
        "depth-prior" geometry.depth_prior = DepthPrior::Stereo,
        "stereo-width" geometry.stereo_width = 0.7,
        "stereo-thickness" geometry.stereo_thickness = 0.2,
        "stereo-opacity" geometry.stereo_opacity = 0.3,
    );
    // Other priors have no surfaces for first splats.
    if settings.geometry.depth_prior == DepthPrior::Stereo {
        unless_named!(named, settings: "stereo-splats" geometry.stereo_splats = 60_000);
    }
}

/// The parts of `psrgs` beyond the paper. Growth ends after a third of the steps, and splats of little weight are
/// pruned once when the model has settled. This needs the fewest splats for equal renders, and fewer first splats.
fn beyond_the_paper(settings: &mut Settings, named: &impl Fn(&str) -> bool) {
    unless_named!(named, settings:
        "densify-until" density.densify_until = 10_000,
        // Texture, which SSIM measures, counts more than in publications. The thresholds fit the larger gradients.
        "lambda-dssim" optimiser.lambda_dssim = 0.3,
        "grad-threshold" density.grad_threshold = 2.4e-3,
        "low-grad-threshold" density.low_grad_threshold = 2.4e-3,
        "grow-on-threshold" density.grow_on_threshold = 8e-4,
        // Coarse photographs help splats to find their positions. Splats on the surfaces of stereo have theirs.
        "coarse-steps" frequencies.coarse_steps = 0.0,
        "prune-weight" density.prune_weight = 0.11,
        "prune-young" density.prune_young = 0.0,
        "stereo-alone" geometry.stereo_alone = 3,
        "stereo-skirt" geometry.stereo_skirt = 0.5,
        "exposure" optimiser.exposure = Exposure::Auto,
        "visible-adam" shortcuts.visible_adam = true,
        // Splats of low alpha at a pixel are half of the blending work, and say little until splats have found their
        // positions.
        "early-steps" shortcuts.early_steps = 0.75,
    );
    // Splats on the surfaces of stereo stay there without a loss. Other priors work by their loss only.
    if settings.geometry.depth_prior == DepthPrior::Stereo {
        unless_named!(named, settings:
            "stereo-splats" geometry.stereo_splats = 30_000,
            "lambda-depth" geometry.lambda_depth = 0.0,
            "lambda-normal" geometry.lambda_normal = 0.0,
        );
    }
    // Parts that stereo does not find have to grow. A user who names a setting of growth keeps its value.
    if !["densify-until", "grad-threshold", "low-grad-threshold"].into_iter().any(named) {
        unless_named!(named, settings: "grow-on" density.grow_on = 0.5);
    }
    // A user who names the number of splats gets that number.
    if !named("stereo-splats") && settings.geometry.depth_prior == DepthPrior::Stereo {
        unless_named!(named, settings: "stereo-density" geometry.stereo_density = 12_500);
        if !named("stereo-densest") && settings.geometry.stereo_density > 0 {
            settings.geometry.stereo_densest = settings.geometry.stereo_density.max(20_000);
        }
        unless_named!(named, settings: "stereo-splats-for" geometry.stereo_splats_for = 320);
    }
}

/// The parts of the paper that `psrgs` lacks. The thresholds are those in the caption of the paper's figure 2: high for
/// low frequencies.
fn psrgs_paper(settings: &mut Settings, named: &impl Fn(&str) -> bool) {
    unless_named!(named, settings:
        "low-grad-threshold" density.low_grad_threshold = 2.4e-3,
        "low-texture-weight" frequencies.low_texture_weight = 0.3,
        "sigma-learning" frequencies.sigma_learning = SigmaLearning::Errors,
        "lambda-flatten" geometry.lambda_flatten = 0.01,
        "lambda-gradients" texture.lambda_gradients = 0.05,
        "lambda-constrained" texture.lambda_constrained = 0.05,
        "lambda-variation" texture.lambda_variation = 0.005,
        "lambda-perceptual" texture.lambda_perceptual = 0.03,
        "perceptual-every" texture.perceptual_every = 48,
        "perceptual-views" texture.perceptual_views = 4,
    );
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Method {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        let names = Self::ALL.map(|(_, name)| name).join(", ");
        match Self::ALL.iter().find(|(_, name)| *name == word) {
            Some((method, _)) => Ok(*method),
            None => Err(format!("no method `{word}`; this version has {names}")),
        }
    }
}
