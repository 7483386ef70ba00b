//! Chooses the variants of the passes for a training by timing at the start: the fastest for the scene of those that
//! settings and device allow. Also estimates the time of a training.
//!
//! A separate engine takes the timed steps, and is dropped before the engine of the training is made. A choice by
//! timing is not reproducible, so deterministic training makes none.

mod cache;
mod choice;
mod estimate;

pub use cache::SizeClass;
pub use choice::chosen_variants;
pub use estimate::Estimate;

use std::fmt;
use std::path::Path;

use super::engine::Engine;
use super::input::{Input, OptionalInput};
use super::pacing::Pacing;
use super::schedule::{Adam, Band, Event, Schedule, StepPlan};
use super::settings::{BlendingVariants, Settings, Tune};
use super::{Error, memory};
use crate::pass::counters;
use crate::raster::Variants;
use crate::vk::{DeviceKind, Gpu};

/// Views that are timed, spread over the training views.
const VIEWS: usize = 2;
/// Timed steps of each view, after one that is not counted.
const ROUNDS: usize = 3;
/// Variants other than the default are chosen if they take at most this share of the default's time.
const WORTH_IT: f64 = 0.9;
/// A variant whose first step takes this many times the best median so far is not timed further.
const HOPELESS: f64 = 1.5;
/// A tile shape whose first variant takes this many times the best median so far is not timed with other variants,
/// which differ less.
const HOPELESS_TILES: f64 = 3.0;
/// Fewest steps of a training that is worth timing for.
const FEWEST_STEPS: u32 = 1000;

/// How the variants were chosen.
#[derive(Clone, Debug, PartialEq)]
pub enum ChoiceReason {
    /// By the device's capabilities; timing was not possible or not wanted for the reason given.
    Capability(&'static str),
    /// By an earlier timing, kept on disk.
    Kept,
    /// By timing: seconds of a forward and backward of each variant.
    Timed(Vec<(Variants, f64)>),
}

/// The variants of the passes, and how they were chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct Tuned {
    /// The variants.
    pub variants: Variants,
    /// How the variants were chosen.
    pub why: ChoiceReason,
    /// A problem with the file of earlier timings.
    pub warning: Option<String>,
}

/// The variants for a training: those that the settings name, else those of an earlier timing in the folder `kept`,
/// else the fastest by timing. Variants other than the default of the device have to be a tenth faster.
pub fn tuned(gpu: &Gpu, input: &Input, settings: &Settings, kept: Option<&Path>) -> Result<Tuned, Error> {
    let default = chosen_variants(gpu, settings)?;
    let by_capability = |why: &'static str| -> Result<Tuned, Error> {
        Ok(Tuned { variants: default, why: ChoiceReason::Capability(why), warning: None })
    };
    if settings.run.deterministic {
        return by_capability("`deterministic`");
    }
    if settings.run.tune == Tune::Off {
        return by_capability("`tune` is off");
    }
    let candidates = candidates(gpu, settings, default);
    if candidates.len() < 2 && other_lists(gpu, settings, default).is_empty() {
        return by_capability("no other variant is possible");
    }
    if input.train.is_empty() || gpu.caps().limits.timestamp_ns <= 0.0 {
        return by_capability("nothing can be timed");
    }
    let class = SizeClass::of(input, settings.run.bands);
    let mut warning = None;
    if let (Tune::Auto, Some(folder)) = (settings.run.tune, kept) {
        match cache::find(folder, gpu.caps(), class) {
            Ok(Some(variants))
                if candidates.contains(&variants)
                    || candidates.iter().any(|&of| other_lists(gpu, settings, of).contains(&variants)) =>
            {
                return Ok(Tuned { variants, why: ChoiceReason::Kept, warning: None });
            }
            Ok(_) => {}
            Err(problem) => warning = Some(format!("{problem}; the file is ignored and written anew")),
        }
    }
    if settings.run.tune == Tune::Auto && settings.run.iterations < FEWEST_STEPS {
        return Ok(Tuned {
            warning,
            ..by_capability("the training is too short to time variants; `tune` again times them")?
        });
    }
    let mut times = measure(gpu, input, settings, &candidates)?;
    let best = faster(default, &times);
    // Lists change every candidate's time alike, so only the best tries them.
    let others = other_lists(gpu, settings, best);
    times.extend(measure(gpu, input, settings, &others)?);
    let variants = faster(best, &times);
    // If the settings name a variant, the choice is not among all variants and is not kept.
    let (blending, stepping) = (&settings.blending, &settings.stepping);
    let free = *blending == BlendingVariants::default() && stepping.gradient_sum.is_none();
    if let (Some(folder), true) = (kept, free)
        && let Err(problem) = cache::keep(folder, gpu.caps(), class, variants)
    {
        warning = Some(format!("the chosen variants could not be kept: {problem}"));
    }
    Ok(Tuned { variants, why: ChoiceReason::Timed(times), warning })
}

