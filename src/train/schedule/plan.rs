//! What one step does.

use super::{Band, PerceptualStep, Rates};

/// Splats that are dropped before a step for their weight; those too large for where they are go with them, or alone with a weight of 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Dropped {
    /// Those of less weight than this.
    Below(f64),
    /// This share of them, the lightest, where a limit holds growth up.
    Lightest(f64),
}

/// Which parameters the optimiser steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Adam {
    /// All.
    All,
    /// All but the opacities: the reference replaces the opacity tensor when it resets it, and with it the gradient.
    AllButOpacities,
    /// None: the reference replaces every tensor when it changes density, and does not step after the last iteration.
    None,
}

/// A density change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DensityChange {
    /// Whether splats that are large in the scene are pruned too.
    pub prune_large: bool,
    /// Whether the photographs looked at since the last change are as many as there are: what none of them shows, no photograph does.
    pub sees_all: bool,
}

/// Everything that one step does. The order is: look at the photograph, accumulate statistics, change density, reset
/// opacities, step the optimiser.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepPlan {
    /// The step, from 1.
    pub step: u32,
    /// Learning rates.
    pub rates: Rates,
    /// Degree of the spherical harmonics in use.
    pub sh_degree: u32,
    /// Colour behind the splats.
    pub background: [f32; 3],
    /// Whether the step's screen-space gradients are added to the statistics of density control.
    pub accumulate: bool,
    /// The density change of this step.
    pub densify: Option<DensityChange>,
    /// Whether opacities are reset.
    pub reset_opacity: bool,
    /// What the optimiser steps.
    pub adam: Adam,
    /// Optimiser steps taken when this one is done, for Adam's bias correction: of the opacities ...
    pub adam_steps_opacities: u32,
    /// ... and of all other parameters.
    pub adam_steps: u32,
    /// Whether splats that have missed steps of the optimiser make up for them when this one is done: before rows change their places, and
    /// before their number no longer tells how many they were.
    pub catch_up: bool,
    /// Learning rate of the photograph's exposure.
    pub lr_exposure: f64,
    /// How often the step's photograph has been looked at, this step included.
    pub seen: u32,
    /// Whether the step belongs to the low-frequency stage.
    pub low: bool,
    /// Whether it is the first after that stage: the splats that it sees are the constrained set.
    pub constrain: bool,
    /// By what the photograph is reduced.
    pub factor: u32,
    /// The part of the photograph that the step looks at, where that is not all of it.
    pub band: Option<Band>,
    /// Splats are skipped where their alpha is below 1 / this, where that is not 255.
    pub alpha_cutoff: Option<u32>,
    /// What the weights of depth and normals are multiplied by, where the step has them.
    pub geometry: Option<f64>,
    /// What the weight of gradient maps is multiplied by, where the step has them.
    pub gradients: Option<f64>,
    /// The perceptual distance, where the step has it.
    pub perceptual: Option<PerceptualStep>,
    /// Whether the width of the saliency filter is learned from what it shows.
    pub learn_sigma: bool,
}
