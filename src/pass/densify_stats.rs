//! Adds a view's gradient norms to the statistics of density control.

use super::{Pass, module};
use crate::vk::{Kernel, read, read_write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Half the image's width in pixels: gradients per pixel become gradients in normalised device coordinates.
        pub half_width: f32,
        /// Half the image's height in pixels.
        pub half_height: f32,
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "densify_stats",
        spirv: module("densify_stats"),
        bindings: &[read("counters"), read("tile_counts"), read("grad2d"), read_write("stats")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns one splat and its row of `stats`; a workgroup owns 64 consecutive splats. Adds, for splats \
          on screen, the norms of the signed and the absolute gradient of the 2D mean (in normalised device \
          coordinates) and 1 view. The fourth number of the row belongs to the optimiser.",
    dispatch: "one thread per splat of the model, through `args`",
    push: Push::FIELDS,
};
