//! The visible splats: their list in index order, with depths as sort keys, and their tile counts in depth order.

use super::{Pass, module};
use crate::vk::{Kernel, read, write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Number of low bits of a depth to drop.
        pub shift: u32,
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "compact",
        spirv: module("compact"),
        bindings: &[
            read("splat2d"),
            read("tile_counts"),
            read("places"),
            read("counters"),
            write("keys"),
            write("vals"),
        ],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns one splat; a workgroup owns 64 consecutive splats.",
    dispatch: "one thread per splat",
    push: Push::FIELDS,
};

/// The tile counts of the visible splats in depth order.
pub const GATHER_COUNTS: Pass = Pass {
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
