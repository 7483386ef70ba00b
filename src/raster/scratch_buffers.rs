//! Scratch memory of the tile lists, shared with buffers that a training step writes later.

use std::ops::Range;

use super::sort::SortShape;
use super::tiles::{Capacities, DEPTH_BITS, tile_bits};
use super::variants::ListSort;
use crate::vk::{Buffer, BufferRange, Gpu, Memory, Result};

/// Byte ranges in one buffer for data of the tile lists that are not needed in the backward pass:
///
/// | data | from | until |
/// |---|---|---|
/// | keys of the depth sort, two sides; side 0 then holds tile counts | `compact` | the prefix sum over the tile counts |
/// | values of the depth sort: the depth order, and each splat's first pair | `compact` | `emit` |
/// | two tables of the depth sort | the depth sort | its end |
/// | two tables of the tile sort, overlapping all rows above | after `emit` | the end of the tile sort |
///
/// Lists that are sorted in tiles ([`ListSort::Tiles`]) need only one side of the keys and the second side of the values,
/// for the list of the visible splats; the tables are empty.
///
/// In training the buffer also holds the gradients of the projected splats. The gradients are written after the lists
/// are complete, when these ranges are no longer read.
pub(super) struct ScratchLayout {
    pub(super) keys: [Range<u64>; 2],
    pub(super) vals: [Range<u64>; 2],
    pub(super) depth_tables: [Range<u64>; 2],
    pub(super) tile_tables: [Range<u64>; 2],
}

impl ScratchLayout {
    pub(super) fn new(gpu: &Gpu, capacities: &Capacities, lists: ListSort, shape: SortShape) -> ScratchLayout {
        let alignment = gpu.caps().limits.storage_alignment;
        let place = |end: &mut u64, bytes: u64| {
            let begin = end.next_multiple_of(alignment);
            *end = begin + bytes;
            begin..*end
        };
        let splats = 4 * capacities.splats.max(1);
        let (depth, tile) = match lists {
            ListSort::Global => (
                4 * shape.table_words(capacities.splats, DEPTH_BITS),
                4 * shape.table_words(capacities.pairs, tile_bits(capacities.tiles)),
            ),
            ListSort::Tiles => (0, 0),
        };
        let (mut early, mut late) = (0, 0);
        let mut two = |bytes| [place(&mut early, bytes), place(&mut early, bytes)];
        let keys = two(splats);
        let vals = two(splats);
        let depth_tables = two(depth);
        ScratchLayout { keys, vals, depth_tables, tile_tables: [place(&mut late, tile), place(&mut late, tile)] }
    }

    /// Bytes of the buffer.
    pub(super) fn bytes(&self) -> u64 {
        self.depth_tables[1].end.max(self.tile_tables[1].end)
    }
}

/// Scratch memory lent to the tile lists.
pub(super) struct ScratchBuffers<'a> {
    /// At least [`ScratchLayout::bytes`] bytes.
    pub(super) early: &'a Buffer,
    /// With slots: one word per pair, unused once the backward pass begins. `None` without slots: pairs then carry the
    /// splat.
    pub(super) slot_splat: Option<BufferRange>,
}

/// Two ranges of a buffer.
pub(super) fn parts(buffer: &Buffer, ranges: &[Range<u64>; 2]) -> [BufferRange; 2] {
    ranges.clone().map(|range| BufferRange::of(buffer, range))
}

/// Two buffers of `count` words.
pub(super) fn words(gpu: &Gpu, names: [&str; 2], count: u64) -> Result<[BufferRange; 2]> {
    let [a, b] = names.map(|name| gpu.buffer(name, 4 * count.max(1), Memory::Device));
    Ok([BufferRange::whole(a?), BufferRange::whole(b?)])
}
