//! Learning rates over a run.

use super::REFERENCE_ITERATIONS;
use crate::train::settings::Settings;

/// Shorter runs have the rates of one with so many steps: nothing shorter was tried.
const SHORTEST_TRIED: u32 = 750;

/// Learning rates of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// Of the means, per unit of the scene's extent: multiply by the extent.
    pub means: f64,
    /// Of the quaternions.
    pub rotations: f64,
    /// Of the log scales.
    pub scales: f64,
    /// Of the opacity logits.
    pub opacities: f64,
    /// Of the constant spherical harmonic.
    pub sh_base: f64,
    /// Of the other spherical harmonics.
    pub sh_rest: f64,
}

impl Rates {
    /// All of them times `gain`, but for those of the higher spherical harmonics.
    fn times(self, gain: f64, sh_rest: f64) -> Self {
        Self {
            means: self.means * gain,
            rotations: self.rotations * gain,
            scales: self.scales * gain,
            opacities: self.opacities * gain,
            sh_base: self.sh_base * gain,
            sh_rest: self.sh_rest * sh_rest,
        }
    }
}

/// How rates change over a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RateSchedule {
    /// At step 0.
    first: Rates,
    /// Of the means when their decay ends.
    means_final: f64,
    means_steps: u32,
    /// What is left of the others at the last step.
    left: f64,
    iterations: u32,
}

impl RateSchedule {
    /// The published rates are for the published number of steps. Adam moves a parameter by about its rate in a step, so in fewer
    /// steps at these rates parameters do not get as far. Runs whose schedule is scaled begin with higher ones, which would keep
    /// parameters from settling and so fall again.
    pub(super) fn new(settings: &Settings, means_steps: u32) -> Self {
        let (run, optimiser) = (&settings.run, &settings.optimiser);
        let fewer = fewer(settings);
        let gain = fewer.powf(optimiser.lr_scaling);
        let published = Rates {
            means: optimiser.lr_means,
            rotations: optimiser.lr_rotations,
            scales: optimiser.lr_scales,
            opacities: optimiser.lr_opacities,
            sh_base: optimiser.lr_sh_base,
            sh_rest: optimiser.lr_sh_rest,
        };
        Self {
            first: published.times(gain, fewer.powf(optimiser.lr_scaling_sh)),
            means_final: optimiser.lr_means_final * gain,
            means_steps,
            left: fewer.powf(-optimiser.lr_decay),
            iterations: run.iterations.max(1),
        }
    }

    /// At `t`: log-linear between first and last.
    pub(super) fn at(&self, t: u32) -> Rates {
        let left = log_linear([1.0, self.left], t, self.iterations);
        Rates { means: self.means_at(t), ..self.first.times(left, left) }
    }

    /// Of the means at `t`.
    pub(super) fn means_at(&self, t: u32) -> f64 {
        log_linear([self.first.means, self.means_final], t, self.means_steps)
    }
}

/// How many times the published number of steps is that of the run, where its schedule is scaled.
fn fewer(settings: &Settings) -> f64 {
    match settings.run.scale_schedule {
        true => (REFERENCE_ITERATIONS / f64::from(settings.run.iterations.max(SHORTEST_TRIED))).max(1.0),
        false => 1.0,
    }
}

/// From one rate to another over so many steps.
pub(super) fn log_linear([first, last]: [f64; 2], t: u32, steps: u32) -> f64 {
    let u = (f64::from(t) / f64::from(steps)).min(1.0);
    ((1.0 - u) * first.ln() + u * last.ln()).exp()
}
