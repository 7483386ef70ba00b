//! Twin of `glsl/emit.comp`.

use super::{Real, TwinCall};
use crate::pass::counters;
use crate::pass::emit::Push;
use crate::scene::tile::{ALPHA_MIN, TileGrid, list};

/// The tiles of a row of `splat2d`, cut or padded to `count` entries as the pass does.
pub fn tiles_of<T: Real>(row: &[f32; 12], count: u32, grid: &TileGrid) -> Vec<u32> {
    let r = row.map(|x| T::of(f64::from(x)));
    let mut tiles = list([r[0], r[1]], [r[2], r[3], r[4]], r[5], grid);
    let [columns, rows] = grid.counts();
    tiles.resize(count as usize, columns * rows);
    tiles
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let alpha_min = call.constants.last().map_or(ALPHA_MIN, |bits| f32::from_bits(*bits));
    let grid = TileGrid { alpha_min, ..TileGrid::new([push.width, push.height], [push.tile_width, push.tile_height]) };
    let splat2d = call.get::<[f32; 12]>(0);
    let tile_counts = call.get::<u32>(1);
    let order = call.get::<u32>(2);
    let pair_offsets = call.get::<u32>(3);
    let visible = call.get::<u32>(4)[counters::VISIBLE].min(call.groups * 64) as usize;
    let mut out: [Vec<u32>; 3] = [call.get(5), call.get(6), call.get(7)];
    let slot_offsets = call.get::<u32>(8);
    let carried = call.constants[call.constants.len() - 3] != 0;
    for k in 0..visible {
        let splat = order[k] as usize;
        let tiles = tiles_of::<f32>(&splat2d[splat], tile_counts[splat], &grid);
        let first = pair_offsets[k].max(if carried { 0 } else { slot_offsets[splat] });
        for (i, tile) in (0..push.capacity.saturating_sub(first)).zip(tiles) {
            let place = (pair_offsets[k] + i) as usize;
            out[0][place] = tile;
            if carried {
                out[1][place] = splat as u32;
            } else {
                let slot = slot_offsets[splat] + i;
                out[1][place] = slot;
                out[2][slot as usize] = splat as u32;
            }
        }
    }
    for (i, words) in out.iter().enumerate() {
        call.set(5 + i, words);
    }
}
