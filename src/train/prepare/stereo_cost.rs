//! Limits the time of stereo: settings that fit the training, and pixels that are left out.

use crate::saliency::{self, Cache, Plane};
use crate::stereo::{self, Budget, Scene};
use crate::train::Error;
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

/// Leaves pixels out of stereo whose mask value is at least `stereo-texture`, by saliency masks at the size of the
/// matched photographs.
pub(super) fn leave_out_texture(scene: &mut Scene, training: &Settings) -> Result<(), Error> {
    let (from, frequencies) = (training.geometry.stereo_texture, &training.frequencies);
    if from >= 1.0 {
        return Ok(());
    }
    let luma = |view: &stereo::StereoView| Plane::new(view.camera.width, view.camera.height, view.luma.clone());
    let lumas = scene.views.iter().map(luma).collect::<Result<Vec<_>, _>>()?;
    let cache = Cache::new(lumas, frequencies.gate, training.run.seed, &saliency::Settings::default())?;
    cache.prepare(&vec![frequencies.sigma; scene.views.len()])?;
    for (number, view) in scene.views.iter_mut().enumerate() {
        let (saliency, _) = cache.get(number, frequencies.sigma)?;
        let mask = saliency.mask.resized(view.camera.width, view.camera.height);
        let before = view.wanted.take();
        let wanted = |(pixel, value): (usize, &f32)| {
            f64::from(*value) < from && before.as_ref().is_none_or(|w| w.get(pixel).copied().unwrap_or(false))
        };
        view.wanted = Some(mask.values().iter().enumerate().map(wanted).collect());
    }
    Ok(())
}
