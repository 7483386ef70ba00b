//! Which cells are compared.

use super::{Cells, Kind, Reference};

/// Heights of neighbours that differ by more than this many ground sample distances are on either side of a step.
const STEP: f64 = 2.0;
/// Cells around a cell at a step that are left out: the middles of those beyond are more than two ground sample
/// distances from the step.
const BESIDE: usize = 1;

/// The cells that are compared.
#[derive(Clone, Debug, PartialEq)]
pub struct Mask {
    /// What is compared at each cell: ground, or a roof.
    pub kinds: Vec<Option<Kind>>,
    /// Share of the cells with a height in the reference that are compared.
    pub share: f64,
}

/// The cells on which a map is compared with a reference.
pub fn mask(cells: Cells, reference: &Reference<'_>) -> Mask {
    let (width, height) = (cells.width, cells.height);
    let heights = reference.heights;
    let steep = |a: usize, b: usize| f64::from((heights[a] - heights[b]).abs()) > STEP * cells.gsd;
    let mut near = vec![false; width * height];
    let mut mark = |k: usize| {
        let (x, y) = (k % width, k / width);
        for row in y.saturating_sub(BESIDE)..=(y + BESIDE).min(height - 1) {
            near[row * width + x.saturating_sub(BESIDE)..=row * width + (x + BESIDE).min(width - 1)].fill(true);
        }
    };
    for k in 0..width * height {
        let east = (k % width + 1 < width).then(|| k + 1);
        let south = (k + width < width * height).then(|| k + width);
        for other in [east, south].into_iter().flatten().filter(|other| steep(k, *other)) {
            mark(k);
            mark(other);
        }
    }
    let kind = |k: usize| {
        let kind = reference.kinds.map_or(Kind::Ground, |kinds| kinds[k]);
        (heights[k].is_finite() && !near[k] && kind != Kind::Other).then_some(kind)
    };
    let kinds: Vec<Option<Kind>> = (0..width * height).map(kind).collect();
    let known = heights.iter().filter(|z| z.is_finite()).count();
    let share = kinds.iter().flatten().count() as f64 / known.max(1) as f64;
    Mask { kinds, share }
}
