//! Checks that cameras and points can be used in computations: values derived from finite values may overflow.

use std::path::Path;

use super::error::Error;
use super::{Point, View};
use crate::scene::Frame;

/// Refuses a camera with values that are not finite.
pub(super) fn check_camera(file: &Path, view: &View) -> Result<(), Error> {
    let camera = &view.camera;
    let focal = [camera.fx, camera.fy];
    let centred = camera.cx.is_finite() && camera.cy.is_finite();
    if !(centred && focal.iter().all(|f| f.is_finite() && *f > 0.0)) {
        return Err(of_view(file, view, "its lens leaves no picture that a pinhole camera could see"));
    }
    let pose = camera.rotation.iter().flatten().chain(&camera.translation);
    if !pose.copied().chain(camera.center()).all(f64::is_finite) {
        return Err(of_view(file, view, "its pose is beyond all range"));
    }
    Ok(())
}

/// Largest distance from the middle of a scene, which is a few units large. Sums of squares of coordinates must be
/// finite in f32.
const FARTHEST: f64 = 1e15;

/// Refuses a camera that is not finite in scene coordinates, which are f32.
pub(super) fn check_placed(file: &Path, view: &View, frame: &Frame) -> Result<(), Error> {
    let sound = frame.scale.is_finite() && frame.scale > 0.0 && frame.offset.iter().all(|v| v.is_finite());
    if sound && frame.camera_to_scene(&view.camera).translation.iter().all(|v| (*v as f32).is_finite()) {
        return Ok(());
    }
    Err(of_view(file, view, "it is too far from the others"))
}

fn of_view(file: &Path, view: &View, problem: &str) -> Error {
    let what = format!("the camera of '{}'", view.name);
    Error::OutOfRange { file: file.to_owned(), what, problem: problem.to_owned() }
}

/// Refuses a point out of range in scene coordinates, which are f32.
pub(super) fn check_point(file: &Path, point: &Point, frame: &Frame) -> Result<(), Error> {
    if frame.to_scene(point.position).iter().all(|v| v.abs() < FARTHEST) {
        return Ok(());
    }
    let what = format!("point {} at {:?}", point.id, point.position);
    Err(Error::OutOfRange { file: file.to_owned(), what, problem: "it is too far from the cameras".to_owned() })
}
