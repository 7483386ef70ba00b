//! Estimates the time of a training before it begins.

use std::fmt;

use super::seconds_per_step;
use crate::numbers::counted;
use crate::raster::Variants;
use crate::train::Error;
use crate::train::input::Input;
use crate::train::settings::Settings;
use crate::vk::Gpu;

/// Time of a training at the speed of its first splats.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Estimate {
    /// Steps to take.
    pub steps: u32,
    /// Number of first splats, with which steps were timed.
    pub splats: usize,
    /// Seconds of device time of a step: the mean over two views.
    pub seconds_per_step: f64,
    /// Whether the number of splats grows, which makes steps slower.
    pub grows: bool,
}

impl Estimate {
    /// Times two views of `input` on this device, with an engine that is dropped afterwards. `None` if the device has
    /// no timestamps or there are no views.
    pub fn measure(gpu: &Gpu, input: &Input, settings: &Settings, variants: Variants) -> Result<Option<Self>, Error> {
        if gpu.caps().limits.timestamp_ns <= 0.0 || input.train.is_empty() {
            return Ok(None);
        }
        let seconds_per_step = seconds_per_step(gpu, input, settings, variants)?;
        Ok(Some(Self {
            steps: settings.run.iterations,
            splats: input.initial.len(),
            seconds_per_step,
            grows: !settings.density.no_densify,
        }))
    }

    /// Seconds for `steps` steps.
    pub fn seconds(&self, steps: u32) -> f64 {
        self.seconds_per_step * f64::from(steps)
    }
}

impl fmt::Display for Estimate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let each = self.seconds_per_step;
        let each = if each < 1.0 { format!("{:.3} ms", 1e3 * each) } else { format!("{each:.2} s") };
        write!(
            f,
            "{} of {each}, as timed on this device with the {} to begin with",
            counted(self.steps, "step"),
            counted(self.splats, "splat")
        )?;
        if self.grows { f.write_str("; more splats take longer, often several times as long") } else { Ok(()) }
    }
}
