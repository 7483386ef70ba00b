//! Limits the time of stereo: settings that fit the training.

use crate::stereo::{self, Budget};
use crate::train::settings::Settings;

/// Time of a step of `3dgs` in samples of stereo: this many for each pixel of the photograph and for [`STEP_PIXELS`]
/// more pixels. Measured on lavapipe against 1,500 steps at 320x240: the 1.2 10^9 samples of caliterra's 65 photographs
/// took 4.2 %, those of the fox (0.58 10^9) 2.7 %, of copr (0.53 10^9) 2.4 % and of the test world (1.0 10^9) 5.8 %.
const STEP_SAMPLES: f64 = 80.0;
/// Pixels that stand for the part of a step's time that does not depend on pixels.
const STEP_PIXELS: f64 = 76_800.0;
/// Samples that every training has time for: a few seconds on a CPU.
const LEAST_SAMPLES: f64 = 1e9;
/// Photographs are reduced down to `stereo-side` / this before sweeps, sources and rounds become fewer.
const SMALLER: u32 = 2;

/// The settings of stereo for a training on photographs of these sizes: those of the training, or cheaper ones with
/// which stereo takes at most `stereo-share` of the time of the steps or a few seconds.
pub fn stereo_settings(training: &Settings, photographs: impl IntoIterator<Item = (u32, u32)>) -> stereo::Settings {
    let settings = training.geometry.stereo();
    let (mut views, mut pixels, mut largest) = (0, 0.0, (0, 0));
    for (width, height) in photographs {
        views += 1;
        pixels += f64::from(width) * f64::from(height);
        largest = if width.max(height) > largest.0.max(largest.1) { (width, height) } else { largest };
    }
    if views == 0 {
        return settings;
    }
    let of_a_step = STEP_SAMPLES * (pixels / views as f64 + STEP_PIXELS);
    let samples = training.geometry.stereo_share * f64::from(training.run.iterations) * of_a_step;
    let budget = Budget { samples: samples.max(LEAST_SAMPLES) };
    budget.fitting(&settings, settings.max_side / SMALLER, views, largest.0, largest.1)
}
