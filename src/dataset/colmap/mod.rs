//! COLMAP's sparse model, binary and text.
//!
//! The layout is that of COLMAP's documentation ("Output format"). Only what training needs is kept: cameras, poses, and the
//! points with their colours and the images that observe them; the 2D keypoints are checked for being there and passed over.

mod cameras;
mod files;
mod images;
mod points;

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use super::Tracks;
use super::error::Error;
use super::lens::Lens;
use super::model::{Format, Model, Shot};
use crate::format::source::{Line, Lines, Source};
use crate::format::{At, Error as FileError};

use cameras::Intrinsics;
pub(super) use cameras::SUPPORTED;
use files::Files;
use images::Pose;
pub use points::Point;

/// Whether a folder has a model.
pub(super) fn is_in(dataset: &Path) -> bool {
    !Files::all(dataset).is_empty()
}

/// Reads the model of a dataset, the largest where there are several. Points are in ascending order of their ids, which is the same for both kinds of files.
pub(super) fn read(dataset: &Path) -> Result<Model, Error> {
    let (files, warning) = files::choose(dataset)?;
    let (cameras, poses) = if files.binary {
        (cameras::read_binary(&files.cameras)?, images::read_binary(&files.images)?)
    } else {
        (cameras::read_text(&files.cameras)?, images::read_text(&files.images)?)
    };
    let (points, colourless) = files.points.as_deref().map(points::read).transpose()?.unwrap_or_default();
    let mut poses = poses;
    poses.sort_by(|a, b| a.name.cmp(&b.name));
    let places: HashMap<u32, u32> = poses.iter().zip(0..).map(|(pose, place)| (pose.number, place)).collect();
    let mut points = points;
    points.sort_by_key(|(p, _)| p.id);
    let (points, observers): (Vec<Point>, Vec<Vec<u32>>) = points.into_iter().unzip();
    let known = |numbers: Vec<u32>| numbers.iter().filter_map(|number| places.get(number).copied()).collect();
    let mut lenses = BTreeMap::new();
    let shots = poses.into_iter().map(|pose| shot(&files, &cameras, &mut lenses, pose));
    Ok(Model {
        format: Format::Colmap,
        shots: shots.collect::<Result<_, Error>>()?,
        file: files.images,
        points,
        colourless,
        tracks: Tracks::new(observers.into_iter().map(known)),
        points_file: files.points,
        images: None,
        reference: None,
        warnings: warning.into_iter().collect(),
    })
}

fn shot(
    files: &Files,
    cameras: &BTreeMap<u32, Intrinsics>,
    lenses: &mut BTreeMap<u32, Lens>,
    pose: Pose,
) -> Result<Shot, Error> {
    let intrinsics = cameras.get(&pose.camera).ok_or_else(|| {
        let problem = format!("there is no camera {} in {}", pose.camera, files.cameras.display());
        wrong(&files.images, pose.at, format_args!("camera of image '{}'", pose.name), problem)
    })?;
    let lens = match lenses.get(&pose.camera) {
        Some(lens) => *lens,
        None => *lenses.entry(pose.camera).or_insert(intrinsics.lens(&files.cameras, pose.camera)?),
    };
    Ok(Shot {
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

/// Opens a binary file that is a count and that many records, and reads them.
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

/// What takes the second line of a record.
type SecondLine<'a> = &'a mut dyn FnMut(Line<'_>) -> Result<(), FileError>;

/// Reads a text file of one record per line, or per two lines when `second_line` is there to check the second; comments and
/// empty lines between records are passed over. COLMAP writes the number of records into a comment; fewer than that many means a truncated file.
fn text_records<T>(
    file: &Path,
    what: &str,
    mut record: impl FnMut(Line<'_>) -> Result<T, FileError>,
    mut second_line: Option<SecondLine<'_>>,
) -> Result<Vec<T>, FileError> {
    let mut lines = Lines::open(file)?;
    let mut out = Vec::new();
    let mut announced = None;
    while let Some(line) = lines.next()? {
        if let Some(comment) = line.text.trim_start().strip_prefix('#') {
            announced = announced.or_else(|| announced_count(comment));
            continue;
        }
        if line.text.trim().is_empty() {
            continue;
        }
        out.push(record(line)?);
        if let Some(check) = &mut second_line {
            match lines.next()? {
                Some(line) => check(line)?,
                None if announced.is_some() => return Err(lines.error(what, "the last one lacks its second line")),
                None => {}
            }
        }
    }
    match announced {
        Some(count) if count > out.len() as u64 => Err(lines.error(
            format_args!("number of {what}"),
            format_args!(
                "the comment at the top announces {count}, the file holds {}; restore the file, or remove the comment",
                out.len()
            ),
        )),
        Some(_) if !lines.ended() => Err(lines.error(what, "the file ends within a line")),
        _ => Ok(out),
    }
}

/// The number in "Number of images: 12, mean observations per image: 340".
fn announced_count(comment: &str) -> Option<u64> {
    let rest = comment.trim_start().strip_prefix("Number of ")?;
    let (_, number) = rest.split_once(':')?;
    number.split(',').next()?.trim().parse().ok()
}

/// Complains of a value in a field that begins at `at`.
fn wrong(file: &Path, at: At, field: impl std::fmt::Display, problem: impl std::fmt::Display) -> FileError {
    FileError::malformed(file, field, at, problem)
}