/// The variants to time: all that the device can run and the settings allow, the default first.
fn candidates(gpu: &Gpu, settings: &Settings, default: Variants) -> Vec<Variants> {
    let mut all = vec![default];
    for possible in Variants::possible(gpu) {
        let mut asked = settings.clone();
        asked.blending.tile_shape = asked.blending.tile_shape.or(Some(possible.tile));
        asked.stepping.gradient_sum = asked.stepping.gradient_sum.or(Some(possible.gradients));
        if chosen_variants(gpu, &asked).ok() == Some(possible) && !all.contains(&possible) {
            all.push(possible);
        }
    }
    all
}

/// The variants that differ from these in one property of their lists, as far as the settings and the device allow.
fn other_lists(gpu: &Gpu, settings: &Settings, variants: Variants) -> Vec<Variants> {
    let allowed = |other: &Variants| {
        let mut asked = settings.clone();
        asked.blending.tile_shape = Some(variants.tile);
        asked.blending.chunks = asked.blending.chunks.or(Some(other.chunks));
        asked.stepping.gradient_sum = Some(variants.gradients);
        // On CPU devices lists are sorted in tiles only if a user asks.
        if gpu.caps().kind != DeviceKind::Cpu {
            asked.blending.list_sort = asked.blending.list_sort.or(Some(other.lists));
        }
        chosen_variants(gpu, &asked).ok() == Some(*other)
    };
    variants.with_other_lists().into_iter().filter(allowed).collect()
}

/// Seconds of a forward and backward of each variant: medians, summed over the views. A variant whose first step is far
/// slower than another variant gets the time of that step. A variant that does not fit the memory is left out.
pub fn measure(
    gpu: &Gpu,
    input: &Input,
    settings: &Settings,
    candidates: &[Variants],
) -> Result<Vec<(Variants, f64)>, Error> {
    let input = thinned(input);
    let mut times: Vec<(Variants, f64)> = Vec::new();
    let mut hopeless = Vec::new();
    for &variants in candidates {
        if hopeless.contains(&variants.tile) {
            continue;
        }
        let best = times.iter().map(|t| t.1).fold(f64::INFINITY, f64::min);
        match time_variants(gpu, &input, settings, variants, best, ROUNDS) {
            Ok(seconds) => {
                if seconds > HOPELESS_TILES * best {
                    hopeless.push(variants.tile);
                }
                times.push((variants, seconds));
            }
            Err(error) if memory::is_lack_of_memory(&error) && !times.is_empty() => {}
            Err(error) => return Err(error),
        }
    }
    Ok(times)
}

/// The input with two views, spread over the training views.
fn thinned(input: &Input) -> Input {
    let all = input.train.len();
    let views = all.min(VIEWS);
    let train = (0..views).map(|k| input.train[(2 * k + 1) * all / (2 * views)].clone()).collect();
    Input {
        train,
        held_out: Vec::new(),
        initial: input.initial.clone(),
        extent: input.extent,
        optional: OptionalInput::default(),
    }
}

/// Seconds of a forward and backward: the mean over two views, each looked at twice.
fn seconds_per_step(gpu: &Gpu, input: &Input, settings: &Settings, variants: Variants) -> Result<f64, Error> {
    let input = thinned(input);
    let seconds = time_variants(gpu, &input, settings, variants, f64::INFINITY, 1)?;
    Ok(seconds / input.train.len().max(1) as f64)
}

fn time_variants(
    gpu: &Gpu,
    input: &Input,
    settings: &Settings,
    variants: Variants,
    best: f64,
    rounds: usize,
) -> Result<f64, Error> {
    let mut engine = Engine::new(gpu, input, settings, variants, Pacing::default(), None)?;
    let views = input.train.len();
    let plan = timed(&Schedule::new(settings, views), settings);
    let mut samples = vec![Vec::new(); views];
    let mut uncounted = 0.0;
    for round in 0..=rounds {
        for (view, samples) in samples.iter_mut().enumerate() {
            let seconds = step(gpu, &mut engine, &plan, view)?;
            if round > 0 {
                samples.push(seconds);
            } else {
                uncounted += seconds;
            }
        }
        let first: f64 = samples.iter().filter_map(|s| s.first()).sum();
        if round == 1 && first > HOPELESS * best {
            break;
        }
        // The uncounted steps also grow buffers and fill caches, but that takes less than several steps.
        if round == 0 && uncounted > 2.0 * HOPELESS_TILES * best {
            return Ok(uncounted);
        }
    }
    Ok(samples.into_iter().map(median).sum())
}

/// The step that is timed: all harmonics in use, photographs at full size or a middle band, and the alpha cutoff of
/// most steps. The model does not change, so all variants work on the same model.
fn timed(schedule: &Schedule, settings: &Settings) -> StepPlan {
    let of = settings.run.bands;
    let band = (of > 1).then_some(Band { index: of / 2, of });
    let alpha_cutoff = schedule.step(schedule.iterations / 2).alpha_cutoff;
    StepPlan {
        sh_degree: settings.model.sh_degree,
        adam: Adam::None,
        factor: 1,
        band,
        alpha_cutoff,
        ..schedule.step(1)
    }
}

