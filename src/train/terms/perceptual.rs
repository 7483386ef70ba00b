//! The perceptual distance of windows of render and photograph.

use crate::losses::Photograph;
use crate::perceptual::{Distance, GradientOf, LpipsWeights, Pair, Windows};
use crate::train::Error;
use crate::train::settings::Texture as Weights;
use crate::vk::{Buffer, Gpu, Recorder};

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
    /// By the weights of LPIPS, or by oriented filters where there are none. Windows are square, `side` pixels wide.
    pub(in crate::train) fn new(
        gpu: &Gpu,
        network: Option<&LpipsWeights>,
        side: u32,
        weights: &Weights,
    ) -> Result<Self, Error> {
        let distance = match network {
            Some(network) => Distance::lpips(gpu, network)?,
            None => Distance::filter_bank(gpu)?,
        };
        Ok(Self { windows: distance.windows(side, side, true)?, weight: weights.lambda_perceptual })
    }

    /// The window about `center` (a share of width and height) of a photograph. One with 16 bits per channel, or smaller than the window,
    /// has none.
    pub(in crate::train) fn window(&self, photograph: &Photograph<'_>, center: [f32; 2]) -> Option<Window> {
        let (side, size) = (self.windows.size().0, photograph.size);
        if photograph.bits != 8 || size.0.min(size.1) < side {
            return None;
        }
        let corner = |center: f32, size: u32| ((center * size as f32) as u32).saturating_sub(side / 2).min(size - side);
        Some(Window { at: (corner(center[0], size.0), corner(center[1], size.1)), side })
    }

    /// Records adding the gradient of a window, times `times`. Image and gradient are whole, or of the window alone where `cropped`.
    pub(in crate::train) fn record(
        &self,
        recorder: &mut Recorder,
        (image, grad_image): (&Buffer, &Buffer),
        photograph: &Photograph<'_>,
        (window, cropped): (Window, bool),
        times: f64,
    ) -> Result<(), Error> {
        let pair = Pair { image, photograph: photograph.buffer, size: photograph.size, at: window.at, cropped };
        let weight = (self.weight * times) as f32;
        self.windows.record(recorder, &pair, Some(&GradientOf { image: grad_image, weight }))?;
        Ok(())
    }

    /// Bytes of its buffers.
    pub(in crate::train) fn bytes(&self) -> u64 {
        self.windows.bytes()
    }
}
