//! Twin of `glsl/tile_edges.comp`.

use super::{Real, TwinCall};
use crate::pass::counters;
use crate::pass::tile_edges::Push;
use crate::scene::tile::{ALPHA_MIN, TileGrid, ellipse, row};

/// The word of a tile, or of the place behind the last tile of a row.
pub(super) fn edge_at([column, row]: [u32; 2], columns: u32) -> usize {
    (row * (columns + 1) + column) as usize
}

/// The columns of tiles of a row of `splat2d`, for each row of tiles that has some.
fn rows_of<T: Real>(splat: &[f32; 12], grid: &TileGrid) -> Vec<(u32, std::ops::Range<u32>)> {
    let r = splat.map(|x| T::of(f64::from(x)));
    let e = ellipse([r[0], r[1]], [r[2], r[3], r[4]], r[5], grid);
    e.rows.clone().map(|y| (y, row(&e, y, grid))).filter(|(_, columns)| !columns.is_empty()).collect()
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let alpha_min = call.constants.last().map_or(ALPHA_MIN, |bits| f32::from_bits(*bits));
    let grid = TileGrid { alpha_min, ..TileGrid::new([push.width, push.height], [push.tile_width, push.tile_height]) };
    let [columns, rows] = grid.counts();
    let splat2d = call.get::<[f32; 12]>(0);
    let tile_counts = call.get::<u32>(1);
    let splats = call.get::<u32>(2)[counters::SPLATS].min(call.groups * 64) as usize;
    let mut edges = call.get::<u32>(3);
    for splat in (0..splats).filter(|&i| tile_counts[i] > 0) {
        for (y, of_row) in rows_of::<f32>(&splat2d[splat], &grid) {
            let [first, behind] = [of_row.start, of_row.end].map(|x| edge_at([x, y], columns));
            edges[first] = edges[first].wrapping_add(1);
            edges[behind] = edges[behind].wrapping_sub(1);
        }
        edges[edge_at([0, rows], columns)] += 1;
    }
    call.set(3, &edges);
}
