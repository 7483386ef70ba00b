//! Convolutions of channels-last images. A thread computes eight output channels of several pixels.

use super::{Pass, module};
use crate::vk::{Kernel, read, read_write};

/// Pixels that a thread owns.
pub const PIXELS: u32 = 4;
/// Output channels that a thread owns.
pub const CHANNELS: u32 = 8;

/// Flag: add to the result buffer instead of overwriting.
pub const FLAG_ADD: u32 = 1;
/// Flag: negative values become 0.
pub const FLAG_RELU: u32 = 2;
/// Flag: the result is 0 where the gate (same layout as the result) is not positive.
pub const FLAG_GATE: u32 = 4;

crate::push_constants! {
    /// Push constants of [`PASS`]. A row is four channels of a pixel.
    pub struct Push {
        /// Width of the source in pixels.
        pub in_width: u32,
        /// Height of the source in pixels.
        pub in_height: u32,
        /// Rows per pixel of the source.
        pub in_row: u32,
        /// First row of a pixel to read.
        pub in_first: u32,
        /// Number of rows of a pixel to read.
        pub in_quads: u32,
        /// Index of an all-zero pixel of the source, read outside of the image.
        pub zero_pixel: u32,
        /// Width of the result in pixels.
        pub out_width: u32,
        /// Height of the result in pixels.
        pub out_height: u32,
        /// Rows per pixel of the result.
        pub out_row: u32,
        /// First row of a pixel to write.
        pub out_first: u32,
        /// Groups of [`CHANNELS`] output channels.
        pub groups: u32,
        /// Number of images, 1 or 2, stored one after the other in source and result.
        pub images: u32,
        /// Taps along a side of the filter.
        pub size: u32,
        /// Step in the source, in pixels, per pixel of the result.
        pub stride: u32,
        /// Pixels of zeros around the source.
        pub pad: u32,
        /// First row of the filters. Order: group, tap (row by row), group of four input channels, channel in the
        /// group, two rows of outputs.
        pub filter_row: u32,
        /// First row of the biases.
        pub bias_row: u32,
        /// Sum of flags.
        pub flags: u32,
    }
}

impl Push {
    /// Threads of a dispatch.
    pub fn threads(&self) -> u64 {
        let pixels = u64::from(self.out_width) * u64::from(self.out_height) * u64::from(self.images);
        pixels.div_ceil(u64::from(PIXELS)) * u64::from(self.groups)
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "convolution",
        spirv: module("convolution"),
        bindings: &[read("source"), read("filters"), read("biases"), read("gate"), read_write("result")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns 8 output channels of 4 pixels; a workgroup owns 64 consecutive threads, pixels first.",
    dispatch: "one thread per 4 pixels and 8 output channels",
    push: Push::FIELDS,
};
