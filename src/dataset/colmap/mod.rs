//! COLMAP's sparse model, binary and text.
//!
//! The layout is that of COLMAP's documentation ("Output format"). Only the parts that training needs are kept:
//! cameras, poses, and the points with their colours and observing images. 2D keypoints are skipped, except for some of
//! each image that help to judge its pose.

mod cameras;
mod files;
mod image_lines;
mod images;
mod observers;
mod points;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::error::Error;
use super::lens::Lens;
use super::model::{Format, Model, Shot};
use super::{Tracks, Warning};
use crate::format::source::{Line, Lines, Source, whole};
use crate::format::{At, Error as FileError, few};

use cameras::Cameras;
use files::Files;
use images::{Pose, Poses};
use observers::Observers;
pub use points::Point;
use points::Points;

/// Whether a folder has a model in one of COLMAP's layouts.
pub(super) fn is_in(dataset: &Path) -> bool {
    !Files::all(dataset).is_empty()
}

/// Whether a folder has a model outside of COLMAP's layouts.
pub(super) fn is_elsewhere(dataset: &Path) -> bool {
    !Files::elsewhere(dataset).is_empty()
}

/// Whether a folder has a model outside of COLMAP's layouts, and not in the working folder of another program.
pub(super) fn is_unusual(dataset: &Path) -> bool {
    !Files::unusual(dataset).is_empty()
}

/// Reads the largest model of a dataset. Points are in ascending order of their ids, so that binary and text files give
/// equal results. Records that cannot be used are left out, or are an error where `strict` is set.
pub(super) fn read(dataset: &Path, strict: bool) -> Result<Model, Error> {
    let (files, warning) = files::choose(dataset)?;
    let mut warnings = Vec::from_iter(warning);
    let read = files.points.as_deref().map(|file| points::read(file, strict)).transpose()?;
    let Points { list: mut points, colourless, warnings: told } = read.unwrap_or_default();
    warnings.extend(told);
    let (cameras, poses) = cameras_and_poses(&files, strict, &mut warnings)?;
    let Poses { list: mut poses, left_out, mut tally } = poses;
    let needed: BTreeSet<u32> = poses.iter().map(|pose| pose.camera).collect();
    poses.sort_by(|a, b| a.name.cmp(&b.name));
    let mut observers = Observers::new(&left_out);
    let mut lenses = BTreeMap::new();
    let mut shots = Vec::with_capacity(poses.len());
    for pose in poses {
        let (name, number) = (pose.name.clone(), pose.number);
        let shot = tally.take(format_args!("'{name}'"), shot(&files, &cameras, &mut lenses, pose))?;
        observers.add(number, shot.is_some().then_some(shots.len() as u32));
        shots.extend(shot);
    }
    warnings.extend(tally.end(&files.images, "images", shots.len())?.map(Warning::LeftOut));
    warnings.extend(cameras.unneeded(&files.cameras, &needed)?.map(Warning::LeftOut));
    points.sort_by_key(|(p, _)| p.id);
    let (points, numbers): (Vec<Point>, Vec<Vec<u32>>) = points.into_iter().unzip();
    let tracks = Tracks::new(points.iter().zip(numbers).map(|(point, numbers)| observers.of(point, &numbers)));
    warnings.extend(observers.warnings(files.points.as_deref().unwrap_or(&files.images)));
    Ok(Model {
        format: Format::Colmap,
        shots,
        files: [&files.cameras, &files.images].into_iter().chain(&files.points).cloned().collect(),
        file: files.images,
        points,
        colourless,
        tracks,
        points_file: files.points,
        images: files.photographs,
        coordinates: None,
        warnings,
    })
}

fn cameras_and_poses(files: &Files, strict: bool, warnings: &mut Vec<Warning>) -> Result<(Cameras, Poses), Error> {
    if files.binary {
        return Ok((cameras::read_binary(&files.cameras, strict)?, images::read_binary(&files.images, strict)?));
    }
    let (cameras, told) = cameras::read_text(&files.cameras, strict)?;
    warnings.extend(told);
    let (poses, told) = images::read_text(&files.images, strict, |number| cameras.get(number).is_some())?;
    warnings.extend(told);
    Ok((cameras, poses))
}

