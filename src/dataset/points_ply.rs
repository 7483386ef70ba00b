//! Point clouds in PLY files.

use std::path::Path;

use super::{NoColours, Point};
use crate::format::ply::Cloud;
use crate::format::{Error, LeftOut};

/// Colour of points without one.
pub(super) const GREY: [u8; 3] = [128; 3];

/// The content of a points file.
#[derive(Default)]
pub(super) struct Points {
    /// Points numbered in the order of the file.
    pub(super) list: Vec<Point>,
    /// Why the points have no colours; `None` where they have.
    pub(super) colourless: Option<NoColours>,
    pub(super) left_out: Option<LeftOut>,
}

/// Reads the points of a cloud.
pub(super) fn read(file: &Path, strict: bool) -> Result<Points, Error> {
    let (Cloud { positions, colours, unknown, .. }, left_out) = Cloud::read_with(file, strict)?;
    let colourless = colours.is_empty().then(|| NoColours::with_properties(&unknown));
    let colour = |i: usize| colours.get(i).copied().unwrap_or(GREY);
    let point = |(i, position)| Point { id: i as u64, position, colour: colour(i), error: 0.0, track: 0 };
    Ok(Points { list: positions.into_iter().enumerate().map(point).collect(), colourless, left_out })
}
