//! Outlines of splats: for viewers, never for a training step.

use super::{Pass, module};
use crate::vk::{Kernel, read, write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Image width in pixels.
        pub width: u32,
        /// Image height in pixels.
        pub height: u32,
        /// Side of a tile in pixels, a multiple of 8.
        pub side: u32,
        /// Background, red.
        pub red: f32,
        /// Background, green.
        pub green: f32,
        /// Background, blue.
        pub blue: f32,
    }
}

/// Mahalanobis distance of the outline from the splat's mean.
pub const RADIUS: f32 = 2.0;

/// Pixels from the ellipse to where the line has faded.
pub const HALF_LINE: f32 = 1.25;

/// Weight of the splat's Gaussian inside of the outline.
pub const FILL: f32 = 0.1;

/// The pass. `image` gets (r, g, b, final transmittance) for each pixel.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "splat_outlines",
        spirv: module("splat_outlines"),
        bindings: &[read("splat2d"), read("sorted_splats"), read("tile_ranges"), write("image")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns a pixel; a workgroup of 64 threads owns a block of 8x8 pixels.",
    dispatch: "one workgroup per block of pixels",
    push: Push::FIELDS,
};
