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

    /// Records the gradient of a window about `center` (a share of width and height), times `times`. Photographs with 16 bits per channel, and such as are smaller than the window,
    /// have none.
    pub(in crate::train) fn record(
        &self,
        recorder: &mut Recorder,
        image: &Buffer,
        photograph: &Photograph<'_>,
        (center, times): ([f32; 2], f64),
        grad_image: &Buffer,
    ) -> Result<(), Error> {
        let (side, size) = (self.windows.size().0, photograph.size);
        if photograph.bits != 8 || size.0.min(size.1) < side {
            return Ok(());
        }
        let corner = |center: f32, size: u32| ((center * size as f32) as u32).saturating_sub(side / 2).min(size - side);
        let at = (corner(center[0], size.0), corner(center[1], size.1));
        let pair = Pair { image, photograph: photograph.buffer, size, at };
        let weight = (self.weight * times) as f32;
        self.windows.record(recorder, &pair, Some(&GradientOf { image: grad_image, weight }))?;
        Ok(())
    }

    /// Bytes of its buffers.
    pub(in crate::train) fn bytes(&self) -> u64 {
        self.windows.bytes()
    }
}
