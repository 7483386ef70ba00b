//! Writes the tiles of each visible splat, in depth order, as (tile, slot) or (tile, splat) pairs.

use super::alpha_min::ALPHA_MIN;
use super::turns::PER_TURN;
use super::{Pass, module};
use crate::vk::{Binding, Constant, Kernel, read, write};

crate::push_constants! {
    /// Push constants of all variants.
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

const BINDINGS: &[Binding] = &[
    read("splat2d"),
    read("tile_counts"),
    read("order"),
    read("pair_offsets"),
    read("counters"),
    write("pair_keys"),
    write("pair_vals"),
    write("slot_splat"),
    read("slot_offsets"),
];

const fn pass(name: &'static str, constants: &'static [Constant], doc: &'static str) -> Pass {
    Pass {
        kernel: Kernel {
            name,
            spirv: module(name),
            bindings: BINDINGS,
            push_bytes: Push::BYTES,
            constants,
            local_size: Some(64),
        },
        doc,
        dispatch: "one thread per visible splat",
        push: Push::FIELDS,
    }
}

const TOGETHER_DOC: &str = "One thread owns one visible splat with its pairs and slots; a subgroup together writes \
     the pairs of its splats with many tiles; a workgroup owns 64 consecutive visible splats.";

/// A thread writes the pairs of its splat.
pub const PASS: Pass = pass(
    "emit",
    &[CARRIED, PER_TURN, ALPHA_MIN],
    "One thread owns one visible splat with its pairs and slots; a workgroup owns 64 consecutive visible splats.",
);
/// A subgroup writes the pairs of its large splats together, for wide subgroups. Same results as [`PASS`].
pub const TOGETHER: Pass = pass("emit_together_subgroup", &[CARRIED, PER_TURN, ALPHA_MIN], TOGETHER_DOC);
/// [`TOGETHER`] with emulated subgroups.
pub const TOGETHER_EMULATED: Pass = pass(
    "emit_together_emulated",
    &[Constant { id: 100, name: "EMULATED_WIDTH", default: 32 }, CARRIED, PER_TURN, ALPHA_MIN],
    TOGETHER_DOC,
);
