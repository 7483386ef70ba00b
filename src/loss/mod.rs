//! Losses composed of passes: colours, gradient maps, and depth and normals against a prior. None knows of training:
//! what a step makes of them is said in `train::terms`.
//!
//! Each owns the buffers between its passes and leaves its value on the device. [`PhotometricLoss`] writes the gradient
//! of the image anew; the others add to a gradient that is there already.

mod geometry;
mod gradient_maps;
mod photometric;

pub use geometry::{Edges, GeometryLoss, GeometryWeights, PackedPrior, Prior, Rendered};
pub use gradient_maps::{GradientMapLoss, GradientMapWeights};
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
    /// Channels times pixels that are not masked: see [`crate::pass::loss::values`]. Means are taken over these; of a
    /// part of a photograph, they are those of the whole.
    pub values: f32,
    /// The part's share in them.
    pub part_values: f32,
    /// Where its texture is, if that is to matter.
    pub mask: Option<Mask<'a>>,
}

/// A mask of bytes on the device, row after row without padding, 255 standing for 1. It covers a photograph,
/// at a size of its own.
#[derive(Clone, Copy)]
pub struct Mask<'a> {
    /// A whole number of words.
    pub buffer: &'a Buffer,
    /// Width and height in pixels.
    pub size: (u32, u32),
}

impl<'a> Photograph<'a> {
    /// The mask's buffer to bind and its size to tell. The photograph stands for a mask that is not there,
    /// and is not read as one.
    fn mask_to_bind(&self) -> (&'a Buffer, (u32, u32)) {
        self.mask.map_or((self.buffer, (0, 0)), |mask| (mask.buffer, mask.size))
    }
}

/// Records adding `count` rows of four floats up to the only row of `sum`.
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
