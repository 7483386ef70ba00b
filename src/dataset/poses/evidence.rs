//! Whether the points that a photograph observes confirm its pose.

use rayon::prelude::*;

use super::super::colmap::Point;
use super::super::lens::Lens;
use super::super::model::{Model, Observation, Shot};
use super::super::rotation;
use super::{LEAST_POINTS, PoseFault};

/// A point confirms a pose where its projection is nearer to its observation than this share of the image's longer
/// side.
const NEAR: f64 = 0.02;
/// A point this far outside the image, as a share of its longer side, counts as inside: lenses are not known to a
/// pixel.
const MARGIN: f64 = 0.05;
/// Most points of a photograph's tracks that are used.
const MOST_TRACKED: usize = 256;

/// A rotation and a translation from the dataset's axes to the camera's.
pub(super) type Pose = ([[f64; 3]; 3], [f64; 3]);

/// The kind of data that judges poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum EvidenceKind {
    /// Pixel positions of observed points.
    Observations,
    /// Which points a photograph observes.
    Tracks,
}

/// Evidence of a photograph's points about its pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Evidence {
    /// Number of points used.
    pub(super) points: usize,
    /// Share of these points that do not confirm the pose.
    pub(super) misfit: f64,
    /// Median distance between projections and observations as a share of the longer side; `None` where no positions
    /// are known.
    pub(super) off: Option<f64>,
}

impl Evidence {
    pub(super) fn fault(&self, usual: f64) -> PoseFault {
        let points = self.points;
        match self.off {
            Some(off) => PoseFault::Reprojection { points, off, usual },
            None => PoseFault::OutOfView { points, inside: ((1.0 - self.misfit) * points as f64).round() as usize },
        }
    }

    /// From points and their observed positions.
    pub(super) fn of_observations(lens: &Lens, pose: &Pose, seen: &[([f64; 2], [f64; 3])]) -> Option<Self> {
        if seen.len() < LEAST_POINTS {
            return None;
        }
        let side = f64::from(lens.size[0].max(lens.size[1]));
        let off = |(at, point): &([f64; 2], [f64; 3])| match pixel(lens, pose, *point) {
            Some([u, v]) => (u - at[0]).hypot(v - at[1]) / side,
            None => f64::INFINITY,
        };
        let mut all: Vec<f64> = seen.iter().map(off).collect();
        all.sort_by(f64::total_cmp);
        let misfit = all.iter().filter(|off| **off > NEAR).count() as f64 / all.len() as f64;
        Some(Self { points: all.len(), misfit, off: Some(all[all.len() / 2]) })
    }

    /// From points that a photograph observes at unknown positions.
    pub(super) fn of_tracks(lens: &Lens, pose: &Pose, points: &[[f64; 3]]) -> Option<Self> {
        if points.len() < LEAST_POINTS {
            return None;
        }
        let [width, height] = lens.size.map(f64::from);
        let margin = MARGIN * width.max(height);
        let inside = |point: &&[f64; 3]| {
            pixel(lens, pose, **point)
                .is_some_and(|[u, v]| (-margin..width + margin).contains(&u) && (-margin..height + margin).contains(&v))
        };
        let outside = points.len() - points.iter().filter(inside).count();
        Some(Self { points: points.len(), misfit: outside as f64 / points.len() as f64, off: None })
    }
}

/// For each photograph, from its observations; from its tracks if it has none.
pub(super) fn by_observations(model: &Model) -> Vec<Option<Evidence>> {
    let tracked = tracked(model);
    let of = |(shot, tracked): (&Shot, &Vec<[f64; 3]>)| {
        let seen = seen(shot, &model.points);
        let pose = (shot.rotation, shot.translation);
        Evidence::of_observations(&shot.lens, &pose, &seen).or_else(|| Evidence::of_tracks(&shot.lens, &pose, tracked))
    };
    model.shots.par_iter().zip(&tracked).map(of).collect()
}

/// For each photograph, from its tracks.
pub(super) fn by_tracks(model: &Model) -> Vec<Option<Evidence>> {
    let of = |(shot, tracked): (&Shot, &Vec<[f64; 3]>)| {
        Evidence::of_tracks(&shot.lens, &(shot.rotation, shot.translation), tracked)
    };
    model.shots.par_iter().zip(&tracked(model)).map(of).collect()
}

/// Observed positions and points of a photograph.
pub(super) fn seen(shot: &Shot, points: &[Point]) -> Vec<([f64; 2], [f64; 3])> {
    let of = |seen: &Observation| {
        let at = points.binary_search_by_key(&seen.point, |p| p.id).ok()?;
        Some((seen.at, points.get(at)?.position))
    };
    shot.observations.iter().filter_map(of).collect()
}

/// For each photograph, points of its tracks.
pub(super) fn tracked(model: &Model) -> Vec<Vec<[f64; 3]>> {
    let mut out = vec![Vec::new(); model.shots.len()];
    for (number, point) in model.points.iter().enumerate() {
        for view in model.tracks.of(number) {
            if let Some(own) = out.get_mut(*view as usize).filter(|own| own.len() < MOST_TRACKED) {
                own.push(point.position);
            }
        }
    }
    out
}

/// The pixel of a point; `None` behind the camera or outside the lens's range.
fn pixel(lens: &Lens, (turned, moved): &Pose, point: [f64; 3]) -> Option<[f64; 2]> {
    let [x, y, z] = rotation::apply(turned, point);
    let [x, y, z] = [x + moved[0], y + moved[1], z + moved[2]];
    let found = lens.project([x / z, y / z]).filter(|_| z > 0.0)?;
    Some(found.0)
}
