//! Point clouds in PLY files.

use std::path::Path;

use super::{NoColours, Point};
use crate::format::Error;
use crate::format::ply::Cloud;

/// Colour of points that have none.
pub(super) const GREY: [u8; 3] = [128; 3];

/// The points of a cloud, numbered in the order of the file, and why they have no colours where they have none.
pub(super) fn read(file: &Path) -> Result<(Vec<Point>, Option<NoColours>), Error> {
    let Cloud { positions, colors, unknown, .. } = Cloud::read(file)?;
    let colourless = colors.is_empty().then(|| NoColours::with_properties(&unknown));
    let color = |i: usize| colors.get(i).copied().unwrap_or(GREY);
    let point = |(i, position)| Point { id: i as u64, position, color: color(i), error: 0.0, track: 0 };
    Ok((positions.into_iter().enumerate().map(point).collect(), colourless))
}
