//! Adds a view's mask values and errors to the scores for sampled growth.

use super::{Pass, module};
use crate::vk::{Constant, Kernel, read, read_write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Image width in pixels.
        pub width: u32,
        /// Image height in pixels.
        pub height: u32,
        /// 1: `mask` has a value for each pixel.
        pub masked: u32,
        /// Threshold on the mean absolute difference of the channels: above, the render is wrong.
        pub error: f32,
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "densify_scores",
        spirv: module("densify_scores"),
        bindings: &[
            read("counters"),
            read("tile_counts"),
            read("splat2d"),
            read("grad2d"),
            read("image"),
            read("target"),
            read("mask"),
            read_write("scores"),
        ],
        push_bytes: Push::BYTES,
        constants: &[Constant { id: 2, name: "PHOTOGRAPH_BITS", default: 8 }],
        local_size: Some(64),
    },
    doc: "One thread owns one splat and its row of `scores`; a workgroup owns 64 consecutive splats. Adds, for splats \
          on screen, the mask value at the centre times the norm of the absolute gradient of the 2D mean (in \
          normalised device coordinates), and 1 if the render is wrong there.",
    dispatch: "one thread per splat of the model, through `args`",
    push: Push::FIELDS,
};
