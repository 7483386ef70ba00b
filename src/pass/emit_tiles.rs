//! Writes each (splat, tile) pair into the list of its tile, in no order.

use super::alpha_min::ALPHA_MIN;
use super::emit::CARRIED;
use super::{Pass, module};
use crate::vk::{Binding, Constant, Kernel, read, read_write, write};

crate::push_constants! {
    /// Push constants of both variants.
    pub struct Push {
        /// Image width in pixels.
        pub width: u32,
        /// Image height in pixels.
        pub height: u32,
        /// Tile width in pixels.
        pub tile_width: u32,
        /// Tile height in pixels.
        pub tile_height: u32,
        /// Number of low bits of a depth to drop.
        pub shift: u32,
        /// Most slots that fit.
        pub capacity: u32,
    }
}

const BINDINGS: &[Binding] = &[
    read("splat2d"),
    read("tile_counts"),
    read("counters"),
    read("tile_first"),
    read_write("tile_ranges"),
    write("pairs"),
    write("slot_splat"),
    read("slot_offsets"),
];

const fn pass(name: &'static str, constants: &'static [Constant]) -> Pass {
    Pass {
        kernel: Kernel {
            name,
            spirv: module(name),
            bindings: BINDINGS,
            push_bytes: Push::BYTES,
            constants,
            local_size: Some(64),
        },
        doc: "One thread owns one splat, a workgroup 64 consecutive splats; a subgroup shares the pairs of its splats.",
        dispatch: "one thread per splat",
        push: Push::FIELDS,
    }
}

/// With hardware subgroups.
pub const PASS: Pass = pass("emit_tiles_subgroup", &[CARRIED, ALPHA_MIN]);
/// With emulated subgroups.
pub const EMULATED: Pass =
    pass("emit_tiles_emulated", &[Constant { id: 100, name: "EMULATED_WIDTH", default: 32 }, CARRIED, ALPHA_MIN]);
