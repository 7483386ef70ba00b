//! How accurate a map is: heights, positions and completeness against what is known better.
//!
//! - **Mask.** What is compared is decided by the reference alone: the ground and the roofs, but no cell within two ground
//!   sample distances of a step. Between the middles of two neighbouring cells on either side of a step, heights differ by
//!   more than two ground sample distances.
//! - **Vertical.** Map minus reference at the middles of masked cells. No error is left out, however large.
//! - **Complete** is a masked cell that at least two photographs look at, if the map has a height there, within three
//!   ground sample distances of the reference. Nothing is filled in.
//! - **Planimetric.** Shifts of patches of the orthophoto against an orthophoto of the reference. Which patches are
//!   compared is decided by the texture of the reference alone.
//! - **Terrain.** Every cell with a height of the ground in the reference, nothing masked: on open ground, and where
//!   something stands on the ground.
//! - **The whole**: the plane that fits the vertical errors best in the mean of absolute values, and the median of the
//!   patches' shifts.

mod check_points;
mod gridded;
mod known;
mod patches;
mod plane;
mod points;
mod report;
mod steps;
mod terrain;

pub use check_points::CheckPoints;
pub use gridded::gridded;
pub use known::{Known, brightness};
pub use patches::{Patches, Picture, patches};
pub use plane::{Plane, plane};
pub use points::{PointErrors, at_points};
pub use report::{FILE, PointReport, Report};
pub use steps::{Mask, mask};
pub use terrain::{Ground, Terrain};

use serde::Serialize;

/// Complete is a cell within this many ground sample distances of the reference.
const COMPLETE: f64 = 3.0;
/// Completeness is asked where this many photographs look.
const SEEN_BY: u16 = 2;

/// Square cells, row-major, the first row in the north.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cells {
    /// Cells in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Side of a cell in metres: the ground sample distance.
    pub gsd: f64,
}

/// What a cell shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The ground.
    Ground,
    /// A roof.
    Roof,
    /// Anything else, which no height is compared on.
    Other,
}

/// What is known better than the map, on the map's cells.
#[derive(Clone, Copy, Debug)]
pub struct Reference<'a> {
    /// Heights; NaN where none is known.
    pub heights: &'a [f32],
    /// What the cells show; without them all count as ground.
    pub kinds: Option<&'a [Kind]>,
    /// Brightness of an orthophoto, 0 to 255; NaN where there is none.
    pub picture: Option<&'a [f32]>,
}

/// A map.
#[derive(Clone, Copy, Debug)]
pub struct Surface<'a> {
    /// Heights; NaN where the map has none.
    pub heights: &'a [f32],
    /// Brightness of the orthophoto, 0 to 255; NaN where there is none.
    pub picture: Option<&'a [f32]>,
    /// How many photographs look at each cell; without it all cells count as seen.
    pub seen: Option<&'a [u16]>,
}

/// Statistics of errors, metres.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Errors {
    /// How many.
    pub count: usize,
    /// Mean.
    pub mean: f64,
    /// Median.
    pub median: f64,
    /// Median of absolute values.
    pub median_absolute: f64,
    /// Root of the mean square.
    pub rmse: f64,
}

impl Errors {
    /// Of errors.
    pub fn of(errors: &[f64]) -> Self {
        let count = errors.len();
        if count == 0 {
            return Self::default();
        }
        let mean_of = |f: fn(f64) -> f64| errors.iter().map(|e| f(*e)).sum::<f64>() / count as f64;
        Self {
            count,
            mean: mean_of(|e| e),
            median: median(errors.to_vec()),
            median_absolute: median(errors.iter().map(|e| e.abs()).collect()),
            rmse: mean_of(|e| e * e).sqrt(),
        }
    }
}

/// The median; 0 of nothing.
fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let (odd, middle) = (values.len() % 2 == 1, values.len() / 2);
    let (below, upper, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    if odd { *upper } else { 0.5 * (*upper + below.iter().copied().fold(f64::NEG_INFINITY, f64::max)) }
}

/// How many masked cells are complete.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Completeness {
    /// Cells that are asked for: masked, and seen by two photographs.
    pub cells: usize,
    /// Share of them with a height.
    pub with_height: f64,
    /// Share of them with a height within three ground sample distances of the reference.
    pub complete: f64,
}

