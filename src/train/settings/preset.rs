//! Presets: resolution, steps and schedule; and steps by need.

use std::fmt;
use std::str::FromStr;

use super::method::STEPS_OF_THE_SCHEDULE;
use super::{Run, Settings};
use crate::numbers::{counted, steps_and_looks};
use crate::vk::DeviceKind;

/// Resolution, steps and schedule under one name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// 640 pixels, 2,000 steps with a scaled schedule: minutes to an hour without a GPU.
    Quick,
    /// 1,600 pixels and the published 30,000 steps, for comparisons of methods. The defaults of every option.
    Standard,
    /// Photographs at their full size, 30,000 steps.
    Full,
}

/// Longer than the side of any photograph.
const FULL_SIDE: u32 = 1 << 16;
/// Steps of [`Preset::Quick`], and the most that are chosen by need on a CPU.
const QUICK_STEPS: u32 = 2000;

/// Looks at each photograph that a model needs.
pub(super) const LOOKS: u32 = 150;
/// Fewest and most steps by need.
const BY_NEED: (u32, u32) = (2000, 30_000);

/// The steps that come to `looks` at each photograph.
fn needed(looks: u32, photographs: usize) -> u32 {
    let steps = u64::from(looks).saturating_mul(photographs as u64);
    steps.clamp(BY_NEED.0.into(), BY_NEED.1.into()) as u32
}

/// A number of steps that was chosen by what there is to look at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepsByNeed {
    /// The steps that were chosen.
    pub steps: u32,
    /// The steps without the limits of the settings and of the device.
    pub needed: u32,
    /// Photographs to train on.
    pub photographs: usize,
    /// Whether fewer were chosen than are needed because the device is a CPU.
    pub spares_cpu: bool,
}

impl fmt::Display for StepsByNeed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { steps, needed, photographs, spares_cpu } = *self;
        if steps >= needed {
            return f.write_str(&steps_and_looks(steps, photographs));
        }
        let why = if spares_cpu { "quick takes on a CPU" } else { "the settings allow" };
        let each = steps_and_looks(needed, photographs);
        let each = each.split_once(": ").map_or("", |(_, each)| each);
        write!(f, "{}, as many as {why}; `iterations` {needed} would be {each}", counted(steps, "step"))
    }
}

impl Settings {
    /// Chooses the number of steps where `looks` leaves that to the photographs: sets `iterations`, scales the schedule
    /// and unsets `looks`, so that the settings name the steps from then on. [`crate::train::prepare::Setup`] calls
    /// this; call it yourself where the training is prepared in another way. `photographs` is the number of those to
    /// train on.
    pub fn choose_steps(&mut self, photographs: usize, device: DeviceKind) -> Option<StepsByNeed> {
        let looks = self.run.looks.take()?;
        let needed = needed(looks.saturating_mul(self.run.bands), photographs);
        let allowed = self.run.iterations;
        let spares_cpu = device == DeviceKind::Cpu && QUICK_STEPS <= allowed && QUICK_STEPS < needed;
        let steps = needed.min(if spares_cpu { QUICK_STEPS } else { allowed });
        self.run.iterations = steps;
        self.run.scale_schedule |= steps < Run::default().iterations;
        Some(StepsByNeed { steps, needed, photographs, spares_cpu })
    }

    /// Takes `steps` steps, for a training of some of the photographs. The schedule of a whole training of all
    /// published steps is scaled to them; that of a shorter one stays as it is, scaled or cut off.
    pub fn shorten_to(&mut self, steps: u32) {
        let whole = self.run.iterations >= Run::default().iterations;
        self.run.scale_schedule |= whole && steps < self.run.iterations;
        self.run.iterations = steps;
    }
}

impl Preset {
    /// The preset of a device where the user names none.
    pub fn for_device(kind: DeviceKind) -> Self {
        if kind == DeviceKind::Cpu { Self::Quick } else { Self::Standard }
    }

    /// Sets the preset's values for keys that are not `named`. An `automatic` preset does not scale the schedule if the
    /// user names the number of steps or a step of the schedule.
    pub fn apply(self, settings: &mut Settings, automatic: bool, named: impl Fn(&str) -> bool) {
        let (side, steps, scaled) = match self {
            Self::Quick => (640, QUICK_STEPS, true),
            Self::Standard => (1600, 30_000, false),
            Self::Full => (FULL_SIDE, 30_000, false),
        };
        if !named("max-side") {
            settings.photographs.max_side = side;
        }
        let steps_are_own = automatic && (named("iterations") || STEPS_OF_THE_SCHEDULE.into_iter().any(&named));
        if !steps_are_own && !named("scale-schedule") {
            settings.run.scale_schedule = scaled;
        }
        if !named("iterations") {
            settings.run.iterations = steps;
        }
        settings.run.preset = Some(self);
    }
}

impl fmt::Display for Preset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Quick => "quick",
            Self::Standard => "standard",
            Self::Full => "full",
        })
    }
}

