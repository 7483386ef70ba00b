//! Losses composed of passes: colours, gradient maps, and depth and normals against a prior. No loss depends on
//! training; `train::terms` combines the losses of a step.
//!
//! Each loss owns the buffers between its passes and leaves its value on the device. [`PhotometricLoss`] overwrites the
//! gradient of the image; the other losses add to the gradient.

mod geometry;
mod gradient_maps;
mod photometric;

pub use geometry::{Edges, GeometryLoss, GeometryWeights, PackedPrior, Prior, Rendered};
pub use gradient_maps::{GradientMapLoss, GradientMapWeights, MapImages};
pub use photometric::{PhotometricLoss, PixelWeights};

use crate::pass::part_sum;
use crate::vk::{self, Buffer, Gpu, Groups, Pipeline, Recorder};

/// A photograph on the device, or a part of one.
#[derive(Clone, Copy)]
pub struct Photograph<'a> {
    /// RGBA, a word per pixel with 8 bits per channel, two with 16; a pixel with alpha 0 is masked.
    pub buffer: &'a Buffer,
    /// Bits per channel, 8 or 16.
    pub bits: u32,
    /// Width and height in pixels.
    pub size: (u32, u32),
    /// Number of values (channels times unmasked pixels) of the whole photograph, over which means are taken: see
    /// [`crate::pass::loss::values`].
    pub values: f32,
    /// Number of values of the part in `buffer`; equal to `values` for a whole photograph.
    pub part_values: f32,
    /// The photograph's texture, where the losses take texture into account.
    pub mask: Option<TextureMask<'a>>,
}

/// A texture mask on the device: bytes, row after row without padding, 255 standing for 1. The mask covers the whole
/// photograph at its own resolution.
#[derive(Clone, Copy)]
pub struct TextureMask<'a> {
    /// The mask's bytes, padded at the end to a whole number of 32-bit words.
    pub buffer: &'a Buffer,
    /// Width and height in pixels.
    pub size: (u32, u32),
}

impl<'a> Photograph<'a> {
    /// The mask's buffer and size. Without a mask, the photograph's buffer, which is bound but not read, and size 0.
    fn mask_to_bind(&self) -> (&'a Buffer, (u32, u32)) {
        self.mask.map_or((self.buffer, (0, 0)), |mask| (mask.buffer, mask.size))
    }
}

/// Records the sum of `count` rows of four floats into the single row of `sum`.
fn record_sum(
    recorder: &mut Recorder,
    pipeline: &Pipeline,
    [parts, sum]: [&Buffer; 2],
    count: u32,
) -> Result<(), vk::Error> {
    let push = part_sum::Push { count, slot: 0 };
    recorder.dispatch(pipeline, &[parts, sum], &push, Groups::Workgroups(1))
}

fn sum_pipeline(gpu: &Gpu) -> Result<Pipeline, vk::Error> {
    gpu.pipeline(&part_sum::PASS.kernel, &[])
}
