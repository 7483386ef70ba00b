//! Parts of the ground.

use serde::{Deserialize, Serialize};

/// A rectangle of the ground in ground coordinates: from each lower edge, which belongs to it, to each upper edge,
/// which does not. `None` is an edge without a neighbour: the cell goes on without end.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(from = "[Option<f64>; 4]", into = "[Option<f64>; 4]")]
pub struct Cell {
    /// Western and eastern edge.
    pub x: [Option<f64>; 2],
    /// Southern and northern edge.
    pub y: [Option<f64>; 2],
}

impl Cell {
    /// The whole plane.
    pub const WHOLE: Self = Self { x: [None; 2], y: [None; 2] };

    /// Whether a point of the ground belongs to the cell. A point that is no number belongs to none.
    pub fn contains(&self, point: [f64; 2]) -> bool {
        self.holds(point, 0.0)
    }

    /// Whether a point belongs to the cell or lies less than `margin` outside of it along each axis.
    pub fn holds(&self, point: [f64; 2], margin: f64) -> bool {
        let within = |[from, to]: [Option<f64>; 2], at: f64| {
            let after = from.map_or(at.is_finite(), |from| at >= from - margin);
            after && to.map_or(at.is_finite(), |to| at < to + margin)
        };
        within(self.x, point[0]) && within(self.y, point[1])
    }

    /// The parts on both sides of a line across axis 0 (x) or 1 (y).
    pub(super) fn cut(self, axis: usize, at: f64) -> [Self; 2] {
        let (mut low, mut high) = (self, self);
        match axis {
            0 => (low.x[1], high.x[0]) = (Some(at), Some(at)),
            _ => (low.y[1], high.y[0]) = (Some(at), Some(at)),
        }
        [low, high]
    }

    /// The part inside of bounds `[x0, x1, y0, y1]`, which take the place of edges without a neighbour.
    pub fn inside(&self, [x0, x1, y0, y1]: [f64; 4]) -> [f64; 4] {
        [self.x[0].unwrap_or(x0), self.x[1].unwrap_or(x1), self.y[0].unwrap_or(y0), self.y[1].unwrap_or(y1)]
    }

    /// Why this is no cell, if it is none.
    pub(super) fn problem(&self) -> Option<&'static str> {
        let edges = || self.x.iter().chain(&self.y).flatten();
        let backwards = |[from, to]: [Option<f64>; 2]| from.zip(to).is_some_and(|(from, to)| from >= to);
        if edges().any(|edge| !edge.is_finite()) {
            return Some("an edge is no finite number");
        }
        (backwards(self.x) || backwards(self.y)).then_some("a lower edge is not below the upper one")
    }
}

impl From<[Option<f64>; 4]> for Cell {
    fn from([x0, x1, y0, y1]: [Option<f64>; 4]) -> Self {
        Self { x: [x0, x1], y: [y0, y1] }
    }
}

impl From<Cell> for [Option<f64>; 4] {
    fn from(cell: Cell) -> Self {
        [cell.x[0], cell.x[1], cell.y[0], cell.y[1]]
    }
}

/// Why cells are no partition of the plane, if they are none: two of them overlap, or a part belongs to none.
pub(super) fn no_partition(cells: &[Cell]) -> Option<String> {
    let bounds = bounds(cells);
    let rectangles: Vec<[f64; 4]> = cells.iter().map(|cell| cell.inside(bounds)).collect();
    for (i, [x0, x1, y0, y1]) in rectangles.iter().enumerate() {
        let overlaps = |[u0, u1, v0, v1]: &[f64; 4]| x0.max(*u0) < x1.min(*u1) && y0.max(*v0) < y1.min(*v1);
        if let Some(j) = rectangles[i + 1..].iter().position(overlaps) {
            return Some(format!("cells {i} and {} overlap", i + 1 + j));
        }
    }
    let area = |[x0, x1, y0, y1]: &[f64; 4]| (x1 - x0) * (y1 - y0);
    let (sum, whole) = (rectangles.iter().map(area).sum::<f64>(), area(&bounds));
    ((sum - whole).abs() > 1e-9 * whole).then(|| "a part of the ground belongs to no cell".to_owned())
}

/// Finite bounds in which every edge of the cells lies, and beyond which no edge does.
fn bounds(cells: &[Cell]) -> [f64; 4] {
    let along = |edges: &dyn Fn(&Cell) -> [Option<f64>; 2]| {
        let all = || cells.iter().flat_map(edges).flatten();
        let (low, high) = all().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        let (low, high) = if low <= high { (low, high) } else { (0.0, 0.0) };
        // As far from the outermost edge as the edges are from one another: parts of similar size add up well.
        let beyond = if high > low { high - low } else { 1.0_f64.max(1e-9 * low.abs()) };
        [low - beyond, high + beyond]
    };
    let ([x0, x1], [y0, y1]) = (along(&|cell| cell.x), along(&|cell| cell.y));
    [x0, x1, y0, y1]
}
