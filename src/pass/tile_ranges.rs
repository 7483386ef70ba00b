//! The range of each tile in the sorted pairs, and the splat of each sorted pair.

use super::{Pass, module};
use crate::vk::{Constant, Kernel, read, write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Tiles of the image.
        pub tiles: u32,
    }
}

/// The pass. `tile_ranges` must be zero beforehand. With CARRIED the values of pairs are splats instead of slots, and
/// the pass does not write `sorted_splats`.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "tile_ranges",
        spirv: module("tile_ranges"),
        bindings: &[
            read("pair_keys"),
            read("pair_vals"),
            read("slot_splat"),
            read("counters"),
            write("sorted_splats"),
            write("tile_ranges"),
        ],
        push_bytes: Push::BYTES,
        constants: &[Constant { id: 0, name: "CARRIED", default: 0 }],
        local_size: Some(64),
    },
    doc: "One thread owns one sorted pair; a workgroup owns 64 consecutive pairs.",
    dispatch: "one thread per pair",
    push: Push::FIELDS,
};
