//! Sorts the pairs of each tile by depth.

use super::emit::CARRIED;
use super::{Pass, module};
use crate::vk::{Binding, Constant, Kernel, read, read_write, write};

crate::push_constants! {
    /// Push constants of both variants.
    pub struct Push {
        /// Columns of tiles.
        pub columns: u32,
        /// Rows of tiles.
        pub rows: u32,
    }
}

/// Pairs that a workgroup sorts in shared memory; a power of two. Longer lists are merged in their place.
const CAPACITY: Constant = Constant { id: 1, name: "CAPACITY", default: 2048 };

const BINDINGS: &[Binding] = &[
    read_write("pairs"),
    read("tile_first"),
    read("slot_splat"),
    write("sorted_splats"),
    write("sorted_slots"),
    read_write("tile_ranges"),
];

const fn pass(name: &'static str, constants: &'static [Constant]) -> Pass {
    Pass {
        kernel: Kernel {
            name,
            spirv: module(name),
            bindings: BINDINGS,
            push_bytes: Push::BYTES,
            constants,
            local_size: Some(256),
        },
        doc: "A workgroup owns the list of a tile.",
        dispatch: "one workgroup per tile",
        push: Push::FIELDS,
    }
}

/// With hardware subgroups.
pub const PASS: Pass = pass("tile_sort_subgroup", &[CARRIED, CAPACITY]);
/// With emulated subgroups.
pub const EMULATED: Pass =
    pass("tile_sort_emulated", &[CARRIED, CAPACITY, Constant { id: 100, name: "EMULATED_WIDTH", default: 32 }]);
