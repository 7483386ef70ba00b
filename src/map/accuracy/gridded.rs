//! A cloud of points as heights of cells.

use super::Cells;

/// The median height of the points in each cell; NaN where there are none. `corner` is the north-western corner of the
/// first cell; points are easting, northing and height.
pub fn gridded(cells: Cells, corner: [f64; 2], points: impl IntoIterator<Item = [f64; 3]>) -> Vec<f32> {
    let mut found: Vec<(u32, f32)> = points
        .into_iter()
        .filter_map(|[east, north, height]| {
            let (column, row) = ((east - corner[0]) / cells.gsd, (corner[1] - north) / cells.gsd);
            let inside = |v: f64, size: usize| v >= 0.0 && v < size as f64;
            let at = || row as usize * cells.width + column as usize;
            let within = inside(column, cells.width) && inside(row, cells.height) && height.is_finite();
            within.then(|| (at() as u32, height as f32))
        })
        .collect();
    found.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut heights = vec![f32::NAN; cells.width * cells.height];
    for group in found.chunk_by(|a, b| a.0 == b.0) {
        let middle = group.len() / 2;
        let upper = group[middle].1;
        let median = if group.len() % 2 == 1 { upper } else { 0.5 * (upper + group[middle - 1].1) };
        heights[group[0].0 as usize] = median;
    }
    heights
}
