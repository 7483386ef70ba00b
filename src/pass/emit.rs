//! Writes the tiles of each visible splat, in depth order, as (tile, slot) pairs.

use super::{Pass, module};
use crate::vk::{Kernel, read, write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Image width in pixels.
        pub width: u32,
        /// Image height in pixels.
        pub height: u32,
        /// Tile width in pixels.
        pub tile_width: u32,
        /// Tile height in pixels.
        pub tile_height: u32,
        /// Pairs that fit.
        pub capacity: u32,
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "emit",
        spirv: module("emit"),
        bindings: &[
            read("splat2d"),
            read("tile_counts"),
            read("order"),
            read("pair_offsets"),
            read("counters"),
            write("pair_keys"),
            write("pair_vals"),
            write("slot_splat"),
        ],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns one visible splat and its slots; a workgroup owns 64 consecutive visible splats.",
    dispatch: "one thread per visible splat",
    push: Push::FIELDS,
    twin: crate::twin::emit::run,
};
