//! Detects points that a training cannot begin with: too few, out of view, or all in one spot of the images.

use std::fmt;
use std::path::PathBuf;

use rayon::prelude::*;

use super::colmap::Point;
use super::random_points::{begins_somewhere, in_view};
use crate::numbers::{counted, grouped, of_count};
use crate::scene::Camera;

/// A photograph is served by at least this many points that another photograph has in view too ...
const LEAST_POINTS: usize = 20;
/// ... in at least this many cells of its image.
const LEAST_CELLS: u32 = 6;
/// Cells along each side of an image.
const CELLS: f64 = 8.0;
/// Points are of use if they serve at least one in this many photographs.
const SERVED: usize = 4;
/// Approximate number of points that are checked.
const LOOKED_AT: usize = 20_000;
/// A point nearer to a camera than this share of the cameras' extent is the camera's own position and no point of the
/// scene.
const AT_A_CAMERA: f64 = 1e-3;

/// Points that a training ignores: it begins as if it had none, except those that serve some photographs.
#[derive(Clone, Debug, PartialEq)]
pub struct UselessPoints {
    /// The file with the points.
    pub file: PathBuf,
    /// Number of all points.
    pub points: usize,
    /// Training photographs with enough points in view that other photographs see too.
    pub served: usize,
    /// All training photographs.
    pub views: usize,
    /// Points that serve some photographs.
    pub kept: Vec<Point>,
}

impl fmt::Display for UselessPoints {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, points, served, views, kept } = self;
        write!(
            f,
            "{}: the points are of little use: of {} to train on {} {} {LEAST_POINTS} of them or more, spread over \
             the picture, that another photograph has in view too. ",
            file.display(),
            counted(*views, "photograph"),
            grouped(*served),
            of_count(*served, "has", "have")
        )?;
        if !kept.is_empty() {
            write!(
                f,
                "{} of {} {} kept. ",
                grouped(kept.len()),
                counted(*points, "point"),
                of_count(kept.len(), "is", "are")
            )?;
        }
        write!(
            f,
            "Training starts as without points: from random ones in the cameras' common view, or from the surfaces \
             that stereo finds"
        )
    }
}

/// The checked points in the images of the photographs.
struct Sightings {
    /// For each point the photographs and the cells of their images; empty if fewer than two have the point in view.
    by_point: Vec<Vec<(u32, u32)>>,
    /// Number of points per entry of `by_point`.
    step: usize,
}

/// Whether these points are useless for a training with these cameras. `file` holds the points. `None` also if there is
/// nothing else to begin with.
pub(super) fn judge(file: PathBuf, cameras: &[Camera], points: &[Point]) -> Option<UselessPoints> {
    if points.is_empty() || cameras.len() < 2 {
        return None;
    }
    let step = points.len().div_ceil(LOOKED_AT).max(1);
    let own_places = OwnPlaces::of(cameras);
    let some: Vec<&Point> = points.iter().step_by(step).collect();
    let by_point = some.par_iter().map(|point| own_places.views_of(cameras, point.position)).collect();
    let serves = Sightings { by_point, step }.serves(cameras.len());
    let served = serves.iter().filter(|serves| **serves).count();
    if SERVED * served >= cameras.len() || !begins_somewhere(cameras) {
        return None;
    }
    let of_use = |point: &&Point| {
        served > 0 && own_places.views_of(cameras, point.position).iter().any(|(view, _)| serves[*view as usize])
    };
    let kept = points.par_iter().filter(of_use).copied().collect();
    Some(UselessPoints { file, points: points.len(), served, views: cameras.len(), kept })
}

/// The positions of the cameras.
struct OwnPlaces {
    centers: Vec<[f64; 3]>,
    /// Square of the distance below which a point is at a camera.
    near: f64,
}

impl OwnPlaces {
    fn of(cameras: &[Camera]) -> Self {
        let centers: Vec<[f64; 3]> = cameras.iter().map(Camera::center).collect();
        let reach = centers.iter().map(|c| squared(*c, centers[0])).fold(0.0, f64::max);
        Self { centers, near: AT_A_CAMERA * AT_A_CAMERA * reach }
    }

    /// The cameras that have a point in view, with the cells of their images; empty for a single camera, and for a
    /// point at a camera.
    fn views_of(&self, cameras: &[Camera], point: [f64; 3]) -> Vec<(u32, u32)> {
        let seen: Vec<(u32, u32)> =
            (0..).zip(cameras).filter_map(|(view, camera)| Some((view, cell(camera, point)?))).collect();
        let own = || self.centers.iter().any(|center| squared(*center, point) <= self.near);
        if seen.len() < 2 || own() { Vec::new() } else { seen }
    }
}