impl FromStr for Preset {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        match word {
            "quick" => Ok(Self::Quick),
            "standard" => Ok(Self::Standard),
            "full" => Ok(Self::Full),
            _ => Err(format!("no preset `{word}`: it is quick, standard or full")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(preset: Preset, automatic: bool, named: &[&str]) -> (u32, u32, bool) {
        let mut settings = Settings::default();
        settings.photographs.max_side = 777;
        settings.run.iterations = 55;
        preset.apply(&mut settings, automatic, |key| named.contains(&key));
        assert_eq!(settings.run.preset, Some(preset));
        (settings.photographs.max_side, settings.run.iterations, settings.run.scale_schedule)
    }

    #[test]
    fn what_is_named_wins_over_a_preset() {
        assert_eq!(with(Preset::Quick, false, &[]), (640, 2000, true));
        assert_eq!(with(Preset::Standard, false, &[]), (1600, 30_000, false));
        assert_eq!(with(Preset::Full, false, &[]), (FULL_SIDE, 30_000, false));
        assert_eq!(with(Preset::Quick, false, &["max-side"]), (777, 2000, true));
        assert_eq!(with(Preset::Quick, false, &["iterations"]), (640, 55, true));
        assert_eq!(with(Preset::Quick, false, &["scale-schedule"]), (640, 2000, false));
        assert_eq!(with(Preset::Quick, true, &["iterations"]), (640, 55, false));
        assert_eq!(with(Preset::Quick, true, &[]), (640, 2000, true));
        assert_eq!(with(Preset::Quick, true, &["densify-until"]), (640, 2000, false));
        assert_eq!(with(Preset::Quick, false, &["densify-until"]), (640, 2000, true));
    }

    #[test]
    fn the_schedule_of_all_published_steps_is_scaled_to_a_part() {
        for (whole, scaled, part_scaled) in
            [(30_000, false, true), (40_000, false, true), (7000, false, false), (7000, true, true)]
        {
            let mut part = Settings::default();
            (part.run.iterations, part.run.scale_schedule) = (whole, scaled);
            part.shorten_to(900);
            assert_eq!((part.run.iterations, part.run.scale_schedule), (900, part_scaled), "{whole}");
        }
        let mut same = Settings::default();
        same.shorten_to(30_000);
        assert_eq!(same, Settings::default());
    }

    /// The printed defaults of the options are those of the standard preset.
    #[test]
    fn standard_is_the_defaults() {
        let mut settings = Settings::default();
        Preset::Standard.apply(&mut settings, false, |_| false);
        assert_eq!(
            settings,
            Settings {
                run: super::super::Run { preset: Some(Preset::Standard), ..Default::default() },
                ..Settings::default()
            }
        );
    }

    fn steps(looks: u32, photographs: usize, iterations: u32, device: DeviceKind) -> (u32, String) {
        let mut settings = Settings::default();
        (settings.run.looks, settings.run.iterations) = (Some(looks), iterations);
        let chosen = settings.choose_steps(photographs, device).unwrap();
        assert_eq!((settings.run.iterations, settings.run.looks), (chosen.steps, None));
        assert_eq!(settings.run.scale_schedule, chosen.steps < 30_000);
        // What was chosen stays, also with more photographs.
        let before = settings.clone();
        assert_eq!(settings.choose_steps(500, device), None);
        assert_eq!(settings, before);
        (chosen.steps, chosen.to_string())
    }

    #[test]
    fn steps_come_to_so_many_looks_within_limits() {
        let of = |photographs| steps(150, photographs, 30_000, DeviceKind::Discrete);
        assert_eq!(of(28), (4200, "4,200 steps: 28 photographs, 150 looks each".into()));
        assert_eq!(of(1), (2000, "2,000 steps: 1 photograph, 2,000 looks each".into()));
        assert_eq!(of(13), (2000, "2,000 steps: 13 photographs, 154 looks each".into()));
        assert_eq!(of(14), (2100, "2,100 steps: 14 photographs, 150 looks each".into()));
        assert_eq!(of(200), (30_000, "30,000 steps: 200 photographs, 150 looks each".into()));
        assert_eq!(of(1000), (30_000, "30,000 steps: 1,000 photographs, 30 looks each".into()));
        assert_eq!(steps(40, 100, 30_000, DeviceKind::Integrated).0, 4000);
        assert_eq!(steps(u32::MAX, 9, 30_000, DeviceKind::Other).0, 30_000);
    }

    #[test]
    fn steps_by_need_are_limited_and_say_by_what() {
        let on_cpu = |photographs, iterations| steps(150, photographs, iterations, DeviceKind::Cpu);
        let spared =
            "2,000 steps, as many as quick takes on a CPU; `iterations` 4200 would be 28 photographs, 150 looks each";
        assert_eq!(on_cpu(28, 30_000), (2000, spared.into()));
        assert_eq!(on_cpu(28, 2000), (2000, spared.into()), "the preset of a CPU limits too");
        assert_eq!(on_cpu(9, 30_000), (2000, "2,000 steps: 9 photographs, 222 looks each".into()));
        let allowed =
            "500 steps, as many as the settings allow; `iterations` 4200 would be 28 photographs, 150 looks each";
        assert_eq!(on_cpu(28, 500), (500, allowed.into()));
        assert_eq!(steps(150, 28, 500, DeviceKind::Discrete), (500, allowed.into()));
    }

    #[test]
    fn a_look_at_bands_takes_several_steps() {
        let mut settings = Settings::default();
        (settings.run.looks, settings.run.bands) = (Some(100), 3);
        assert_eq!(settings.choose_steps(10, DeviceKind::Other).unwrap().steps, 3000);
    }

    #[test]
    fn a_device_without_a_gpu_is_spared() {
        assert_eq!(Preset::for_device(DeviceKind::Cpu), Preset::Quick);
        for kind in [DeviceKind::Discrete, DeviceKind::Integrated, DeviceKind::Virtual, DeviceKind::Other] {
            assert_eq!(Preset::for_device(kind), Preset::Standard);
        }
    }
}
