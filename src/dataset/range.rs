//! Whether a dataset's numbers can be computed with: each of a file may be finite, and what follows from them not.

use std::path::Path;

use super::error::Error;
use super::{Point, View};
use crate::scene::Frame;

/// Refuses cameras that are not finite, in the dataset and in the scene, where they are f32.
pub(super) fn check_views(file: &Path, views: &[View], frame: &Frame) -> Result<(), Error> {
    let wrong = |what: String, problem: &str| {
        Err(Error::OutOfRange { file: file.to_owned(), what, problem: problem.to_owned() })
    };
    for view in views {
        let (what, camera) = (|| format!("the camera of '{}'", view.name), &view.camera);
        let focal = [camera.fx, camera.fy];
        let centred = camera.cx.is_finite() && camera.cy.is_finite();
        if !(centred && focal.iter().all(|f| f.is_finite() && *f > 0.0)) {
            return wrong(what(), "its lens leaves no picture that a pinhole camera could see");
        }
        let pose = camera.rotation.iter().flatten().chain(&camera.translation);
        if !pose.copied().chain(camera.center()).all(f64::is_finite) {
            return wrong(what(), "its pose is beyond all range");
        }
    }
    let sound = frame.scale.is_finite() && frame.scale > 0.0 && frame.offset.iter().all(|v| v.is_finite());
    let placed = |view: &View| frame.camera_to_scene(&view.camera).translation.iter().all(|v| (*v as f32).is_finite());
    match views.iter().find(|view| !sound || !placed(view)) {
        Some(view) => wrong(format!("the camera of '{}'", view.name), "it is too far from the others"),
        None => Ok(()),
    }
}

/// Refuses points that have no place in the scene, where they are f32.
pub(super) fn check_points(file: &Path, points: &[Point], frame: &Frame) -> Result<(), Error> {
    let placed = |p: &&Point| frame.to_scene(p.position).iter().all(|v| (*v as f32).is_finite());
    match points.iter().find(|p| !placed(p)) {
        Some(p) => {
            let what = format!("point {} at {:?}", p.id, p.position);
            Err(Error::OutOfRange { file: file.to_owned(), what, problem: "it is too far from the cameras".to_owned() })
        }
        None => Ok(()),
    }
}
