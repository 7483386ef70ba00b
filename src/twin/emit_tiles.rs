//! Twin of `glsl/emit_tiles.comp`. Gives out the places of a list in the order of the splats; the pass in any order.

use super::TwinCall;
use super::emit::tiles_of;
use super::tile_edges::edge_at;
use crate::pass::counters;
use crate::pass::emit_tiles::Push;
use crate::scene::tile::{ALPHA_MIN, TileGrid};

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let alpha_min = call.constants.last().map_or(ALPHA_MIN, |bits| f32::from_bits(*bits));
    let carried = call.constants[call.constants.len() - 2] != 0;
    let grid = TileGrid { alpha_min, ..TileGrid::new([push.width, push.height], [push.tile_width, push.tile_height]) };
    let [columns, rows] = grid.counts();
    let splat2d = call.get::<[f32; 12]>(0);
    let tile_counts = call.get::<u32>(1);
    let splats = call.get::<u32>(2)[counters::SPLATS].min(call.groups * 64) as usize;
    let first = call.get::<u32>(3);
    let mut ranges = call.get::<[u32; 2]>(4);
    let mut pairs = call.get::<[u32; 2]>(5);
    let mut slot_splat = call.get::<u32>(6);
    let slot_offsets = call.get::<u32>(7);
    for splat in (0..splats).filter(|&i| tile_counts[i] > 0) {
        // Tiles beyond the counted ones are cut, and missing ones are no tile.
        let tiles = tiles_of::<f32>(&splat2d[splat], tile_counts[splat], &grid);
        for (nth, tile) in (0..).zip(tiles).filter(|&(_, tile)| tile < columns * rows) {
            let slot = if carried { 0 } else { slot_offsets[splat] + nth };
            if !carried && slot >= push.capacity {
                continue;
            }
            let place = ranges[tile as usize][1];
            ranges[tile as usize][1] += 1;
            if place < first[edge_at([tile % columns + 1, tile / columns], columns)] {
                let depth = splat2d[splat][6].to_bits() >> push.shift;
                pairs[place as usize] = [depth, if carried { splat as u32 } else { slot }];
            }
            if !carried {
                slot_splat[slot as usize] = splat as u32;
            }
        }
    }
    call.set(4, &ranges);
    call.set(5, &pairs);
    call.set(6, &slot_splat);
}
