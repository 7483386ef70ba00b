//! Leaves out a few photographs and points that cannot be used, with a warning.

use std::collections::HashSet;
use std::io::ErrorKind;

use super::error::Error;
use super::model::Model;
use super::{View, Warning, names, numeric_limits};
use crate::format::{Error as FileError, Tally};
use crate::scene::Frame;

/// Sorts the poses by name, leaves out duplicates, and makes names safe that lead out of the folder.
pub(super) fn names(model: &mut Model, strict: bool) -> Result<(), Error> {
    if model.shots.is_empty() {
        return Err(Error::NoImages { file: model.file.clone() });
    }
    model.sort();
    let mut tally = Tally::new(strict);
    let mut kept = vec![true; model.shots.len()];
    for (i, pair) in model.shots.windows(2).enumerate().filter(|(_, pair)| pair[0].name == pair[1].name) {
        let name = pair[1].name.clone();
        tally.bad(format!("'{name}'"), Error::DuplicateName { file: model.file.clone(), name })?;
        kept[i + 1] = false;
    }
    model.keep_shots(&kept);
    model.warnings.extend(tally.end(&model.file, "images", model.shots.len())?.map(Warning::LeftOut));
    made_safe(model)
}

/// Replaces names that lead out of the folder by their part that stays inside.
fn made_safe(model: &mut Model) -> Result<(), Error> {
    let outside = |name: &str| !names::stays_inside(name) || names::leads_out(name);
    if model.shots.iter().all(|shot| !outside(&shot.name)) {
        return Ok(());
    }
    let mut seen = HashSet::new();
    for shot in &mut model.shots {
        let safe = if outside(&shot.name) { names::made_safe(&shot.name) } else { shot.name.clone() };
        if safe.is_empty() || !seen.insert(safe.clone()) {
            return Err(Error::NameOutside { file: model.file.clone(), name: shot.name.clone() });
        }
        shot.name = safe;
    }
    Ok(())
}

/// The views of usable photographs. Removes the others from the model too.
pub(super) fn views(model: &mut Model, views: Vec<Result<View, Error>>, strict: bool) -> Result<Vec<View>, Error> {
    let mut tally = Tally::new(strict);
    let kept: Vec<bool> = views.iter().map(Result::is_ok).collect();
    let mut usable = Vec::with_capacity(views.len());
    // Errors come in the order of the names, so that the message does not depend on chance.
    for (shot, view) in model.shots.iter().zip(views) {
        let view = match view {
            Err(error) if !is_of_one_photograph(&error) => return Err(error),
            view => view,
        };
        usable.extend(tally.take(format_args!("'{}'", shot.name), view)?);
    }
    model.keep_shots(&kept);
    model.warnings.extend(tally.end(&model.file, "images", usable.len())?.map(Warning::LeftOut));
    Ok(usable)
}

/// Whether the error concerns a single photograph, so that the others can be used.
pub(super) fn is_of_one_photograph(error: &Error) -> bool {
    match error {
        Error::File(FileError::Io { source, .. }) => {
            !matches!(source.kind(), ErrorKind::PermissionDenied | ErrorKind::OutOfMemory)
        }
        Error::File(FileError::Malformed { .. })
        | Error::Undecodable { .. }
        | Error::AspectRatio { .. }
        | Error::MaskSize { .. }
        | Error::OutOfRange { .. } => true,
        _ => false,
    }
}

/// Leaves out views and points that are out of range in the scene. Earlier warnings about the poses of such views are
/// removed.
pub(super) fn placed(model: &mut Model, views: &mut Vec<View>, frame: &Frame, strict: bool) -> Result<(), Error> {
    let (mut tally, mut kept) = (Tally::new(strict), vec![true; views.len()]);
    for (view, kept) in views.iter().zip(&mut kept) {
        *kept = tally
            .take(format_args!("'{}'", view.name), numeric_limits::check_placed(&model.file, view, frame))?
            .is_some();
        if !*kept {
            model.warnings.retain(|warning| !is_of_pose(warning, &view.name));
        }
    }
    model.keep_shots(&kept);
    let mut each = kept.iter();
    views.retain(|_| each.next().copied().unwrap_or(true));
    model.warnings.extend(tally.end(&model.file, "images", views.len())?.map(Warning::LeftOut));

    let file = model.points_file.clone().unwrap_or_else(|| model.file.clone());
    let (mut tally, mut kept) = (Tally::new(strict), vec![true; model.points.len()]);
    for (point, kept) in model.points.iter().zip(&mut kept) {
        if let Err(error) = numeric_limits::check_point(&file, point, frame) {
            *kept = false;
            tally.bad(format_args!("point {}", point.id), error)?;
        }
    }
    model.keep_points(&kept);
    model.warnings.extend(tally.end(&file, "points", model.points.len())?.map(Warning::LeftOut));
    Ok(())
}

/// Whether a warning is about the pose of the named view.
fn is_of_pose(warning: &Warning, view: &str) -> bool {
    match warning {
        Warning::CameraFarAway { name, .. } | Warning::PoseWrong { name, .. } | Warning::PoseDoubtful { name, .. } => {
            name == view
        }
        _ => false,
    }
}
