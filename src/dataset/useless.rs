//! Points that a training cannot begin with, though there are some: too few, out of view,
//! or all in one spot of the pictures.

use std::fmt;
use std::path::PathBuf;

use rayon::prelude::*;

use super::colmap::Point;
use super::random_points::{begins_somewhere, in_view};
use crate::numbers::{counted, grouped, of_count};
use crate::scene::Camera;

/// A photograph is served by at least this number of points that another photograph shows too ...
const LEAST_POINTS: usize = 20;
/// ... in at least this number of cells of its picture.
const LEAST_CELLS: u32 = 6;
/// Cells along either side of a picture.
const CELLS: f64 = 8.0;
/// Points are of use where they serve at least one of this number of photographs.
const SERVED: usize = 4;
/// About the number of points that are looked at.
const LOOKED_AT: usize = 20_000;
/// What is nearer to a camera than this share of the cameras' reach is no point of the scene,
/// but the camera's own place.
const AT_A_CAMERA: f64 = 1e-3;

/// Points that a training does without: it begins as if there were none, but for those that serve some photographs.
#[derive(Clone, Debug, PartialEq)]
pub struct UselessPoints {
    /// The file with the points.
    pub file: PathBuf,
    /// All points.
    pub points: usize,
    /// Photographs to train on with enough points in the picture that others see too.
    pub served: usize,
    /// All photographs to train on.
    pub views: usize,
    /// Points of use for those photographs.
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

/// The points that are looked at, as the photographs see them.
struct Seen {
    /// For each point the photographs and the cells of their pictures;
    /// none where fewer than two have the point in view.
    by_point: Vec<Vec<(u32, u32)>>,
    /// The number of points for which each entry of `by_point` stands.
    step: usize,
}

/// Whether points are of no use for these cameras to train with, `file` being where they are from; `None` as well where
/// there is nothing to begin with in their stead.
pub(super) fn judge(file: PathBuf, cameras: &[Camera], points: &[Point]) -> Option<UselessPoints> {
    if points.is_empty() || cameras.len() < 2 {
        return None;
    }
    let step = points.len().div_ceil(LOOKED_AT).max(1);
    let own_places = OwnPlaces::of(cameras);
    let some: Vec<&Point> = points.iter().step_by(step).collect();
    let by_point = some.par_iter().map(|point| own_places.views_of(cameras, point.position)).collect();
    let serves = Seen { by_point, step }.serves(cameras.len());
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

/// Where the cameras are.
struct OwnPlaces {
    centers: Vec<[f64; 3]>,
    /// The square of what counts as being there.
    near: f64,
}

impl OwnPlaces {
    fn of(cameras: &[Camera]) -> Self {
        let centers: Vec<[f64; 3]> = cameras.iter().map(Camera::center).collect();
        let reach = centers.iter().map(|c| squared(*c, centers[0])).fold(0.0, f64::max);
        Self { centers, near: AT_A_CAMERA * AT_A_CAMERA * reach }
    }

    /// The cameras that have a point in view, with the cells of their pictures; none where it is one alone,
    /// or the point is a camera's place.
    fn views_of(&self, cameras: &[Camera], point: [f64; 3]) -> Vec<(u32, u32)> {
        let seen: Vec<(u32, u32)> =
            (0..).zip(cameras).filter_map(|(view, camera)| Some((view, cell(camera, point)?))).collect();
        let own = || self.centers.iter().any(|center| squared(*center, point) <= self.near);
        if seen.len() < 2 || own() { Vec::new() } else { seen }
    }
}

impl Seen {
    /// Whether each of `views` photographs is served.
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

/// The cell of the picture that a point lies in, if it does.
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

    /// Cameras on a circle of radius 2 that look outwards with a view of 90 degrees, or inwards.
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

    /// However many there are, and though all others have them in view: nothing is seen there from a camera.
    #[test]
    fn points_at_the_places_of_the_cameras_are_of_no_use() {
        let cameras = circle(64, false);
        let useless = judged(&cameras, cameras.iter().map(Camera::center)).expect("taken for useful");
        assert_eq!((useless.served, useless.kept.len()), (0, 0));
        // Beside the cameras the same points would do.
        let beside = cameras.iter().map(|camera| camera.center().map(|v| 0.9 * v));
        assert_eq!(judged(&cameras, beside), None);
    }

    #[test]
    fn points_that_one_camera_alone_sees_are_of_no_use() {
        // Four cameras look away from one another: what is near has one in view, what is far off and above all or two.
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
        let served =
            Seen { by_point: walls.iter().map(|p| OwnPlaces::of(&cameras).views_of(&cameras, *p)).collect(), step: 1 };
        assert_eq!(served.serves(4), [false; 4]);
    }
}
