//! Methods: named sets of values for the settings. Apart from [`Method::black_learns`], training depends on the
//! settings only.

use std::fmt;
use std::str::FromStr;

use super::preset::LOOKS;
use super::{
    ConstrainedAgainst, DepthPrior, Exposure, Gate, Growth, Housekeeping, Run, Settings, SigmaLearning, Spacing, Start,
};

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
    /// `mcmc`: 3dgs whose dead splats are relocated, with noise on the means and a price of opacity and scale (3DGS-MCMC,
    /// Kheradmand et al. 2024).
    Mcmc,
    /// `lean`: 3dgs with sampled growth, fading opacities instead of resets, and coarse photographs first; no part of
    /// the psrgs paper.
    Lean,
    /// `psrgs`: progressive spectral residual splatting from surfaces of stereo, with lean housekeeping.
    Psrgs,
    /// `psrgs-paper`: progressive spectral residual splatting as published: every part of the paper from the dataset's
    /// points, with the housekeeping of 3dgs.
    PsrgsPaper,
}

impl Method {
    /// All methods, with their names.
    pub const ALL: [(Self, &str); 8] = [
        (Self::Reference3dgs, "3dgs"),
        (Self::AbsGs, "absgs"),
        (Self::GsPro, "gspro"),
        (Self::Rsgs, "rsgs"),
        (Self::Mcmc, "mcmc"),
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
            Self::Reference3dgs | Self::AbsGs | Self::GsPro | Self::Rsgs | Self::Mcmc => false,
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
            Self::Mcmc => mcmc(settings, &named),
            Self::Lean => lean(settings, &named),
            Self::Psrgs => psrgs(settings, &named),
            Self::PsrgsPaper => psrgs_paper(settings, &named),
        }
        if settings.density.housekeeping == Housekeeping::Lean {
            housekeeping(settings, &named);
        }
    }
}

