//! How accurate a terrain model is.

use serde::Serialize;

use super::{Completeness, Errors, Kind, is_seen};

/// The ground that is known better than a terrain model, on the map's cells.
#[derive(Clone, Copy, Debug)]
pub struct Ground<'a> {
    /// Heights of the ground; NaN where none is known.
    pub heights: &'a [f32],
    /// What the cells show from above; without them all count as open ground.
    pub kinds: Option<&'a [Kind]>,
}

/// The accuracy of a terrain model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Terrain {
    /// Vertical errors of all cells.
    pub vertical: Errors,
    /// Where the ground lies open.
    pub open: Errors,
    /// Where something stands on the ground.
    pub covered: Errors,
    /// Completeness.
    pub completeness: Completeness,
}

impl Terrain {
    /// Compares the heights of a terrain model with the ground. `seen` is how many photographs look at each cell.
    pub fn of(gsd: f64, ground: &Ground<'_>, heights: &[f32], seen: Option<&[u16]>) -> Self {
        let known = |k: &usize| ground.heights[*k].is_finite();
        let error = |k: usize| f64::from(heights[k]) - f64::from(ground.heights[k]);
        let is_open = |k: usize| ground.kinds.is_none_or(|kinds| kinds[k] == Kind::Ground);
        let of = |wanted: &dyn Fn(usize) -> bool| {
            let cells = (0..heights.len()).filter(|k| wanted(*k)).map(error).filter(|e| e.is_finite());
            Errors::of(&cells.collect::<Vec<_>>())
        };
        let asked: Vec<usize> = (0..heights.len()).filter(known).filter(|k| is_seen(seen, *k)).collect();
        Self {
            vertical: of(&|_| true),
            open: of(&is_open),
            covered: of(&|k| !is_open(k)),
            completeness: Completeness::of(&asked, gsd, error),
        }
    }
}
