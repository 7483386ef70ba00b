//! Check points on a map's heights.

use serde::Serialize;

use super::{Cells, Errors};

/// Vertical errors of a map at check points.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PointErrors {
    /// Their statistics.
    pub vertical: Errors,
    /// Map minus check point, metres, in the points' order; nothing where the map has no height.
    pub each: Vec<Option<f64>>,
}

/// Compares a map's heights with check points: easting, northing and height. Between the middles of four cells the map's
/// height is interpolated; at the edge of what has heights, the nearest cell counts.
pub fn at_points(cells: Cells, corner: [f64; 2], heights: &[f32], points: &[[f64; 3]]) -> PointErrors {
    let each: Vec<Option<f64>> = points
        .iter()
        .map(|[east, north, height]| {
            let place = [(east - corner[0]) / cells.gsd, (corner[1] - north) / cells.gsd];
            Some(sampled((cells.width, cells.height), heights, place)? - height)
        })
        .collect();
    PointErrors { vertical: Errors::of(&each.iter().flatten().copied().collect::<Vec<_>>()), each }
}

/// The height at a column and a row, 0.5 in the middle of the first cell.
pub(super) fn sampled((width, height): (usize, usize), heights: &[f32], [column, row]: [f64; 2]) -> Option<f64> {
    let inside = column >= 0.0 && row >= 0.0 && column < width as f64 && row < height as f64;
    if !inside {
        return None;
    }
    let at = |x: usize, y: usize| f64::from(heights[y * width + x]);
    let (x, y) = ((column - 0.5).max(0.0), (row - 0.5).max(0.0));
    let (left, top) = (x as usize, y as usize);
    let (right, below) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
    let (u, v) = (x - left as f64, y - top as f64);
    let between = (1.0 - v) * ((1.0 - u) * at(left, top) + u * at(right, top))
        + v * ((1.0 - u) * at(left, below) + u * at(right, below));
    let nearest = at(column as usize, row as usize);
    [between, nearest].into_iter().find(|z| z.is_finite())
}
