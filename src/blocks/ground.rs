//! The plane of the ground, on which cells are drawn.

use serde::{Deserialize, Serialize};

use crate::dataset::georeference::PlaceOptions;
use crate::dataset::{Dataset, Role};
use crate::scene::{Camera, up_of};

/// Points by which axes are chosen, at most.
const LOOKED_AT: usize = 4000;
/// How far lengths and right angles may be off.
const TOLERANCE: f64 = 1e-6;

/// Axes of the ground in dataset coordinates: right-handed and orthonormal. Ground coordinates are in dataset units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ground {
    /// The place with ground coordinates 0, 0, 0.
    pub origin: [f64; 3],
    /// First axis.
    pub east: [f64; 3],
    /// Second axis.
    pub north: [f64; 3],
    /// Third axis, away from the ground.
    pub up: [f64; 3],
}

impl Ground {
    /// The ground of a dataset: east and north of the map where one is known; else up is the cameras', and east along
    /// a side of the smallest rectangle around the points. The origin is in the middle of the points. `None` without
    /// points.
    pub(super) fn of(dataset: &Dataset) -> Option<Self> {
        let mut points: Vec<[f64; 3]> = dataset.usable_points().iter().map(|point| point.position).collect();
        if dataset.begins_at_random() {
            points.extend(dataset.random_points(0).into_iter().map(|(position, _)| position));
        }
        let origin = middle(&points)?;
        if let Some([east, north, up]) = map_axes(dataset, origin) {
            return Some(Self { origin, east, north, up }).filter(|ground| ground.problem().is_none());
        }
        let cameras: Vec<Camera> = dataset.views_of(Role::Train).map(|(_, view)| view.camera).collect();
        let up = up_of(&cameras).and_then(unit).unwrap_or([0.0, 0.0, 1.0]);
        let level = Self::level(origin, up);
        let turned = level.turned(level.tightest(&points));
        Some(turned).filter(|ground| ground.problem().is_none())
    }

    /// Axes with a given third one, a unit vector.
    fn level(origin: [f64; 3], up: [f64; 3]) -> Self {
        let least = (0..3).min_by(|a, b| up[*a].abs().total_cmp(&up[*b].abs())).unwrap_or(0);
        let mut axis = [0.0; 3];
        axis[least] = 1.0;
        let along = dot(axis, up);
        let east: [f64; 3] = std::array::from_fn(|k| axis[k] - along * up[k]);
        let east = unit(east).unwrap_or([1.0, 0.0, 0.0]);
        Self { origin, east, north: cross(up, east), up }
    }

    /// The angle from east, towards north, at which the smallest rectangle around the points lies, without strays.
    fn tightest(&self, points: &[[f64; 3]]) -> f64 {
        let step = points.len().div_ceil(LOOKED_AT).max(1);
        let places: Vec<[f64; 2]> = points.iter().step_by(step).map(|point| self.place(*point)).collect();
        let area = |degrees: u32| {
            let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
            let sides = [[cos, sin], [-sin, cos]].map(|[a, b]| {
                let mut along: Vec<f64> = places.iter().map(|[x, y]| a * x + b * y).collect();
                along.sort_unstable_by(f64::total_cmp);
                let strays = along.len() / 100;
                let ends = along.get(strays).zip(along.len().checked_sub(1 + strays).and_then(|at| along.get(at)));
                ends.map_or(0.0, |(first, last)| last - first)
            });
            sides[0] * sides[1]
        };
        let best = (0..90).map(|degrees| (area(degrees), degrees)).reduce(|a, b| if b.0 < a.0 { b } else { a });
        best.map_or(0.0, |(_, degrees)| f64::from(degrees).to_radians())
    }

    fn turned(&self, angle: f64) -> Self {
        let (sin, cos) = angle.sin_cos();
        let east: [f64; 3] = std::array::from_fn(|k| cos * self.east[k] + sin * self.north[k]);
        let east = unit(east).unwrap_or(self.east);
        Self { east, north: cross(self.up, east), ..*self }
    }

    /// Ground coordinates of a dataset point: along east, north and up.
    pub fn coordinates(&self, point: [f64; 3]) -> [f64; 3] {
        let away: [f64; 3] = std::array::from_fn(|k| point[k] - self.origin[k]);
        [self.east, self.north, self.up].map(|axis| dot(axis, away))
    }

    /// Place of a dataset point on the ground.
    pub fn place(&self, point: [f64; 3]) -> [f64; 2] {
        let [x, y, _] = self.coordinates(point);
        [x, y]
    }

    /// Dataset coordinates of a point in ground coordinates.
    pub fn dataset_point(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|k| self.origin[k] + x * self.east[k] + y * self.north[k] + z * self.up[k])
    }

    /// Why these are no axes, if they are none.
    pub(super) fn problem(&self) -> Option<&'static str> {
        let axes = [self.east, self.north, self.up];
        if self.origin.iter().chain(axes.iter().flatten()).any(|v| !v.is_finite()) {
            return Some("a number is not finite");
        }
        let off = |i: usize, j: usize| (dot(axes[i], axes[j]) - f64::from(u8::from(i == j))).abs() > TOLERANCE;
        if (0..3).any(|i| (i..3).any(|j| off(i, j))) {
            return Some("east, north and up are no unit vectors at right angles");
        }
        (dot(cross(self.east, self.north), self.up) < 0.0).then_some("east, north and up are mirrored")
    }
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross([a, b, c]: [f64; 3], [d, e, f]: [f64; 3]) -> [f64; 3] {
    [b * f - c * e, c * d - a * f, a * e - b * d]
}

fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let largest = v.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    let scaled = v.map(|x| x / largest);
    let length = dot(scaled, scaled).sqrt();
    (length.is_finite() && length > 0.0).then(|| scaled.map(|x| x / length))
}

/// The median of the points along each axis.
fn middle(points: &[[f64; 3]]) -> Option<[f64; 3]> {
    let mut middle = [0.0; 3];
    for (k, middle) in middle.iter_mut().enumerate() {
        let mut along: Vec<f64> = points.iter().map(|point| point[k]).filter(|v| v.is_finite()).collect();
        if along.is_empty() {
            return None;
        }
        let half = along.len() / 2;
        *middle = *along.select_nth_unstable_by(half, f64::total_cmp).1;
    }
    Some(middle)
}

/// East, north and up of the map at a place, in the dataset's axes. `None` where no map is known.
fn map_axes(dataset: &Dataset, at: [f64; 3]) -> Option<[[f64; 3]; 3]> {
    let placed = dataset.georeference(&PlaceOptions::default()).ok()?;
    placed.georeference.system()?;
    Some(placed.georeference.similarity_at(at).rotation)
}
