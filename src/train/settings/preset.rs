//! Presets: resolution, steps and schedule.

use std::fmt;
use std::str::FromStr;

use super::Settings;
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

impl Preset {
    /// The preset of a device where the user names none.
    pub fn for_device(kind: DeviceKind) -> Self {
        if kind == DeviceKind::Cpu { Self::Quick } else { Self::Standard }
    }

    /// Sets the preset's values for keys that are not `named`. An `automatic` preset does not scale the schedule if the
    /// user names the number of steps.
    pub fn apply(self, settings: &mut Settings, automatic: bool, named: impl Fn(&str) -> bool) {
        let (side, steps, scaled) = match self {
            Self::Quick => (640, 2000, true),
            Self::Standard => (1600, 30_000, false),
            Self::Full => (FULL_SIDE, 30_000, false),
        };
        if !named("max-side") {
            settings.photographs.max_side = side;
        }
        let steps_are_own = automatic && named("iterations");
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

    #[test]
    fn a_device_without_a_gpu_is_spared() {
        assert_eq!(Preset::for_device(DeviceKind::Cpu), Preset::Quick);
        for kind in [DeviceKind::Discrete, DeviceKind::Integrated, DeviceKind::Virtual, DeviceKind::Other] {
            assert_eq!(Preset::for_device(kind), Preset::Standard);
        }
    }
}
