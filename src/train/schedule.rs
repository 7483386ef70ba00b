//! What happens at each training step, as pure functions of the step number: learning rates, spherical-harmonic degree,
//! density changes, opacity resets, and the photograph that the step looks at. Steps can be planned in any order, so a
//! replayed or resumed step repeats itself.
//!
//! Steps count from 1 to the number of iterations. Values and quirks follow the reference implementation of 3D Gaussian
//! splatting (Kerbl et al. 2023).

mod band;
mod event;
mod perceptual;
mod plan;
mod propagations;
mod rates;

use super::settings::{self, Background, Density, Settings, SigmaLearning};
use crate::scene::random::hash;
use propagations::Propagations;
use rates::{RateSchedule, log_linear};

pub use band::Band;
pub use event::{Event, Kind};
pub use perceptual::{Beside, MOST_BESIDE, PerceptualStep};
pub use plan::{Adam, DensityChange, DroppedSplats, StepPlan};
pub use rates::Rates;

/// Iterations that the method's published schedule is made for.
const REFERENCE_ITERATIONS: f64 = 30_000.0;
/// Scaled schedules: an interval of growth takes at least the run's steps divided by this. Growth takes half of a run.
const MOST_INTERVALS: u32 = 15;
/// Scaled schedules: between two density changes a run looks at all photographs, or at this many.
const LONGEST_PASS: u32 = 100;
/// Scaled schedules: fewest steps between two opacity resets.
const SHORTEST_RESET_INTERVAL: u32 = 500;
/// Scaled schedules: steps of growth that follow the last opacity reset.
const RESET_RECOVERY: u32 = 300;
/// Splats of little weight are dropped a second time after this share of the steps.
const PRUNE_AGAIN: f64 = 0.8;
/// Splats make up for missed optimiser steps after this many at the latest: a splat's last step is stored modulo 2^16.
const LONGEST_REST: u32 = 1 << 14;
/// Passes over the views between two weighings of a limited set of splats: a weighing renders every view once.
const RECYCLE_PASSES: u32 = 3;

/// The schedule of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    /// Steps of the run.
    pub iterations: u32,
    /// Density changes happen after this step ...
    pub densify_from: u32,
    /// ... and before this one ...
    pub densify_until: u32,
    /// ... at its multiples.
    pub densify_interval: u32,
    /// Opacities are reset at multiples of this before `densify_until`; 0 for never.
    pub reset_interval: u32,
    /// Last step at which an opacity reset may happen.
    pub reset_until: u32,
    /// Large splats are pruned by density changes after this step.
    pub prune_large_after: u32,
    /// Steps from one degree of the spherical harmonics to the next.
    pub sh_interval: u32,
    /// Steps over which the learning rate of the means decays.
    pub lr_means_steps: u32,
    /// Last step of the low-frequency stage; 0 where there is none.
    pub low_until: u32,
    /// Last step that looks at a reduced photograph; 0 where there is none.
    pub coarse_until: u32,
    /// Last step that looks at a photograph of a quarter of the width and height.
    pub quarter_until: u32,
    /// Last step with a loss on depth and normals; 0 where there is none.
    pub geometry_until: u32,
    early: EarlyCutoff,
    /// The loss pushes opacities to 0 or 1 after this step.
    decides_after: u32,
    geometry_every: u32,
    /// Share of the weight of depth and normals that is left at `geometry_until`.
    geometry_left: f64,
    gradients: Every,
    perceptual: Every,
    /// Views that a step with the perceptual distance looks at beside its own.
    perceptual_beside: usize,
    sigma: Every,
    sigma_from: u32,
    propagations: Propagations,
    /// Splats below these weights are dropped before the steps of `prune_before`.
    prune_weights: [f64; 2],
    prune_before: [u32; 2],
    prune_from: u32,
    skirt_before: u32,
    /// Splats wider than the local wavelength are split before this step; 0 for never.
    split_wide_before: u32,
    /// Share of the splats that is dropped to make room for growth.
    recycle_share: f64,
    /// Density changes from one recycling to the next.
    recycle_every: u32,
    sh_degree: u32,
    /// Before this step the splats with harmonics above degree 1 are chosen; 0 where all splats have them.
    settle_sh: u32,
    densify: bool,
    /// Share by which the set grows where dead splats are relocated in place of density changes.
    relocation: Option<f64>,
    background: Background,
    rates: RateSchedule,
    /// Learning rate of the exposures at step 0 and at the last step.
    lr_exposure: [f64; 2],
    seed: u64,
    views: usize,
    /// Bands of a photograph: steps in which a photograph is looked at once.
    bands: u32,
}

