//! Detects poses that all have another convention than that of their format.

use std::fmt;

use super::super::model::{Format, Model, Shot};
use super::super::random_points::in_view;
use super::super::{Error, rotation};
use super::evidence::{self, Evidence, EvidenceKind, Pose};
use super::{LEAST_POINTS, WRONG};
use crate::scene::Camera;

/// Least share of photographs that another convention has to fit.
const BORNE_OUT: f64 = 0.8;
/// Most points of a cloud that are used where the format does not say which photograph observes a point, about.
const LOOKED_AT: usize = 5000;
/// Without observations: least share of the cloud in an image for another convention to be accepted.
const IN_SIGHT: f64 = 0.1;
/// A photograph with less than this share of the cloud in its image sees next to nothing.
const NEXT_TO_NOTHING: f64 = 0.005;

/// A convention of poses other than the format's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Convention {
    /// The other direction: camera to world instead of world to camera, or the reverse.
    Inverted,
    /// Other camera axes: y up and z backwards (OpenGL, Blender) instead of y down and z forwards (OpenCV), or the
    /// reverse.
    OtherAxes,
    /// Both differences.
    InvertedWithOtherAxes,
}

impl Convention {
    /// All conventions.
    pub const ALL: [Self; 3] = [Self::Inverted, Self::OtherAxes, Self::InvertedWithOtherAxes];

    /// Converts a pose, as it was read, from this convention to the format's.
    fn read(self, format: Format, pose: &Pose) -> Pose {
        let flipped = |[x, y, z]: [f64; 3]| [x, -y, -z];
        // Flips the camera's axes, or the world's.
        let axes = |(r, t): Pose| -> Pose { ([r[0], r[1].map(|v| -v), r[2].map(|v| -v)], flipped(t)) };
        let world = |(r, t): Pose| -> Pose { (r.map(flipped), t) };
        let back = |(r, t): &Pose| -> Pose {
            let turned: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|k| r[k][i]));
            (turned, rotation::apply(&turned, *t).map(|v| -v))
        };
        match (self, format) {
            // The second and third column of a matrix in transforms.json are negated when it is read: `world` undoes
            // this after `back`.
            (Self::Inverted, Format::Nerfstudio) => axes(world(back(pose))),
            (Self::InvertedWithOtherAxes, Format::Nerfstudio) => world(back(pose)),
            (Self::Inverted, _) => back(pose),
            (Self::InvertedWithOtherAxes, _) => axes(back(pose)),
            (Self::OtherAxes, _) => axes(*pose),
        }
    }

    /// Converts a camera, as it was read, from this convention to the format's.
    pub(super) fn camera(self, format: Format, camera: &Camera) -> Camera {
        let (rotation, translation) = self.read(format, &(camera.rotation, camera.translation));
        Camera { rotation, translation, ..*camera }
    }

    /// Describes the poses in the terms of a format, with the remedy.
    fn told(self, format: Format) -> &'static str {
        match (self, format) {
            (Self::Inverted, Format::Nerfstudio) => {
                "world to camera, and transforms.json has them from the camera to the world: invert every \
                 transform_matrix"
            }
            (Self::Inverted, _) => {
                "camera to world, and this format has them from the world to the camera: invert every rotation and \
                 translation"
            }
            (Self::OtherAxes, Format::Nerfstudio) => {
                "of cameras with y down and z forwards (OpenCV), and transforms.json has y up and z backwards \
                 (OpenGL): change the sign of the second and third column of every transform_matrix"
            }
            (Self::OtherAxes, _) => {
                "of cameras with y up and z backwards (OpenGL, Blender), and this format has y down and z forwards \
                 (OpenCV): turn every camera by half a turn about its x axis"
            }
            (Self::InvertedWithOtherAxes, Format::Nerfstudio) => {
                "world to camera with y down and z forwards (OpenCV), and transforms.json has them from the camera to \
                 the world with y up and z backwards (OpenGL): invert every transform_matrix, then change the sign of \
                 its second and third column"
            }
            (Self::InvertedWithOtherAxes, _) => {
                "camera to world with y up and z backwards (OpenGL, Blender), and this format has them from the world \
                 to the camera with y down and z forwards (OpenCV): change the sign of the second and third column of \
                 every matrix, then invert it"
            }
        }
    }
}

