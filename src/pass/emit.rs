//! Writes the tiles of each visible splat, in depth order, as (tile, slot) or (tile, splat) pairs.

use super::alpha_min::ALPHA_MIN;
use super::turns::PER_TURN;
use super::{Pass, module};
use crate::vk::{Constant, Kernel, read, write};

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
        /// Most pairs that fit.
        pub capacity: u32,
    }
}

/// Pairs carry the splat itself (0 or 1). With 1 the pass does not use `slot_splat` and `slot_offsets`.
pub(super) const CARRIED: Constant = Constant { id: 0, name: "CARRIED", default: 0 };

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
            read("slot_offsets"),
        ],
        push_bytes: Push::BYTES,
        constants: &[CARRIED, PER_TURN, ALPHA_MIN],
        local_size: Some(64),
    },
    doc: "One thread owns one visible splat with its pairs and slots; a workgroup owns 64 consecutive visible splats.",
    dispatch: "one thread per visible splat",
    push: Push::FIELDS,
};
