//! Where stereo saves its time: settings that fit a training, and pixels that it leaves out.

use crate::saliency::{self, Cache, Plane};
use crate::stereo::{self, Budget, Scene};
use crate::train::Error;
use crate::train::settings::Settings;

/// What a step of `3dgs` takes, in samples of stereo: so many for each pixel of its photograph, and as many again as for [`STEP_PIXELS`] for
/// what does not depend on pixels. On lavapipe the 1.2 10^9 samples of caliterra's 65 photographs took 4.2 % of 1,500 such steps at
/// 320x240, those of the fox (0.58 10^9) 2.7 %, of copr (0.53 10^9) 2.4 % and of the test world (1.0 10^9) 5.8 %: 76 to 121 in a step.
const STEP_SAMPLES: f64 = 80.0;
const STEP_PIXELS: f64 = 76_800.0;
/// Samples that any training has time for: some seconds of a processor.
const LEAST_SAMPLES: f64 = 1e9;
/// Photographs become smaller down to this share of `--stereo-side` before sweeps, sources and rounds become fewer.
const SMALLER: u32 = 2;

/// How stereo works in a training on photographs of these sizes: as its settings say, or so much cheaper that it takes at most
/// `--stereo-share` of the time of the steps, but for a few seconds.
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

/// Has stereo leave out pixels whose mask value is `--stereo-texture` and more, by masks of the photographs at its own size.
pub(super) fn leave_out_texture(scene: &mut Scene, training: &Settings) -> Result<(), Error> {
    let (from, frequencies) = (training.geometry.stereo_texture, &training.frequencies);
    if from >= 1.0 {
        return Ok(());
    }
    let luma = |view: &stereo::View| Plane::new(view.camera.width, view.camera.height, view.luma.clone());
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