impl Sightings {
    /// For each of `views` photographs, whether it is served.
    fn serves(&self, views: usize) -> Vec<bool> {
        let (mut points, mut cells) = (vec![0; views], vec![0_u64; views]);
        for (view, cell) in self.by_point.iter().flatten() {
            points[*view as usize] += self.step;
            cells[*view as usize] |= 1 << cell;
        }
        let enough = |(points, cells): (&usize, &u64)| *points >= LEAST_POINTS && cells.count_ones() >= LEAST_CELLS;
        points.iter().zip(&cells).map(enough).collect()
    }
}

fn squared(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum()
}

/// The image cell of a point; `None` outside the image.
fn cell(camera: &Camera, point: [f64; 3]) -> Option<u32> {
    if !in_view(camera, point) {
        return None;
    }
    let center = camera.center();
    let [x, y, z] = camera.rotation.map(|row| (0..3).map(|k| row[k] * (point[k] - center[k])).sum::<f64>());
    let along = |at: f64, side: u32| ((CELLS * at / f64::from(side)) as u32).min(CELLS as u32 - 1);
    let column = along(camera.fx * x / z + camera.cx, camera.width);
    Some(CELLS as u32 * along(camera.fy * y / z + camera.cy, camera.height) + column)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    /// Cameras on a circle of radius 2 that look outwards or inwards, with a field of view of 90 degrees.
    fn circle(count: u32, outwards: bool) -> Vec<Camera> {
        let of = |k: u32| {
            let (s, c) = (TAU * f64::from(k) / f64::from(count)).sin_cos();
            let (sign, to_center) = if outwards { (1.0, -2.0) } else { (-1.0, 2.0) };
            let rotation = [[-s * sign, c * sign, 0.0], [0.0, 0.0, -1.0], [c * sign, s * sign, 0.0]];
            let (fx, fy, cx, cy) = (40.0, 40.0, 40.0, 40.0);
            Camera { rotation, translation: [0.0, 0.0, to_center], fx, fy, cx, cy, width: 80, height: 80 }
        };
        (0..count).map(of).collect()
    }

    fn judged(cameras: &[Camera], positions: impl Iterator<Item = [f64; 3]>) -> Option<UselessPoints> {
        let point = |(id, position)| Point { id, position, colour: [0; 3], error: 0.0, track: 0 };
        judge("points".into(), cameras, &(0..).zip(positions).map(point).collect::<Vec<_>>())
    }

    /// Cameras see nothing at their own positions, however many points are there and though all other cameras have them
    /// in view.
    #[test]
    fn points_at_the_places_of_the_cameras_are_of_no_use() {
        let cameras = circle(64, false);
        let useless = judged(&cameras, cameras.iter().map(Camera::center)).expect("taken for useful");
        assert_eq!((useless.served, useless.kept.len()), (0, 0));
        // Slightly off the cameras' positions the same points are of use.
        let beside = cameras.iter().map(|camera| camera.center().map(|v| 0.9 * v));
        assert_eq!(judged(&cameras, beside), None);
    }

    #[test]
    fn points_that_one_camera_alone_sees_are_of_no_use() {
        // Four cameras look away from one another. Near points are in view of one camera, and far ones above all of
        // two.
        let cameras = circle(4, true);
        let wall = |camera: &Camera| {
            let (r, c) = (camera.rotation, camera.center());
            let at = move |u: f64, v: f64| std::array::from_fn(|k| c[k] + r[0][k] * u + r[1][k] * v + r[2][k]);
            (0..64).map(move |k| at(0.24 * f64::from(k % 8) - 0.84, 0.24 * f64::from(k / 8) - 0.84)).collect::<Vec<_>>()
        };
        let walls: Vec<[f64; 3]> = cameras.iter().flat_map(wall).collect();
        assert!(walls.iter().all(|p| cameras.iter().filter(|camera| in_view(camera, *p)).count() == 1));
        let again: Vec<Camera> = cameras.iter().chain(&cameras).copied().collect();
        assert_eq!(judged(&again, walls.iter().copied()), None, "seen by two each");
        let served = Sightings {
            by_point: walls.iter().map(|p| OwnPlaces::of(&cameras).views_of(&cameras, *p)).collect(),
            step: 1,
        };
        assert_eq!(served.serves(4), [false; 4]);
    }
}
