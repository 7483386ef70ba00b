//! Median depths, and weights in front of and behind known depths: for scores and viewers, never for a training step.

use super::alpha_min::ALPHA_MIN;
use super::{Pass, module};
use crate::vk::{Constant, Kernel, read, write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Image width in pixels.
        pub width: u32,
        /// Image height in pixels.
        pub height: u32,
        /// Side of a tile in pixels, a multiple of [`BLOCK_SIDE`].
        pub side: u32,
    }
}

/// Side of the block of pixels that a workgroup owns.
pub const BLOCK_SIDE: u32 = 8;

/// Splats nearer than this share of the known depth are in front of it.
pub const FRONT: f32 = 0.98;

/// Splats farther than this many times the known depth are behind it.
pub const BEHIND: f32 = 1.02;

/// Workgroups of an image.
pub const fn groups(width: u32, height: u32) -> u32 {
    width.div_ceil(BLOCK_SIDE) * height.div_ceil(BLOCK_SIDE)
}

/// Whether depths are known (0 or 1).
const KNOWN: Constant = Constant { id: 0, name: "KNOWN", default: 0 };

/// The pass. `known_depths` has a finite camera z for each pixel, 0 where none is known; it is not read unless KNOWN.
/// `probe` gets (median depth, front, behind, final transmittance) for each pixel.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "depth_probe",
        spirv: module("depth_probe"),
        bindings: &[
            read("splat2d"),
            read("normals"),
            read("sorted_splats"),
            read("tile_ranges"),
            read("known_depths"),
            write("probe"),
        ],
        push_bytes: Push::BYTES,
        constants: &[KNOWN, ALPHA_MIN],
        local_size: Some(64),
    },
    doc: "One thread owns a pixel; a workgroup of 64 threads owns a block of 8x8 pixels.",
    dispatch: "one workgroup per block of pixels",
    push: Push::FIELDS,
};
