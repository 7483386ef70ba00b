//! Memory that the tile lists borrow from what a training step writes later.

use std::ops::Range;

use super::sort::Shape;
use super::tiles::{Capacities, DEPTH_BITS, tile_bits};
use crate::vk::{Buffer, BufferRange, Gpu, Memory, Result};

/// Where the tile lists keep what is dead before the backward, in bytes of one buffer:
///
/// | who | from | until |
/// |---|---|---|
/// | keys of the depth sort, two sides; the first also holds tile counts in depth order | `compact` | the prefix sum over these counts |
/// | values of the depth sort, two sides: the order, and the first place of the pairs of each | `compact` | `emit` |
/// | two tables of the depth sort | the depth sort | its end |
/// | two tables of the tile sort, over all the above | after `emit` | the end of the tile sort |
///
/// In training the buffer is that of the projected splats' gradients: nothing is written there before the lists are
/// complete, and these are not looked at after.
pub(super) struct Layout {
    pub(super) keys: [Range<u64>; 2],
    pub(super) vals: [Range<u64>; 2],
    pub(super) depth_tables: [Range<u64>; 2],
    pub(super) tile_tables: [Range<u64>; 2],
}

impl Layout {
    pub(super) fn new(gpu: &Gpu, capacities: &Capacities, shape: Shape) -> Layout {
        let alignment = gpu.caps().limits.storage_alignment;
        let place = |end: &mut u64, bytes: u64| {
            let begin = end.next_multiple_of(alignment);
            *end = begin + bytes;
            begin..*end
        };
        let splats = 4 * capacities.splats.max(1);
        let depth = 4 * shape.table_words(capacities.splats, DEPTH_BITS);
        let tile = 4 * shape.table_words(capacities.pairs, tile_bits(capacities.tiles));
        let (mut early, mut late) = (0, 0);
        let mut two = |bytes| [place(&mut early, bytes), place(&mut early, bytes)];
        let keys = two(splats);
        let vals = two(splats);
        let depth_tables = two(depth);
        Layout { keys, vals, depth_tables, tile_tables: [place(&mut late, tile), place(&mut late, tile)] }
    }

    /// Bytes of the buffer.
    pub(super) fn bytes(&self) -> u64 {
        self.depth_tables[1].end.max(self.tile_tables[1].end)
    }
}

/// What the lists are given to work in.
pub(super) struct ScratchBuffers<'a> {
    /// At least as large as the layout.
    pub(super) early: &'a Buffer,
    /// With slots: a word per pair that is dead once the backward begins. Without, pairs carry the splat itself.
    pub(super) slot_splat: Option<BufferRange>,
}

/// Parts of a buffer.
pub(super) fn parts(buffer: &Buffer, ranges: &[Range<u64>; 2]) -> [BufferRange; 2] {
    ranges.clone().map(|range| BufferRange::of(buffer, range))
}

/// Buffers of words.
pub(super) fn words(gpu: &Gpu, names: [&str; 2], count: u64) -> Result<[BufferRange; 2]> {
    let [a, b] = names.map(|name| gpu.buffer(name, 4 * count.max(1), Memory::Device));
    Ok([BufferRange::whole(a?), BufferRange::whole(b?)])
}
