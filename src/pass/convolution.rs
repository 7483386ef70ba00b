//! Convolutions of channels-last images: eight output channels at a time, for several pixels.

use super::{Pass, module};
use crate::vk::{Kernel, read, read_write};

/// Pixels that a thread owns.
pub const PIXELS: u32 = 4;
/// Output channels that a thread owns.
pub const CHANNELS: u32 = 8;

/// Flag: the result is added to what is there.
pub const FLAG_ADD: u32 = 1;
/// Flag: negative values become 0.
pub const FLAG_RELU: u32 = 2;
/// Flag: the result is 0 where the gate, laid out as the result, is not positive.
pub const FLAG_GATE: u32 = 4;

crate::push_constants! {
    /// Push constants of [`PASS`]. A row is four channels of a pixel.
    pub struct Push {
        /// Width of the source in pixels.
        pub in_width: u32,
        /// Height of the source in pixels.
        pub in_height: u32,
        /// Rows of a pixel of the source.
        pub in_row: u32,
        /// The first row of a pixel that is read.
        pub in_first: u32,
        /// How many of its rows are read.
        pub in_quads: u32,
        /// Pixel of the source that is all zeros: what lies outside of the image.
        pub zero_pixel: u32,
        /// Width of the result in pixels.
        pub out_width: u32,
        /// Height of the result in pixels.
        pub out_height: u32,
        /// Rows of a pixel of the result.
        pub out_row: u32,
        /// The first row of a pixel that is written.
        pub out_first: u32,
        /// Groups of [`CHANNELS`] output channels.
        pub groups: u32,
        /// Images, 1 or 2, one after the other in source and result.
        pub images: u32,
        /// Taps along a side.
        pub size: u32,
        /// Pixels of the source from one pixel of the result to the next.
        pub stride: u32,
        /// Pixels of zeros around the source.
        pub pad: u32,
        /// First row of the filters. Their order: group, tap row by row, four input channels, one of these,
        /// two rows of outputs.
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