/// Settings that are steps in a schedule of 30,000 steps.
pub(super) const STEPS_OF_THE_SCHEDULE: [&str; 7] = [
    "densify-from",
    "densify-until",
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

/// The published limit of splats is set for each scene; gsplat, which others compare with, has one million.
fn mcmc(settings: &mut Settings, named: &impl Fn(&str) -> bool) {
    unless_named!(named, settings:
        "growth" density.growth = Growth::Relocated,
        "max-splats" density.max_splats = Some(1_000_000),
        "densify-until" density.densify_until = 25_000,
        "opacity-reset-interval" density.opacity_reset_interval = 0,
        "noise-means" density.noise_means = 5e5,
        "first-opacity" geometry.first_opacity = 0.5,
        "first-width" geometry.first_width = 0.1,
        "lambda-opacity" optimiser.lambda_opacity = 0.01,
        "lambda-scale" optimiser.lambda_scale = 0.01,
        "lr-opacities" optimiser.lr_opacities = 0.05,
    );
}

/// A shorter training is a whole one in fewer steps: a model in the middle of the published schedule has not been
/// pruned. The published methods keep the published steps, as a model of 7,000 steps is known to be one in the middle.
/// A user who names a step of the schedule has it there, in the published number of steps; who names nothing of it has
/// as many steps as the photographs need.
fn steps(settings: &mut Settings, named: &impl Fn(&str) -> bool) {
    if STEPS_OF_THE_SCHEDULE.into_iter().any(named) {
        return;
    }
    if !named("scale-schedule") && settings.run.iterations < Run::default().iterations {
        settings.run.scale_schedule = true;
    }
    let unscaled = named("scale-schedule") && !settings.run.scale_schedule;
    if !unscaled && !["iterations", "preset", "looks"].into_iter().any(named) {
        settings.run.looks = Some(LOOKS);
    }
}

/// Few splats and cheap steps, for any method: the values of `housekeeping = lean`.
fn housekeeping(settings: &mut Settings, named: &impl Fn(&str) -> bool) {
    unless_named!(named, settings:
        "prune-unseen" density.prune_unseen = true,
        // The extent is that of the cameras: splats of walls and a sky far beyond are larger than any share of it.
        "prune-extent" density.prune_extent = 0.0,
        "prune-weight" density.prune_weight = 0.11,
        "prune-young" density.prune_young = 0.0,
        "recycle-share" density.recycle_share = 0.2,
        "keep-opacity" density.keep_opacity = 0.98,
        "opacity-reset-interval" density.opacity_reset_interval = 0,
        "lambda-sh" optimiser.lambda_sh = 0.2,
        "visible-adam" shortcuts.visible_adam = true,
        // A splat's faint rim is half of the blended pairs, and says little until splats have found their places.
        "early-steps" shortcuts.early_steps = 0.75,
    );
}

fn lean(settings: &mut Settings, named: &impl Fn(&str) -> bool) {
    steps(settings, named);
    unless_named!(named, settings:
        "housekeeping" density.housekeeping = Housekeeping::Lean,
        "growth" density.growth = Growth::Sampled,
        "absgrad" density.absgrad = true,
        "grad-threshold" density.grad_threshold = 8e-4,
        "low-grad-threshold" density.low_grad_threshold = 8e-4,
        "coarse-steps" frequencies.coarse_steps = 0.2,
    );
}

/// The parts of the paper that `psrgs` and `psrgs-paper` share. Thresholds are staged as in the caption of the paper's
/// second figure: high where frequencies are low.
fn parts_of_the_paper(settings: &mut Settings, named: &impl Fn(&str) -> bool) {
    steps(settings, named);
    unless_named!(named, settings:
        "growth" density.growth = Growth::Sampled,
        "absgrad" density.absgrad = true,
        "sample-mask-share" density.sample_mask_share = 0.5,
        "sample-error-share" density.sample_error_share = 0.5,
        "low-stage" frequencies.low_stage = 0.25,
        "depth-prior" geometry.depth_prior = DepthPrior::Stereo,
        "lambda-flatten" geometry.lambda_flatten = 0.01,
    );
    // The loss on depth and normals is that of the low-frequency stage. Without the stage there is none.
    unless_named!(named, settings: "depth-steps" geometry.depth_steps = settings.frequencies.low_stage);
}

fn psrgs(settings: &mut Settings, named: &impl Fn(&str) -> bool) {
    parts_of_the_paper(settings, named);
    // The geometry of the low-frequency stage is held to the end.
    let held = if settings.frequencies.low_stage > 0.0 { 1.0 } else { 0.0 };
    unless_named!(named, settings:
        "depth-steps" geometry.depth_steps = held,
        "lambda-normal" geometry.lambda_normal = 0.05,
        "lambda-binary" optimiser.lambda_binary = 0.1,
        "start" geometry.start = Start::Stereo,
        "exposure" optimiser.exposure = Exposure::Auto,
        "housekeeping" density.housekeeping = Housekeeping::Lean,
        // Texture, which SSIM sees, counts more than in publications, and its larger gradients take larger thresholds.
        "lambda-dssim" optimiser.lambda_dssim = 0.3,
        "grad-threshold" density.grad_threshold = 1.2e-3,
        "low-grad-threshold" density.low_grad_threshold = 2.4e-3,
        "split-along-gradient" density.split_along_gradient = true,
    );
    // Other masks have no sigma.
    if settings.frequencies.gate == Gate::Spectral {
        unless_named!(named, settings: "sigma-learning" frequencies.sigma_learning = SigmaLearning::Errors);
    }
    if settings.geometry.begins_on_surfaces() {
        unless_named!(named, settings:
            "stereo-spacing" geometry.stereo_spacing = Spacing::Frequency,
            "stereo-width" geometry.stereo_width = 0.7,
            "stereo-thickness" geometry.stereo_thickness = 0.2,
            "stereo-opacity" geometry.stereo_opacity = 0.3,
            "stereo-alone" geometry.stereo_alone = 3,
            // Photographs that agree on few surfaces would be fitted one by one.
            "growth-room" density.growth_room = 4.0,
        );
    }
}

fn psrgs_paper(settings: &mut Settings, named: &impl Fn(&str) -> bool) {
    parts_of_the_paper(settings, named);
    unless_named!(named, settings:
        "split-along-gradient" density.split_along_gradient = true,
        "grad-threshold" density.grad_threshold = 6e-4,
        "low-grad-threshold" density.low_grad_threshold = 2.4e-3,
        "low-texture-weight" frequencies.low_texture_weight = 0.3,
        "sigma-learning" frequencies.sigma_learning = SigmaLearning::Composite,
        "lambda-constrained" texture.lambda_constrained = 0.05,
        "constrained-against" texture.constrained_against = ConstrainedAgainst::Render,
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