impl Completeness {
    /// Of the cells `asked` for, whose errors `error` gives; not a number where the map has no height.
    fn of(asked: &[usize], gsd: f64, error: impl Fn(usize) -> f64) -> Self {
        let share = |good: &dyn Fn(f64) -> bool| {
            asked.iter().filter(|k| good(error(**k))).count() as f64 / asked.len().max(1) as f64
        };
        let complete = share(&|e| e.abs() <= COMPLETE * gsd);
        Self { cells: asked.len(), with_height: share(&|e| e.is_finite()), complete }
    }
}

/// Where the whole map lies against the reference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Whole {
    /// Median shift to the east and to the north, metres, where patches were compared.
    pub shift: Option<[f64; 2]>,
    /// Height of the plane of the vertical errors in the middle of the map, metres.
    pub up: f64,
    /// Rise of the plane to the east and to the north, metres per metre.
    pub tilt: [f64; 2],
    /// Angle of the plane, degrees.
    pub tilt_degrees: f64,
    /// Root of the mean square of the vertical errors that are left without the plane, metres.
    pub rmse_without: f64,
}

/// The accuracy of a map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Accuracy {
    /// Vertical errors of all masked cells.
    pub vertical: Errors,
    /// Of the ground.
    pub ground: Errors,
    /// Of roofs.
    pub roofs: Errors,
    /// Completeness.
    pub completeness: Completeness,
    /// Shifts of patches, where both have a picture.
    pub planimetric: Option<Patches>,
    /// The whole.
    pub whole: Whole,
}

/// Whether completeness is asked at a cell.
fn is_seen(seen: Option<&[u16]>, cell: usize) -> bool {
    seen.is_none_or(|seen| seen[cell] >= SEEN_BY)
}

/// Compares a map with a reference on the masked cells. All slices have a value for each cell.
pub fn assess(cells: Cells, reference: &Reference<'_>, mask: &Mask, map: &Surface<'_>) -> Accuracy {
    let masked = |k: &usize| mask.kinds[*k].is_some();
    let error = |k: usize| f64::from(map.heights[k]) - f64::from(reference.heights[k]);
    let valid: Vec<usize> = (0..mask.kinds.len()).filter(masked).filter(|k| map.heights[*k].is_finite()).collect();
    let of = |kind: Kind| -> Vec<f64> {
        valid.iter().filter(|k| mask.kinds[**k] == Some(kind)).map(|k| error(*k)).collect()
    };
    let errors: Vec<f64> = valid.iter().map(|k| error(*k)).collect();
    let seen = |k: &usize| is_seen(map.seen, *k);
    let asked: Vec<usize> = (0..mask.kinds.len()).filter(masked).filter(seen).collect();
    let planimetric = match (reference.picture, map.picture) {
        (Some(truth), Some(seen)) => {
            let of = |values| Picture { width: cells.width, height: cells.height, values };
            patches(&of(truth), &of(seen), cells.gsd)
        }
        _ => None,
    };
    let middle = [0.5 * cells.width as f64, 0.5 * cells.height as f64];
    let places = valid.iter().map(|k| {
        let (column, row) = ((k % cells.width) as f64 + 0.5, (k / cells.width) as f64 + 0.5);
        [cells.gsd * (column - middle[0]), cells.gsd * (middle[1] - row)]
    });
    let fitted = plane(&places.collect::<Vec<_>>(), &errors);
    Accuracy {
        vertical: Errors::of(&errors),
        ground: Errors::of(&of(Kind::Ground)),
        roofs: Errors::of(&of(Kind::Roof)),
        completeness: Completeness::of(&asked, cells.gsd, error),
        planimetric,
        whole: Whole {
            shift: planimetric.map(|p| p.median),
            up: fitted.up,
            tilt: fitted.tilt,
            tilt_degrees: fitted.tilt[0].hypot(fitted.tilt[1]).atan().to_degrees(),
            rmse_without: fitted.rmse,
        },
    }
}

/// Vertical errors of two maps on the masked cells on which both have a height.
pub fn on_common_cells(reference: &Reference<'_>, mask: &Mask, maps: [&[f32]; 2]) -> [Errors; 2] {
    let common = |k: &usize| mask.kinds[*k].is_some() && maps.iter().all(|map| map[*k].is_finite());
    let cells: Vec<usize> = (0..mask.kinds.len()).filter(common).collect();
    maps.map(|map| {
        let errors: Vec<f64> = cells.iter().map(|k| f64::from(map[*k]) - f64::from(reference.heights[*k])).collect();
        Errors::of(&errors)
    })
}

#[cfg(test)]
mod tests;