impl Schedule {
    /// The stage that is over after `done` steps of a run of `former` steps and would begin again in a run with the
    /// steps of `settings`, because stages are shares of all steps. A stage of all steps goes on.
    pub fn begins_again(settings: &Settings, former: u32, done: u32) -> Option<&'static str> {
        let ends = |iterations| {
            let mut settings = settings.clone();
            settings.run.iterations = iterations;
            let Self { coarse_until, low_until, geometry_until, .. } = Self::new(&settings, 1);
            [coarse_until, low_until, geometry_until]
        };
        let (before, now) = (ends(former), ends(settings.run.iterations));
        let names = ["that of coarse photographs", "the low-frequency stage", "that of the loss on depth and normals"];
        (0..names.len()).find(|&k| before[k] < former && (before[k]..now[k]).contains(&done)).map(|k| names[k])
    }

    /// The schedule for `views` training photographs.
    pub fn new(settings: &Settings, views: usize) -> Self {
        let (run, density, optimiser) = (&settings.run, &settings.density, &settings.optimiser);
        let s = if run.scale_schedule { f64::from(run.iterations) / REFERENCE_ITERATIONS } else { 1.0 };
        let scaled = |steps: u32| (f64::from(steps) * s).round() as u32;

        let growth = Growth::new(settings, views, scaled);
        let relocates = density.growth == settings::Growth::Relocated;
        // On white there is a reset when growth begins too.
        let on_white = settings.model.background == Background::White;
        let dimmed_from = if density.no_densify || !relocates && growth.reset_interval == 0 {
            u32::MAX
        } else if relocates || on_white {
            scaled(density.densify_from)
        } else {
            growth.reset_interval
        };
        let densify_until = growth.until;
        let prune_again = (PRUNE_AGAIN * f64::from(run.iterations)).round() as u32 + 1;
        let prune_large_after = if growth.reset_interval > 0 { growth.reset_interval } else { scaled(3000) };
        let coarse_until = (settings.frequencies.coarse_steps * f64::from(run.iterations)).round() as u32;
        let low_until = (settings.frequencies.low_stage * f64::from(run.iterations)).round() as u32;
        let early_until = (settings.shortcuts.early_steps * f64::from(run.iterations)).round() as u32;
        let lr_means_steps = scaled(optimiser.lr_means_steps).max(1);
        let mut out = Self {
            iterations: run.iterations,
            densify_from: scaled(density.densify_from),
            densify_until,
            densify_interval: growth.interval,
            reset_interval: growth.reset_interval,
            reset_until: growth.reset_until,
            prune_large_after,
            sh_interval: scaled(settings.model.sh_interval).max(1),
            lr_means_steps,
            low_until,
            coarse_until,
            quarter_until: (settings.frequencies.coarse_quarter * f64::from(coarse_until)) as u32,
            geometry_until: match settings.geometry.has_loss() {
                true => (settings.geometry.depth_steps * f64::from(run.iterations)).round() as u32,
                false => 0,
            },
            decides_after: match optimiser.lambda_binary > 0.0 {
                true => (optimiser.binary_from * f64::from(run.iterations)).round() as u32,
                false => u32::MAX,
            },
            early: EarlyCutoff {
                // Splats that a reset or a relocation has made fainter than the cutoff would never be shown again.
                until: early_until.min(dimmed_from),
                cutoff: settings.shortcuts.early_cutoff,
            },
            geometry_every: settings.geometry.depth_every.max(1),
            geometry_left: settings.geometry.depth_left,
            gradients: Every::new(settings.texture.gradients_every, settings.texture.wants_gradients()),
            perceptual: Every::new(settings.texture.perceptual_every, settings.texture.lambda_perceptual > 0.0),
            perceptual_beside: settings.texture.views_at_once() as usize - 1,
            sigma: Every::new(
                settings.frequencies.sigma_every,
                settings.frequencies.sigma_learning != SigmaLearning::Off,
            ),
            // The two sets of a composite exist from the second step of the high-frequency stage on.
            sigma_from: match settings.frequencies.sigma_learning {
                SigmaLearning::Composite => low_until.saturating_add(2),
                _ => 0,
            },
            propagations: Propagations::default(),
            prune_weights: [density.prune_weight * density.prune_young, density.prune_weight],
            prune_from: density.prune_weight_from.max(densify_until),
            prune_before: [densify_until, prune_again],
            skirt_before: match settings.geometry.stereo_skirt > 0.0 && settings.model.sh_share >= 1.0 {
                true => prune_again.max(densify_until + 1),
                false => 0,
            },
            split_wide_before: 0,
            recycle_share: density.recycle_share,
            recycle_every: recycle_steps(views, run.bands).div_ceil(growth.interval),
            sh_degree: settings.model.sh_degree,
            settle_sh: match (settings.model.sh_share < 1.0, settings.density.no_densify) {
                (false, _) => 0,
                (true, false) => densify_until.max(1),
                (true, true) => 2 * scaled(settings.model.sh_interval).max(1),
            },
            densify: !settings.density.no_densify,
            relocation: relocates.then(|| growth.share(density, s)),
            background: settings.model.background,
            rates: RateSchedule::new(settings, lr_means_steps),
            lr_exposure: [optimiser.lr_exposure, optimiser.lr_exposure_final],
            seed: run.seed,
            views,
            bands: run.bands.max(1),
        };
        if density.split_wavelength > 0.0 && !density.no_densify {
            let asked = (density.split_wavelength_at * f64::from(run.iterations)).round() as u32 + 1;
            // Children have no statistics: where splats grow, they begin with those of all splats.
            let mut near = asked..=asked.saturating_add(out.densify_interval);
            out.split_wide_before = near.find(|t| out.densifies_at(t - 1)).unwrap_or(asked);
        }
        out.propagations = Propagations::new(&settings.geometry, scaled, |t| out.view_at(t));
        out
    }

    /// Whether depths are propagated before step `t`, and the depth ratio from which on splats are added.
    pub fn propagates(&self, t: u32) -> Option<f64> {
        self.propagations.at(t)
    }

    /// The splats of little weight that are dropped before step `t`: when growth ends, once more when the remaining
    /// splats have settled, and during growth to make room for it.
    pub fn drops(&self, t: u32) -> Option<DroppedSplats> {
        let due = self.densify && t >= self.prune_from && t <= self.iterations;
        // If both times fall on one step, the second weight counts.
        let weight = (0..2).rev().find(|&k| due && self.prune_before[k] == t).map_or(0.0, |k| self.prune_weights[k]);
        let below = (weight > 0.0).then_some(DroppedSplats::Below(weight));
        below.or(self.recycles(t).then_some(DroppedSplats::Lightest(self.recycle_share)))
    }

    /// Whether splats where no photograph looks are added before step `t`. No later step drops splats that no
    /// photograph shows.
    pub fn skirts(&self, t: u32) -> bool {
        self.skirt_before > 0 && t == self.skirt_before
    }

    /// Whether splats wider than the local wavelength are split before step `t`.
    pub fn splits_wide(&self, t: u32) -> bool {
        self.split_wide_before > 0 && t == self.split_wide_before
    }

    /// Whether dead splats are relocated before step `t`, and the share by which the set grows then.
    pub fn relocates(&self, t: u32) -> Option<f64> {
        self.relocation.filter(|_| self.changes_at(t.saturating_sub(1)))
    }

    /// Whether the splats with harmonics above degree 1 are chosen before step `t`.
    pub fn settles_sh(&self, t: u32) -> bool {
        self.settle_sh > 0 && t == self.settle_sh && self.sh_degree > 1
    }

    /// Degrees are added one after the other. If only some splats have more than degree 1, no degree above 1 is used
    /// before those splats are chosen.
    fn sh_degree_at(&self, t: u32) -> u32 {
        let degree = (t / self.sh_interval).min(self.sh_degree);
        if t < self.settle_sh { degree.min(1) } else { degree }
    }

    /// Whether the lightest splats are dropped before step `t`: after a density change that another one follows.
    fn recycles(&self, t: u32) -> bool {
        let before = t.saturating_sub(1);
        let change = before / self.densify_interval;
        self.recycle_share > 0.0
            && self.densifies_at(before)
            && change.is_multiple_of(self.recycle_every)
            && self.densifies_at(before + self.densify_interval)
    }

    /// What step `t` does.
    pub fn step(&self, t: u32) -> StepPlan {
        let densify = self.densifies_at(t);
        let reset_opacity = self.resets_at(t);
        StepPlan {
            step: t,
            rates: self.rates.at(t),
            sh_degree: self.sh_degree_at(t),
            background: self.background_at(t),
            accumulate: self.densify && self.relocation.is_none() && t < self.densify_until,
            densify: densify.then(|| DensityChange {
                prune_large: t > self.prune_large_after,
                sees_all: self.steps_since_change(t) >= pass_of(self.views, self.bands),
            }),
            reset_opacity,
            adam: match (densify || t >= self.iterations, reset_opacity) {
                (true, _) => Adam::None,
                (false, true) => Adam::AllButOpacities,
                (false, false) => Adam::All,
            },
            adam_steps_opacities: self.adam_steps(t, true),
            adam_steps: self.adam_steps(t, false),
            catch_up: self.catches_up_at(t),
            decides: t > self.decides_after,
            lr_exposure: self.lr_exposure(t),
            seen: self.seen_at(t),
            low: t <= self.low_until,
            constrain: self.low_until > 0 && t == self.low_until + 1,
            factor: self.factor_at(t),
            band: self.band_at(t),
            alpha_cutoff: (t <= self.early.until).then_some(self.early.cutoff),
            geometry: self.geometry_at(t),
            gradients: self.gradients.at(t, self.low_until),
            perceptual: self.perceptual_at(t),
            learn_sigma: self.learns_sigma_at(t),
        }
    }

    /// The weight falls log-linearly to `geometry_left` at the last step with the loss. Every `geometry_every`-th step
    /// has the loss, and carries the weight of all the steps between.
    fn geometry_at(&self, t: u32) -> Option<f64> {
        let due = t <= self.geometry_until && t.is_multiple_of(self.geometry_every);
        due.then(|| {
            f64::from(self.geometry_every) * log_linear([1.0, self.geometry_left], t, self.geometry_until.max(1))
        })
    }

    /// How often the photograph of step `t` has been looked at, step `t` included.
    fn seen_at(&self, t: u32) -> u32 {
        let before = t.saturating_sub(1);
        before / pass_of(self.views.max(1), self.bands) * self.bands + before % self.bands + 1
    }

    /// A step with a reduced photograph looks at no view but its own.
    fn perceptual_at(&self, t: u32) -> Option<PerceptualStep> {
        let times = self.perceptual.at(t, self.low_until)?;
        let most = if self.factor_at(t) == 1 { self.perceptual_beside } else { 0 };
        // Of the steps that look at the bands of a photograph, one.
        let steps = (1..t).rev().skip(self.bands as usize - 1).step_by(self.bands as usize);
        let before = steps.map(|step| Beside { view: self.view_at(step), seen: self.seen_at(step) });
        Some(PerceptualStep::new(times, self.view_at(t), before, most))
    }

    /// Not from reduced photographs, which have no fine detail.
    fn learns_sigma_at(&self, t: u32) -> bool {
        self.factor_at(t) == 1 && self.sigma.at(t, self.sigma_from.saturating_sub(1)).is_some()
    }

    /// 4 in the first of the coarse steps, 2 in the others, 1 after them.
    fn factor_at(&self, t: u32) -> u32 {
        match t {
            t if t > self.coarse_until => 1,
            t if t <= self.quarter_until => 4,
            _ => 2,
        }
    }

    /// A step that compares more than colours, or looks at a reduced photograph, looks at the whole photograph.
    fn band_at(&self, t: u32) -> Option<Band> {
        let all = self.geometry_at(t).is_some()
            || self.gradients.at(t, self.low_until).is_some()
            || self.perceptual_at(t).is_some()
            || self.learns_sigma_at(t)
            || self.factor_at(t) > 1;
        let index = t.saturating_sub(1) % self.bands;
        (self.bands > 1 && !all).then_some(Band { index, of: self.bands })
    }

    /// Learning rate of the means at step `t`, per unit of the scene's extent: log-linear between its two ends.
    pub fn lr_means(&self, t: u32) -> f64 {
        self.rates.means_at(t)
    }

    /// Learning rate of the exposures at step `t`: log-linear over the run.
    fn lr_exposure(&self, t: u32) -> f64 {
        log_linear(self.lr_exposure, t, self.iterations.max(1))
    }

    /// Steps that a pass over all training photographs takes.
    pub(in crate::train) fn steps_of_a_pass(&self) -> u32 {
        (self.views as u32).max(1).saturating_mul(self.bands)
    }

    /// Index of the training view of step `t`; 0 when there are no views. Every pass looks at each view once in a
    /// shuffled order, and at all bands of a view in consecutive steps.
    pub fn view_at(&self, t: u32) -> usize {
        let Some(last) = self.views.checked_sub(1) else { return 0 };
        let before = (t.saturating_sub(1) / self.bands) as usize;
        let (pass, position) = (before / self.views, before % self.views);
        let mut order: Vec<usize> = (0..self.views).collect();
        for i in (1..=last).rev() {
            let j = bounded(draw(self.seed, Stream::Views, pass as u64, i as u64), i + 1);
            order.swap(i, j);
        }
        order[position]
    }

    /// Density changes up to and including step `t`.
    pub fn density_changes(&self, t: u32) -> u32 {
        if !self.densify || self.relocation.is_some() {
            return 0;
        }
        let last = t.min(self.densify_until.min(self.iterations).saturating_sub(1));
        (last / self.densify_interval).saturating_sub(self.densify_from / self.densify_interval)
    }

    /// Neither a density change nor a reset follows the last step, because no training would follow. The reference also
    /// saves its model before both.
    fn densifies_at(&self, t: u32) -> bool {
        self.relocation.is_none() && self.changes_at(t)
    }

    /// Whether the set of splats grows after step `t`, by a density change or by relocation.
    fn changes_at(&self, t: u32) -> bool {
        let grows = self.densify && t > self.densify_from && t < self.densify_until.min(self.iterations);
        grows && t.is_multiple_of(self.densify_interval)
    }

    /// Steps up to `t` since the density change before it.
    fn steps_since_change(&self, t: u32) -> u32 {
        let before = t.saturating_sub(self.densify_interval);
        if self.densifies_at(before) { t - before } else { t }
    }

    fn resets_at(&self, t: u32) -> bool {
        if !self.densify || self.reset_interval == 0 || t == 0 || t >= self.iterations {
            return false;
        }
        let regular = t.is_multiple_of(self.reset_interval) && t <= self.reset_until;
        // On a white background the reference also resets once when growth begins.
        let white = self.background == Background::White && t == self.densify_from && t < self.densify_until;
        regular || white
    }

    /// Splats make up for missed optimiser steps before a density change or reset and at the end of the run. Host
    /// actions ask for it themselves.
    fn catches_up_at(&self, t: u32) -> bool {
        self.densifies_at(t) || self.resets_at(t) || t >= self.iterations || t.is_multiple_of(LONGEST_REST)
    }

    /// Optimiser steps up to and including step `t`. A step with a density change has none, nor has the last; a step
    /// with a reset alone has none of the opacities.
    fn adam_steps(&self, t: u32, opacities: bool) -> u32 {
        let t = t.min(self.iterations);
        let last = u32::from(t == self.iterations);
        let mut steps = t - self.density_changes(t) - last;
        if opacities && self.reset_interval > 0 && self.densify {
            let resets = (1..=t / self.reset_interval).map(|k| k * self.reset_interval);
            let white = (!self.densify_from.is_multiple_of(self.reset_interval)).then_some(self.densify_from);
            let alone = |&r: &u32| r <= t && self.resets_at(r) && !self.densifies_at(r);
            steps -= resets.chain(white).filter(alone).count() as u32;
        }
        steps
    }

    fn background_at(&self, t: u32) -> [f32; 3] {
        match self.background {
            Background::Black => [0.0; 3],
            Background::White => [1.0; 3],
            Background::Random => std::array::from_fn(|c| {
                let bits = draw(self.seed, Stream::Background, u64::from(t), c as u64);
                (bits >> 40) as f32 / (1_u32 << 24) as f32
            }),
        }
    }
}

