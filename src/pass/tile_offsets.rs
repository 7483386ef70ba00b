//! The first pair of each tile, and the numbers of visible splats and of pairs. Plans later passes, or voids the
//! event when the pairs do not fit.

use super::{Pass, module};
use crate::vk::{Binding, Constant, Kernel, read_write, write};

/// Threads of the workgroup.
pub const LOCAL_SIZE: u32 = 256;
/// Most words per thread and turn. With more words there are several turns.
const MOST_ITEMS: u32 = 64;

crate::push_constants! {
    /// Push constants of both variants.
    pub struct Push {
        /// Columns of tiles.
        pub columns: u32,
        /// Rows of tiles.
        pub rows: u32,
        /// Most pairs.
        pub capacity: u32,
        /// Number of entries, from the first entry of `args`, to zero when the event is void.
        pub void_entries: u32,
        /// Entry of `args` for passes over the visible splats; the next entry is for `slot_sum`.
        pub first: u32,
        /// Visible splats per workgroup of a pass over them.
        pub per_group: u32,
        /// Visible splats per workgroup of `slot_sum`.
        pub per_sum: u32,
    }
}

const ITEMS: Constant = Constant { id: 0, name: "ITEMS", default: 8 };

/// The specialization constant for images of up to `tiles` tiles: words per thread and turn, in one turn where possible.
pub fn items(tiles: u64) -> (&'static str, u32) {
    let needed = (tiles + tiles / 4).div_ceil(u64::from(LOCAL_SIZE));
    (ITEMS.name, u32::try_from(needed).unwrap_or(u32::MAX).clamp(1, MOST_ITEMS))
}

const BINDINGS: &[Binding] = &[read_write("counters"), read_write("edges"), write("tile_ranges"), write("args")];

const fn pass(name: &'static str, constants: &'static [Constant]) -> Pass {
    Pass {
        kernel: Kernel {
            name,
            spirv: module(name),
            bindings: BINDINGS,
            push_bytes: Push::BYTES,
            constants,
            local_size: Some(LOCAL_SIZE),
        },
        doc: "The workgroup owns everything; in each turn one thread owns ITEMS consecutive words.",
        dispatch: "one workgroup",
        push: Push::FIELDS,
    }
}

/// With hardware subgroups.
pub const PASS: Pass = pass("tile_offsets_subgroup", &[ITEMS]);
/// With emulated subgroups.
pub const EMULATED: Pass =
    pass("tile_offsets_emulated", &[ITEMS, Constant { id: 100, name: "EMULATED_WIDTH", default: 32 }]);
