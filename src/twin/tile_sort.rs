//! Twin of `glsl/tile_sort.comp`. Leaves the pairs in order, where the pass sorts them beside.

use super::TwinCall;
use super::tile_edges::edge_at;
use crate::pass::tile_sort::Push;

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let Push { columns, rows } = call.push();
    let carried = call.constants[0] != 0;
    let mut pairs = call.get::<[u32; 2]>(0);
    let first = call.get::<u32>(1);
    let slot_splat = call.get::<u32>(2);
    let mut splats = call.get::<u32>(3);
    let mut slots = call.get::<u32>(4);
    let mut ranges = call.get::<[u32; 2]>(5);
    for tile in 0..(columns * rows).min(call.groups) {
        let [begin, end] = ranges[tile as usize];
        let end = end.min(first[edge_at([tile % columns + 1, tile / columns], columns)]);
        ranges[tile as usize] = if begin < end { [begin, end] } else { [0, 0] };
        let list = begin as usize..end as usize;
        pairs[list.clone()].sort_unstable();
        for i in list {
            let [_, value] = pairs[i];
            splats[i] = if carried { value } else { slot_splat[value as usize] };
            if !carried {
                slots[i] = value;
            }
        }
    }
    call.set(0, &pairs);
    call.set(3, &splats);
    call.set(4, &slots);
    call.set(5, &ranges);
}