/// Steps that look at all of every view once.
fn pass_of(views: usize, bands: u32) -> u32 {
    u32::try_from(views).unwrap_or(u32::MAX).saturating_mul(bands.max(1))
}

/// Steps from one weighing of the splats to the next.
fn recycle_steps(views: usize, bands: u32) -> u32 {
    pass_of(views, bands).saturating_mul(RECYCLE_PASSES).max(1)
}

/// When splats grow and opacities are reset.
struct Growth {
    until: u32,
    /// At least 1.
    interval: u32,
    reset_interval: u32,
    reset_until: u32,
}

impl Growth {
    fn new(settings: &Settings, views: usize, scaled: impl Fn(u32) -> u32) -> Self {
        let (run, density) = (&settings.run, &settings.density);
        let until = scaled(density.densify_until);
        let mut interval = density.densify_interval;
        let mut reset_interval = density.opacity_reset_interval;
        let mut reset_until = until.saturating_sub(1);
        if run.scale_schedule {
            // Statistics need every training view once, else the views looked at decide which splats grow. Beyond that,
            // few changes with many steps between are better, because new splats are judged when they have settled.
            let pass = pass_of(views, run.bands);
            let longest = interval.max(pass.min(LONGEST_PASS.saturating_mul(run.bands.max(1))));
            interval = scaled(interval).max(pass).max(run.iterations / MOST_INTERVALS).min(longest);
            if reset_interval > 0 {
                reset_interval = scaled(reset_interval).max(SHORTEST_RESET_INTERVAL);
            }
            reset_until = until.saturating_sub(RESET_RECOVERY).min(reset_until);
        }
        Self { until, interval: interval.max(1), reset_interval, reset_until }
    }

