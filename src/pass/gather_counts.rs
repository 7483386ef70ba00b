//! The tile counts of the visible splats in depth order.

use super::{Pass, module};
use crate::vk::{Kernel, read, write};

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "gather_counts",
        spirv: module("gather_counts"),
        bindings: &[read("order"), read("tile_counts"), read("counters"), write("counts")],
        push_bytes: 0,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns one visible splat; a workgroup owns 64 consecutive ones.",
    dispatch: "one thread per visible splat",
    push: &[],
};