/// Seconds that the device worked on a step.
fn step(gpu: &Gpu, engine: &mut Engine, plan: &StepPlan, view: usize) -> Result<f64, Error> {
    loop {
        let mut recorder = gpu.recorder("tune")?;
        recorder.profile(true);
        engine.record(&mut recorder, Event::of_step(1), plan, view)?;
        let ticket = engine.submit_recorded(recorder)?;
        let outcome = engine.outcome(ticket)?;
        if outcome.counters[counters::STATUS] != 0 {
            engine.grow()?;
            continue;
        }
        let passes = gpu.timings(ticket)?.unwrap_or_default();
        return Ok(passes.iter().map(|p| p.ns).sum::<f64>() * 1e-9);
    }
}

fn median(mut samples: Vec<f64>) -> f64 {
    samples.sort_by(f64::total_cmp);
    samples.get(samples.len() / 2).copied().unwrap_or(f64::INFINITY)
}

/// The default, unless other variants are a tenth faster.
fn faster(default: Variants, times: &[(Variants, f64)]) -> Variants {
    let of_default = times.iter().find(|t| t.0 == default).map_or(f64::INFINITY, |t| t.1);
    match times.iter().min_by(|a, b| a.1.total_cmp(&b.1)) {
        Some(&(best, seconds)) if seconds <= WORTH_IT * of_default => best,
        _ => default,
    }
}

impl Tuned {
    /// Whether the variants follow from the device's capabilities, and nothing was timed.
    pub fn is_by_capability(&self) -> bool {
        matches!(self.why, ChoiceReason::Capability(_))
    }
}

impl fmt::Display for Tuned {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "variants of the passes: {}", self.variants)?;
        match &self.why {
            ChoiceReason::Capability(why) => write!(f, " (by the device's capabilities: {why})"),
            ChoiceReason::Kept => {
                write!(f, " (the fastest of an earlier timing; `tune` again times anew, `tune` off takes none)")
            }
            ChoiceReason::Timed(times) => {
                let each = times.iter().map(|(v, s)| format!("{v} {:.2} ms", 1e3 * s));
                write!(f, " (timed: {})", each.collect::<Vec<_>>().join("; "))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::{GradientSum, TileShape};

    /// A method may begin with photographs of a sixteenth of the pixels; variants that are fast for them need not be
    /// fast later.
    #[test]
    fn photographs_are_timed_at_full_size() {
        let settings = Settings::of_method(crate::train::settings::Method::Lean);
        let schedule = Schedule::new(&settings, 10);
        assert!(schedule.step(1).factor > 1);
        let plan = timed(&schedule, &settings);
        assert_eq!((plan.factor, plan.sh_degree, plan.band), (1, settings.model.sh_degree, None));
    }

    /// Else the estimated time of a training would be several times too long.
    #[test]
    fn a_band_is_timed_if_steps_look_at_bands() {
        let mut settings = Settings::of_method(crate::train::settings::Method::Lean);
        settings.run.bands = 3;
        let plan = timed(&Schedule::new(&settings, 10), &settings);
        assert_eq!(plan.band, Some(Band { index: 1, of: 3 }));
    }

    #[test]
    fn the_timed_step_has_the_alpha_cutoff_of_most_steps() {
        let mut settings = Settings::default();
        settings.density.opacity_reset_interval = 0;
        for (share, cutoff) in [(0.0, None), (0.3, None), (0.7, Some(64))] {
            (settings.shortcuts.early_steps, settings.shortcuts.early_cutoff) = (share, 64);
            assert_eq!(timed(&Schedule::new(&settings, 10), &settings).alpha_cutoff, cutoff, "{share}");
        }
    }

    #[test]
    fn other_variants_have_to_be_a_tenth_faster() {
        let of = |tile, gradients| {
            let text = format!(r#"{{"tile":"{tile}","gradients":"{gradients}"}}"#);
            serde_json::from_str::<Variants>(&text).unwrap()
        };
        let [a, b, c] = [of("column", "slots"), of("pixel", "slots"), of("column", "atomic")];
        assert_eq!((a.tile, b.gradients), (TileShape::Column, GradientSum::Slots));
        assert_eq!(faster(a, &[(a, 1.0), (b, 0.95), (c, 0.91)]), a);
        assert_eq!(faster(a, &[(a, 1.0), (b, 0.89), (c, 0.91)]), b);
        assert_eq!(faster(a, &[(a, 1.0), (b, 0.89), (c, 0.5)]), c);
        assert_eq!(faster(a, &[(a, 1.0)]), a);
        assert_eq!(faster(a, &[]), a);
        assert_eq!(faster(a, &[(b, 2.0)]), b, "the default does not fit the memory");
        assert_eq!(median(vec![3.0, 1.0, 2.0]), 2.0);
    }
}
