//! The constrained set and what is rendered of it: see [`super::counters::CONSTRAINED`].

use super::{Pass, module};
use crate::vk::{Kernel, read, read_write, write};

/// Leaves nothing of a projection but the constrained set.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "constrain",
        spirv: module("constrain"),
        bindings: &[read("counters"), read("ids"), write("tile_counts")],
        push_bytes: 0,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns one splat; a workgroup owns 64 consecutive splats. Splats with an identity from the bound \
        on touch no tile.",
    dispatch: "one thread per splat",
    push: &[],
};

/// Keeps gradients of projected splats while another picture of the same view is rendered.
pub const KEEP: Pass = Pass {
    kernel: Kernel {
        name: "grad2d_keep",
        spirv: module("grad2d_keep"),
        bindings: &[read("counters"), read("tile_counts"), read("grad2d"), write("kept")],
        push_bytes: 0,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns the row of 12 floats of one splat; a workgroup owns 64 consecutive splats. Zero where a \
        splat is not on the image.",
    dispatch: "one thread per splat",
    push: &[],
};

/// Adds them to those of the other picture.
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
