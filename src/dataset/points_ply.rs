//! Point clouds in PLY files.

use std::path::Path;

use super::Point;
use crate::format::Error;
use crate::format::ply::Cloud;

/// The points of a cloud, numbered in the order of the file.
pub(super) fn read(file: &Path) -> Result<Vec<Point>, Error> {
    let Cloud { positions, colors, .. } = Cloud::read(file)?;
    let point = |(id, (position, color))| Point { id, position, color, error: 0.0, track: 0 };
    Ok((0..).zip(positions.into_iter().zip(colors)).map(point).collect())
}
