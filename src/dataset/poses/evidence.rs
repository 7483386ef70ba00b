//! How the points that a photograph observes bear out its pose.

use rayon::prelude::*;

use super::super::colmap::Point;
use super::super::lens::Lens;
use super::super::model::{Model, Observation, Shot};
use super::super::rotation;
use super::{LEAST_POINTS, PoseFault};

/// Points nearer than this share of the picture's longer side to where they are seen bear a pose out.
const NEAR: f64 = 0.02;
/// Points that far outside of the picture, as a share of its longer side, still count as inside:
/// lenses are not known to a pixel.
const MARGIN: f64 = 0.05;
/// Points of a track are looked at up to this many.
const MOST_TRACKED: usize = 256;

/// A rotation and a translation from the dataset's axes to the camera's.
pub(super) type Pose = ([[f64; 3]; 3], [f64; 3]);

/// The data by which poses are judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Where photographs show their points.
    Observations,
    /// Which points they are said to show.
    Tracks,
}

/// The evidence of the points of a photograph about its pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Evidence {
    /// Points that were looked at.
    pub(super) points: usize,
    /// Share of them that are elsewhere.
    pub(super) misfit: f64,
    /// How far off they are (median), as a share of the longer side, where that is known.
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

    /// Of points and where a photograph shows them.
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

    /// Of points that a photograph is said to show.
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

/// Of each photograph, by where it shows its points; by the tracks where it does not say.
pub(super) fn by_observations(model: &Model) -> Vec<Option<Evidence>> {
    let tracked = tracked(model);
    let of = |(shot, tracked): (&Shot, &Vec<[f64; 3]>)| {
        let seen = seen(shot, &model.points);
        let pose = (shot.rotation, shot.translation);
        Evidence::of_observations(&shot.lens, &pose, &seen).or_else(|| Evidence::of_tracks(&shot.lens, &pose, tracked))
    };
    model.shots.par_iter().zip(&tracked).map(of).collect()
}

/// Of each photograph, by which points it is said to show.
pub(super) fn by_tracks(model: &Model) -> Vec<Option<Evidence>> {
    let of = |(shot, tracked): (&Shot, &Vec<[f64; 3]>)| {
        Evidence::of_tracks(&shot.lens, &(shot.rotation, shot.translation), tracked)
    };
    model.shots.par_iter().zip(&tracked(model)).map(of).collect()
}

/// Where a photograph shows points, and the points.
pub(super) fn seen(shot: &Shot, points: &[Point]) -> Vec<([f64; 2], [f64; 3])> {
    let of = |seen: &Observation| {
        let at = points.binary_search_by_key(&seen.point, |p| p.id).ok()?;
        Some((seen.at, points.get(at)?.position))
    };
    shot.observations.iter().filter_map(of).collect()
}

/// For each photograph points that it is said to show.
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

/// Where a point lands in the picture; `None` behind the camera and beyond the lens.
fn pixel(lens: &Lens, (turned, moved): &Pose, point: [f64; 3]) -> Option<[f64; 2]> {
    let [x, y, z] = rotation::apply(turned, point);
    let [x, y, z] = [x + moved[0], y + moved[1], z + moved[2]];
    let found = lens.project([x / z, y / z]).filter(|_| z > 0.0)?;
    Some(found.0)
}
