//! Lists the visible splats in index order, with depths as sort keys.

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
