//! Learning rates over a run.

use super::REFERENCE_ITERATIONS;
use crate::train::settings::Settings;

/// Runs of fewer steps have the rates of a run of this many, because no shorter run was tried.
const SHORTEST_TRIED: u32 = 750;

/// Learning rates of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// Of the means, per unit of the scene's extent.
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
    /// All rates times `gain`, except that of the higher spherical harmonics, which is multiplied by `sh_rest`.
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
    /// Rates at step 0.
    first: Rates,
    /// Rate of the means when their decay ends.
    means_final: f64,
    means_steps: u32,
    /// Share of the other rates that is left at the last step.
    left: f64,
    iterations: u32,
}

impl RateSchedule {
    /// The published rates are for the published number of steps. Adam moves a parameter by about its rate in a step,
    /// so in fewer steps at the published rates parameters do not get as far. Runs with a scaled schedule begin with
    /// higher rates, and the rates fall so that parameters can settle.
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

    /// Rates at step `t`: log-linear between first and last.
    pub(super) fn at(&self, t: u32) -> Rates {
        let left = log_linear([1.0, self.left], t, self.iterations);
        Rates { means: self.means_at(t), ..self.first.times(left, left) }
    }

    /// Rate of the means at step `t`.
    pub(super) fn means_at(&self, t: u32) -> f64 {
        log_linear([self.first.means, self.means_final], t, self.means_steps)
    }
}

impl Settings {
    /// Gives a run that looks at some of the photographs the learning rates of a run of `steps` steps that looks at all
    /// of them as often: a splat takes as many steps in both, while both have a scaled schedule.
    pub fn keep_rates_of(&mut self, steps: u32) {
        let (own, whole) = (fewer(self), fewer_by(self.run.scale_schedule, steps));
        let optimiser = &mut self.optimiser;
        let gain = (whole / own).powf(optimiser.lr_scaling);
        for rate in [
            &mut optimiser.lr_means,
            &mut optimiser.lr_means_final,
            &mut optimiser.lr_rotations,
            &mut optimiser.lr_scales,
            &mut optimiser.lr_opacities,
            &mut optimiser.lr_sh_base,
        ] {
            *rate *= gain;
        }
        optimiser.lr_sh_rest *= (whole / own).powf(optimiser.lr_scaling_sh);
        if own > 1.0 {
            optimiser.lr_decay *= whole.ln() / own.ln();
        }
    }
}

/// The published number of steps over the number of the run, at least 1; 1 if the schedule is not scaled.
fn fewer(settings: &Settings) -> f64 {
    fewer_by(settings.run.scale_schedule, settings.run.iterations)
}

fn fewer_by(scaled: bool, steps: u32) -> f64 {
    match scaled {
        true => (REFERENCE_ITERATIONS / f64::from(steps.max(SHORTEST_TRIED))).max(1.0),
        false => 1.0,
    }
}

/// Interpolates log-linearly from `first` to `last` over `steps` steps.
pub(super) fn log_linear([first, last]: [f64; 2], t: u32, steps: u32) -> f64 {
    let u = (f64::from(t) / f64::from(steps)).min(1.0);
    ((1.0 - u) * first.ln() + u * last.ln()).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_of_all_published_steps_has_their_learning_rates() {
        let whole = Settings::default();
        let mut part = whole.clone();
        part.shorten_to(5000);
        part.keep_rates_of(whole.run.iterations);
        let (of_whole, of_part) = (RateSchedule::new(&whole, 30_000), RateSchedule::new(&part, 5000));
        for share in [0, 1, 2] {
            let (a, b) = (of_part.at(2500 * share), of_whole.at(15_000 * share));
            let pairs = [(a.means, b.means), (a.opacities, b.opacities), (a.sh_rest, b.sh_rest), (a.scales, b.scales)];
            assert!(pairs.iter().all(|(a, b)| (a / b - 1.0).abs() < 1e-9), "{a:?} and {b:?}");
        }
    }

    #[test]
    fn a_part_has_the_learning_rates_of_the_whole() {
        for (steps, of, scaled) in [(900, 4000, true), (4000, 40_000, true), (300, 600, true), (900, 4000, false)] {
            let mut settings = Settings::default();
            settings.run.scale_schedule = scaled;
            settings.run.iterations = of;
            let whole = RateSchedule::new(&settings, of);
            settings.run.iterations = steps;
            settings.keep_rates_of(of);
            let part = RateSchedule::new(&settings, steps);
            for (now, then) in [(0, 0), (steps / 2, of / 2), (steps, of)] {
                let (a, b) = (part.at(now), whole.at(then));
                let pairs =
                    [(a.means, b.means), (a.opacities, b.opacities), (a.sh_rest, b.sh_rest), (a.scales, b.scales)];
                assert!(pairs.iter().all(|(a, b)| (a / b - 1.0).abs() < 1e-9), "{steps} of {of}: {a:?} and {b:?}");
            }
        }
    }
}
