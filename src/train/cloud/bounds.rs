//! Bounding boxes of points.

use std::fmt;

use crate::dataset::{Dataset, Role};
use crate::scene::Frame;

/// Share of the reconstructed points that may lie outside on either side of an axis, because a few are always far off.
const OUTSIDE: f64 = 0.01;
/// A box is widened on all sides by this share of its longest side.
const WIDENED: f64 = 0.1;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest coordinates.
    pub low: [f64; 3],
    /// Largest coordinates.
    pub high: [f64; 3],
}

impl Bounds {
    /// Bounds of points; `None` without points.
    pub fn of(points: impl IntoIterator<Item = [f64; 3]>) -> Option<Self> {
        let mut points = points.into_iter();
        let first = points.next()?;
        let both = |b: Self, p: [f64; 3]| Self {
            low: std::array::from_fn(|k| b.low[k].min(p[k])),
            high: std::array::from_fn(|k| b.high[k].max(p[k])),
        };
        Some(points.fold(Self { low: first, high: first }, both))
    }

    /// Bounds of what a dataset's cameras look at, in dataset coordinates: of the reconstructed points, or, without
    /// points, of the cameras, widened by the cameras' extent.
    pub fn of_dataset(dataset: &Dataset) -> Self {
        if dataset.begins_at_random() {
            let centers = dataset.views_of(Role::Train).map(|(_, view)| view.camera.center());
            let reach = Frame::EXTENT / dataset.frame.scale;
            let [low, high] = [dataset.frame.offset; 2];
            return Self::of(centers).unwrap_or(Self { low, high }).widened_by(reach);
        }
        let mut out = Self { low: [0.0; 3], high: [0.0; 3] };
        for k in 0..3 {
            let mut values: Vec<f64> = dataset.points.iter().map(|p| p.position[k]).collect();
            values.sort_by(f64::total_cmp);
            let outside = (OUTSIDE * values.len() as f64) as usize;
            (out.low[k], out.high[k]) = (values[outside], values[values.len() - 1 - outside]);
        }
        let longest = (0..3).map(|k| out.high[k] - out.low[k]).fold(0.0, f64::max);
        out.widened_by(WIDENED * longest)
    }

    fn widened_by(self, by: f64) -> Self {
        Self { low: self.low.map(|v| v - by), high: self.high.map(|v| v + by) }
    }

    /// Whether a point lies in the box.
    pub fn contains(&self, p: [f64; 3]) -> bool {
        (0..3).all(|k| (self.low[k]..=self.high[k]).contains(&p[k]))
    }
}

impl fmt::Display for Bounds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z]: [[f64; 2]; 3] = std::array::from_fn(|k| [self.low[k], self.high[k]]);
        write!(f, "x {:.1} to {:.1}, y {:.1} to {:.1}, z {:.1} to {:.1}", x[0], x[1], y[0], y[1], z[0], z[1])
    }
}
