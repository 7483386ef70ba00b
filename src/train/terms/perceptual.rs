//! The perceptual distance of windows of render and photograph.

use super::{LossTerm, Phase, StepContext};
use crate::loss::Photograph;
use crate::perceptual::{Distance, GradientOf, ImagePair, LpipsWeights, Windows};
use crate::raster::MemoryFootprint;
use crate::train::Error;
use crate::train::settings::Texture as Weights;
use crate::vk::{Gpu, Recorder};

/// Most pixels of a window's width and height.
const SIDE: u32 = 128;

/// A network on the device with room for a window.
pub(in crate::train) struct Perceptual {
    windows: Windows,
    weight: f64,
}

/// A square part of a photograph.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::train) struct Window {
    /// First column and row.
    pub(in crate::train) at: (u32, u32),
    /// Width and height in pixels.
    pub(in crate::train) side: u32,
}

impl Perceptual {
    /// Compares by LPIPS with the weights of `network`, else by oriented filters, for photographs of at least `least`
    /// pixels in width and height.
    pub(in crate::train) fn new(
        gpu: &Gpu,
        network: Option<&LpipsWeights>,
        least: u32,
        weights: &Weights,
    ) -> Result<Self, Error> {
        let distance = match network {
            Some(network) => Distance::lpips(gpu, network)?,
            None => Distance::filter_bank(gpu)?,
        };
        let side = least.min(SIDE);
        Ok(Self { windows: distance.windows(side, side, true)?, weight: weights.lambda_perceptual })
    }

    /// The window around the step's `center`. A photograph with 16 bits per channel, or smaller than the window, has
    /// none.
    pub(in crate::train) fn window(&self, step: &StepContext<'_>) -> Option<Window> {
        let (side, size) = (self.windows.size().0, step.photograph.size);
        if step.photograph.bits != 8 || size.0.min(size.1) < side {
            return None;
        }
        let corner = |center: f32, size: u32| ((center * size as f32) as u32).saturating_sub(side / 2).min(size - side);
        let [x, y] = step.center;
        Some(Window { at: (corner(x, size.0), corner(y, size.1)), side })
    }

    /// Records adding the gradient of a window. The step's image and gradient are whole, or those of the window if
    /// `cropped`.
    pub(in crate::train) fn record_window(
        &self,
        recorder: &mut Recorder,
        step: &StepContext<'_>,
        window: Window,
        cropped: bool,
    ) -> Result<(), Error> {
        let Some(planned) = step.plan.perceptual else { return Ok(()) };
        let Photograph { buffer, size, .. } = step.photograph;
        let pair = ImagePair { image: step.shown, photograph: buffer, size, at: window.at, cropped };
        let weight = (self.weight * planned.times) as f32;
        self.windows.record(recorder, &pair, Some(&GradientOf { image: step.grad_image, weight }))?;
        Ok(())
    }
}

impl LossTerm for Perceptual {
    fn phases(&self) -> &'static [Phase] {
        &[Phase::AfterExposure]
    }

    fn due(&self, step: &StepContext<'_>) -> bool {
        step.plan.perceptual.is_some()
    }

    fn record<'a>(&'a self, _: Phase, recorder: &mut Recorder, step: &mut StepContext<'a>) -> Result<(), Error> {
        self.window(step).map_or(Ok(()), |window| self.record_window(recorder, step, window, false))
    }

    fn footprint(&self) -> MemoryFootprint {
        MemoryFootprint { fixed: self.windows.bytes(), ..MemoryFootprint::default() }
    }
}