fn shot(files: &Files, cameras: &Cameras, lenses: &mut BTreeMap<u32, Lens>, pose: Pose) -> Result<Shot, Error> {
    let no_camera =
        |problem: String| wrong(&files.images, pose.at, format_args!("camera of image '{}'", pose.name), problem);
    let intrinsics = match cameras.get(pose.camera) {
        Some(Ok(intrinsics)) => intrinsics,
        Some(Err(error)) => return Err(no_camera(format!("camera {} cannot be read: {error}", pose.camera)).into()),
        None => {
            return Err(no_camera(format!("there is no camera {} in {}", pose.camera, files.cameras.display())).into());
        }
    };
    let lens = match lenses.get(&pose.camera) {
        Some(lens) => *lens,
        None => *lenses.entry(pose.camera).or_insert(intrinsics.lens(&files.cameras, pose.camera)?),
    };
    Ok(Shot {
        file: pose.name.clone(),
        name: pose.name,
        camera: pose.camera.to_string(),
        model: intrinsics.model.to_owned(),
        lens,
        rotation: pose.rotation,
        translation: pose.translation,
        mask: None,
        part: None,
        observations: pose.observations,
    })
}

/// Reads a binary file of a count and that many records.
fn binary_records<T>(
    file: &Path,
    what: &str,
    smallest: u64,
    mut record: impl FnMut(&mut Source, usize) -> Result<T, FileError>,
) -> Result<Vec<T>, FileError> {
    let mut source = Source::open(file)?;
    let count = source.count(smallest, format_args!("number of {what}"))?;
    let mut out = Vec::with_capacity(count);
    for i in 0..count {
        out.push(record(&mut source, i)?);
    }
    source.end(format_args!("end of {what}"))?;
    Ok(out)
}

/// Reads a text file of one record per line. Skips comments and empty lines.
fn text_records(file: &Path, mut record: impl FnMut(Line<'_>) -> Result<(), FileError>) -> Result<Counts, FileError> {
    let mut lines = Lines::open(file)?;
    let mut announced = None;
    while let Some(line) = lines.next()? {
        if let Some(comment) = line.text.trim_start().strip_prefix('#') {
            announced = announced.or_else(|| announced_count(comment));
            continue;
        }
        if !line.text.trim().is_empty() {
            record(line.without_comment())?;
        }
    }
    Ok(Counts { announced, ended: lines.ended(), at: lines.at() })
}

/// The number of records in a comment of a text file, as COLMAP writes it.
struct Counts {
    announced: Option<u64>,
    /// Whether the last line ends with a newline.
    ended: bool,
    at: At,
}

impl Counts {
    /// Compares with the number of records found. Fewer than announced are an error where `strict` is set, and where
    /// many are missing from a file without a newline at its end.
    fn check(self, file: &Path, what: &'static str, found: usize, strict: bool) -> Result<Option<Warning>, FileError> {
        let found = found as u64;
        let Some(announced) = self.announced.filter(|announced| *announced != found) else { return Ok(None) };
        let missing = announced.saturating_sub(found);
        if missing > 0 && (strict || !(self.ended || few(missing, announced))) {
            let cut = if self.ended { "" } else { " and ends within a line" };
            let problem = format!(
                "the comment at the top announces {announced}, the file holds {found}{cut}; restore the file, or \
                 remove the comment"
            );
            return Err(wrong(file, self.at, format_args!("number of {what}"), problem));
        }
        Ok(Some(Warning::CountDiffers { file: file.to_owned(), what, announced, found }))
    }
}

/// The number in "Number of images: 12, mean observations per image: 340".
fn announced_count(comment: &str) -> Option<u64> {
    let rest = comment.trim_start().strip_prefix("Number of ")?;
    let (_, number) = rest.split_once(':')?;
    whole(number.split(',').next()?.trim())
}

/// An error about a field that begins at `at`.
fn wrong(file: &Path, at: At, field: impl std::fmt::Display, problem: impl std::fmt::Display) -> FileError {
    FileError::malformed(file, field, at, problem)
}