    /// The share by which a relocation grows the set: that of as many published relocations as would happen in the same
    /// share of the run.
    fn share(&self, density: &Density, scale: f64) -> f64 {
        let published = f64::from(density.densify_interval.max(1)) * scale;
        (1.0 + density.relocate_growth).powf(f64::from(self.interval) / published) - 1.0
    }
}

/// The alpha below which splats are skipped in early steps. In a run that is made longer, early steps may come again;
/// only the time of those steps changes.
#[derive(Clone, Copy, Debug, PartialEq)]
struct EarlyCutoff {
    /// Last step with this cutoff.
    until: u32,
    /// 1 / alpha.
    cutoff: u32,
}

/// A term of the loss that every `steps`-th step has, after the low-frequency stage.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Every {
    /// 0: no step has the term.
    steps: u32,
}

impl Every {
    fn new(steps: u32, wanted: bool) -> Self {
        Self { steps: if wanted { steps.max(1) } else { 0 } }
    }

    /// Factor of the term's weight at step `t`: a step with the term carries the weight of the steps between.
    fn at(self, t: u32, after: u32) -> Option<f64> {
        (self.steps > 0 && t > after && t.is_multiple_of(self.steps)).then_some(f64::from(self.steps))
    }
}

/// Purpose of a random number: streams of one seed are independent.
#[derive(Clone, Copy)]
pub(super) enum Stream {
    Views = 1,
    Background = 2,
    /// Positions in a photograph.
    Places = 3,
    /// Places of dead splats.
    Relocations = 4,
    /// Places of splats that are added.
    Growth = 5,
}

/// The random number of (stream, major, minor): the 64-bit finaliser of SplitMix (Steele, Lea, Flood 2014) over each
/// part in turn.
pub(super) fn draw(seed: u64, stream: Stream, major: u64, minor: u64) -> u64 {
    [stream as u64, major, minor].into_iter().fold(hash(seed), |state, part| hash(state ^ hash(part)))
}

/// Maps 64 random bits to 0..n; the bias is below n / 2^64.
fn bounded(bits: u64, n: usize) -> usize {
    ((u128::from(bits) * n as u128) >> 64) as usize
}
