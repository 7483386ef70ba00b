//! Twin of `glsl/densify_map.comp`.

use super::TwinCall;
use super::densify_classify::KINDS;
use crate::pass::counters::{NEXT_ID, SPLATS};
use crate::pass::densify_map::Push;

/// An entry of the map: the source's index, with the kind of row in the upper two bits and 0 in the two bits below.
pub fn entry(source: usize, kind: usize) -> u32 {
    source as u32 | (kind as u32) << 30
}

/// The source's index and the kind of row in an entry.
pub fn unpack(entry: u32) -> (usize, usize) {
    ((entry & 0x0fff_ffff) as usize, (entry >> 30) as usize)
}

/// The entry with the axis along which the children are placed.
pub fn along(entry: u32, axis: usize) -> u32 {
    entry & 0xcfff_ffff | (axis as u32 + 1) << 28
}

/// The axis along which the children of an entry are placed; the longest axis where the entry has none.
pub fn axis(entry: u32, log_scales: [f32; 3]) -> usize {
    match entry >> 28 & 3 {
        0 => longest_axis(log_scales),
        noted => noted as usize - 1,
    }
}

/// The longest axis, the first of equals.
pub fn longest_axis(lengths: [f32; 3]) -> usize {
    let [x, y, z] = lengths;
    if x >= y && x >= z {
        0
    } else if y >= z {
        1
    } else {
        2
    }
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let stride = call.push::<Push>().stride as usize;
    let counters = call.get::<u32>(0);
    let (flags, offsets, old_ids) = (call.get::<u32>(1), call.get::<u32>(2), call.get::<u32>(3));
    let (mut map, mut ids) = (call.get::<u32>(4), call.get::<u32>(5));
    let kept = offsets[stride];
    let splats = (counters[SPLATS] as usize).min(stride).min(64 * call.groups as usize);
    for (i, &id) in old_ids.iter().enumerate().take(splats) {
        for kind in 0..KINDS {
            let e = kind * stride + i;
            if flags[e] != 0 {
                let row = offsets[e];
                // A kept row beside a second child is the first child, in the parent's row.
                let moved = kind == 0 && flags[3 * stride + i] != 0;
                map[row as usize] = entry(i, if moved { 2 } else { kind });
                ids[row as usize] = if kind == 0 { id } else { counters[NEXT_ID].wrapping_add(row - kept) };
            }
        }
    }
    call.set(4, &map);
    call.set(5, &ids);
}
