//! What one step does.

use super::{Band, PerceptualStep, Rates};

/// Splats that are dropped before a step because of their weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DroppedSplats {
    /// Splats with less weight than this.
    Below(f64),
    /// This share of the splats, the lightest, if a limit of splats holds growth up.
    Lightest(f64),
}

/// Which parameters the optimiser steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Adam {
    /// All.
    All,
    /// All but the opacities: an opacity reset of the reference replaces the opacity tensor, and its gradient is lost.
    AllButOpacities,
    /// None: a density change of the reference replaces every tensor, and after the last iteration it takes no step.
    None,
}

/// A density change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DensityChange {
    /// Whether splats that are large in the scene are pruned too.
    pub prune_large: bool,
    /// Whether every photograph was looked at since the last change: a splat unseen since then is seen by no
    /// photograph.
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
    /// The density change after this step.
    pub densify: Option<DensityChange>,
    /// Whether opacities are reset.
    pub reset_opacity: bool,
    /// What the optimiser steps.
    pub adam: Adam,
    /// Optimiser steps taken when this step is done, for Adam's bias correction: of the opacities ...
    pub adam_steps_opacities: u32,
    /// ... and of all other parameters.
    pub adam_steps: u32,
    /// Whether, after this step, splats that have missed optimiser steps make up for them. The schedule asks for it
    /// before rows move and before the stored step of a splat wraps around; the trainer adds what its host actions ask
    /// for.
    pub catch_up: bool,
    /// Whether the loss pushes opacities to 0 or 1.
    pub decides: bool,
    /// Learning rate of the photograph's exposure.
    pub lr_exposure: f64,
    /// How often the step's photograph has been looked at, this step included.
    pub seen: u32,
    /// Whether the step belongs to the low-frequency stage.
    pub low: bool,
    /// Whether the step is the first after the low-frequency stage: the splats at this step are the constrained set.
    pub constrain: bool,
    /// Factor by which width and height of the photograph are reduced.
    pub factor: u32,
    /// The band of the photograph that the step looks at, if not the whole photograph.
    pub band: Option<Band>,
    /// Splats are skipped where their alpha is below 1 / this; without, below 1 / 255.
    pub alpha_cutoff: Option<u32>,
    /// Factor of the weights of depth and normals, if the step compares depth and normals.
    pub geometry: Option<f64>,
    /// Factor of the weight of gradient maps, if the step compares gradient maps.
    pub gradients: Option<f64>,
    /// The perceptual distance, if the step has it.
    pub perceptual: Option<PerceptualStep>,
    /// Whether the width of the saliency filter is learned from this step's render.
    pub learn_sigma: bool,
}
