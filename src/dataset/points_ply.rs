//! Point clouds in PLY files.

use std::path::Path;

use super::Point;
use crate::format::{Error, ply};

/// Positions (`x y z`, any number type) with colours (`red green blue`, grey where there are none), numbered in the order of the
/// file.
pub(super) fn read(file: &Path) -> Result<Vec<Point>, Error> {
    let rows = ply::columns(file, &["x", "y", "z"], &["red", "green", "blue"])?;
    let point = |(id, row): (usize, Vec<Option<f64>>)| {
        let at = |k: usize| row.get(k).copied().flatten();
        let position = [0, 1, 2].map(|k| at(k).unwrap_or(0.0));
        let color = [3, 4, 5].map(|k| at(k).map_or(128, |c| c.round().clamp(0.0, 255.0) as u8));
        Point { id: id as u64, position, color, error: 0.0, track: 0 }
    };
    Ok(rows.into_iter().enumerate().map(point).collect())
}
