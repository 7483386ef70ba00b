//! Renders of the constrained set: see [`super::counters::CONSTRAINED`].

use super::{Pass, module};
use crate::vk::{Kernel, read, read_write, write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// 1: the splats outside of the constrained set are rendered; 0: the constrained set is.
        pub others: u32,
    }
}

/// Culls all splats except the constrained set, or except the others.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "constrain",
        spirv: module("constrain"),
        bindings: &[read("counters"), read("ids"), write("tile_counts")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns one splat; a workgroup owns 64 consecutive splats. Splats with an identity at or \
        above the bound touch no tile; with `others`, splats below the bound.",
    dispatch: "one thread per splat",
    push: Push::FIELDS,
};

/// Saves the gradients of projected splats before another render of the same view.
pub const KEEP: Pass = Pass {
    kernel: Kernel {
        name: "grad2d_keep",
        spirv: module("grad2d_keep"),
        bindings: &[read("counters"), read("tile_counts"), read("grad2d"), write("kept")],
        push_bytes: 0,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns the row of 12 floats of one splat; a workgroup owns 64 consecutive splats. Zero for \
        splats that are not on the image.",
    dispatch: "one thread per splat",
    push: &[],
};

/// Adds the saved gradients to the gradients of the other render.
pub const ADD: Pass = Pass {
    kernel: Kernel {
        name: "grad2d_add",
        spirv: module("grad2d_add"),
        bindings: &[read("counters"), read("tile_counts"), read("kept"), read_write("grad2d")],
        push_bytes: 0,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns the row of 12 floats of one splat; a workgroup owns 64 consecutive splats.",
    dispatch: "one thread per splat",
    push: &[],
};