/// Poses in another convention than that of their format, with the remedy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WrongConvention {
    /// The format.
    pub format: Format,
    /// The convention of the poses.
    pub found: Convention,
}

impl fmt::Display for WrongConvention {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.found.told(self.format))
    }
}

/// Fails where the points fit another convention of the poses better than the format's.
pub(super) fn refuse(model: &Model, as_read: &[Option<Evidence>], kind: EvidenceKind) -> Result<(), Error> {
    let tracked = evidence::tracked(model);
    let judged: Vec<usize> =
        (0..model.shots.len()).filter(|at| as_read.get(*at).is_some_and(Option::is_some)).collect();
    let fits = |at: usize, pose: &Pose| {
        let shot = &model.shots[at];
        let own = match kind {
            EvidenceKind::Observations => {
                Evidence::of_observations(&shot.lens, pose, &evidence::seen(shot, &model.points))
            }
            EvidenceKind::Tracks => None,
        };
        let found = own.or_else(|| Evidence::of_tracks(&shot.lens, pose, tracked.get(at)?));
        found.is_some_and(|found| found.misfit <= WRONG)
    };
    refuse_best(model, &judged, |at, pose| fits(at, pose))
}

/// [`refuse`] where the format does not say which photograph observes a point: with the poses as read, most photographs
/// see next to nothing of the cloud, and in another convention nearly all see a good part.
pub(super) fn refuse_by_sight(model: &Model) -> Result<(), Error> {
    let step = model.points.len().div_ceil(LOOKED_AT).max(1);
    let some: Vec<[f64; 3]> = model.points.iter().step_by(step).map(|p| p.position).collect();
    if some.len() < 5 * LEAST_POINTS || model.shots.len() < 3 {
        return Ok(());
    }
    let share = |shot: &Shot, pose: &Pose| {
        let camera = pinhole(shot, pose);
        some.iter().filter(|p| in_view(&camera, **p)).count() as f64 / some.len() as f64
    };
    let blind = |shot: &&Shot| share(shot, &(shot.rotation, shot.translation)) < NEXT_TO_NOTHING;
    if 2 * model.shots.iter().filter(blind).count() < model.shots.len() {
        return Ok(());
    }
    let all: Vec<usize> = (0..model.shots.len()).collect();
    refuse_best(model, &all, |at, pose| share(&model.shots[at], pose) > IN_SIGHT)
}

/// Fails where another convention holds for nearly all of these photographs.
fn refuse_best(model: &Model, of: &[usize], holds: impl Fn(usize, &Pose) -> bool) -> Result<(), Error> {
    let count = |found: &Convention| {
        let read = |at: &&usize| {
            let shot = &model.shots[**at];
            holds(**at, &found.read(model.format, &(shot.rotation, shot.translation)))
        };
        of.iter().filter(read).count()
    };
    let best = Convention::ALL.into_iter().map(|found| (count(&found), found)).max_by_key(|(count, _)| *count);
    match best.filter(|(count, _)| *count as f64 >= BORNE_OUT * of.len() as f64) {
        Some((_, found)) => {
            let what = WrongConvention { format: model.format, found };
            Err(Error::PosesInOtherConvention { file: model.file.clone(), what })
        }
        None => Ok(()),
    }
}

/// The shot's pinhole camera without distortion.
fn pinhole(shot: &Shot, (rotation, translation): &Pose) -> Camera {
    let lens = &shot.lens;
    Camera {
        rotation: *rotation,
        translation: *translation,
        fx: lens.focal[0],
        fy: lens.focal[1],
        cx: lens.center[0],
        cy: lens.center[1],
        width: lens.size[0],
        height: lens.size[1],
    }
}
