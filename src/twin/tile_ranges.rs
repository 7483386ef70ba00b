//! Twin of `glsl/tile_ranges.comp`.

use super::TwinCall;
use crate::pass::counters;
use crate::pass::tile_ranges::Push;

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let keys = call.get::<u32>(0);
    let slots = call.get::<u32>(1);
    let slot_splat = call.get::<u32>(2);
    let pairs = call.get::<u32>(3)[counters::PAIRS].min(call.groups * 64) as usize;
    let sorted: Vec<u32> = slots[..pairs].iter().filter_map(|&slot| slot_splat.get(slot as usize).copied()).collect();
    let mut ranges = call.get::<[u32; 2]>(5);
    for (j, &tile) in keys[..pairs].iter().enumerate().filter(|&(_, &tile)| tile < push.tiles) {
        let range = &mut ranges[tile as usize];
        if j == 0 || keys[j - 1] != tile {
            range[0] = j as u32;
        }
        if j + 1 == pairs || keys[j + 1] != tile {
            range[1] = j as u32 + 1;
        }
    }
    if call.constants[0] == 0 {
        call.set(4, &sorted);
    }
    call.set(5, &ranges);
}
