//! nerfstudio's `transforms.json`, as its documentation ("Data conventions") describes it, and instant-ngp's variant.
//!
//! Scenes in NeRF's own layout (Mildenhall et al. 2020) have a file per part: `transforms_train.json`,
//! `transforms_val.json` and `transforms_test.json`.
//!
//! Poses are camera to world, with the camera's x right, y up and z backwards. Intrinsics are at the top level or in
//! the frames.

use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde_json::value::RawValue;

use super::error::Error;
use super::json::Json;
use super::lens::{Distortion, Lens, names};
use super::model::SplitParts;
use super::model::{Format, Model, Shot};
use super::names::stays_inside;
use super::names::{self as files, NameMatch, Names, Renamed};
use super::points_ply::Points;
use super::split_lists::SplitLists;
use super::{Tracks, Warning, folder, picture_file, points_ply, rotation};
use crate::format::{Error as FileError, Tally};

const FILE: &str = "transforms.json";
/// The camera model that instant-ngp's `is_fisheye` stands for.
const FISHEYE: &str = "OPENCV_FISHEYE";
/// The usual folder of photographs in other formats.
const USUAL: &str = "images/";
/// The first file is required.
const PARTS: [(&str, SplitParts); 3] = [
    ("transforms_train.json", SplitParts::TRAIN),
    ("transforms_val.json", SplitParts::VAL),
    ("transforms_test.json", SplitParts::TEST),
];

/// Declares a struct with optional keys of a camera, and other keys.
macro_rules! with_camera_keys {
    ($(#[$meta:meta])* struct $name:ident { $($(#[$fmeta:meta])* $field:ident : $type:ty,)* }) => {
        $(#[$meta])*
        #[derive(Deserialize)]
        struct $name {
            $($(#[$fmeta])* $field: $type,)*
            camera_model: Option<String>, is_fisheye: Option<bool>,
            camera_angle_x: Option<f64>, camera_angle_y: Option<f64>,
            fl_x: Option<f64>, fl_y: Option<f64>, cx: Option<f64>, cy: Option<f64>, w: Option<f64>, h: Option<f64>,
            k1: Option<f64>, k2: Option<f64>, k3: Option<f64>, k4: Option<f64>, p1: Option<f64>, p2: Option<f64>,
        }
        impl $name {
            fn number(&self, key: &str) -> Option<f64> {
                match key {
                    "camera_angle_x" => self.camera_angle_x, "camera_angle_y" => self.camera_angle_y,
                    "fl_x" => self.fl_x, "fl_y" => self.fl_y, "cx" => self.cx, "cy" => self.cy, "w" => self.w, "h" => self.h,
                    "k1" => self.k1, "k2" => self.k2, "k3" => self.k3, "k4" => self.k4, "p1" => self.p1, "p2" => self.p2,
                    _ => None,
                }
            }
        }
    };
}

with_camera_keys! {
    struct Transforms {
        ply_file_path: Option<String>,
        train_filenames: Option<Vec<String>>,
        val_filenames: Option<Vec<String>>,
        test_filenames: Option<Vec<String>>,
    }
}

/// The frames, each parsed on its own.
#[derive(Deserialize)]
struct Frames<'a> {
    #[serde(borrow)]
    frames: Vec<&'a RawValue>,
}

with_camera_keys! {
    struct Frame {
        file_path: String,
        transform_matrix: Vec<Vec<f64>>,
        mask_path: Option<String>,
    }
}

/// Whether a folder has files of this format.
pub(super) fn is_in(dataset: &Path) -> bool {
    dataset.join(FILE).is_file() || dataset.join(PARTS[0].0).is_file()
}

/// A file with frames.
struct TransformsFile {
    json: Json,
    top: Transforms,
    /// Each frame, or why it cannot be read.
    frames: Vec<Result<Frame, FileError>>,
    part: Option<SplitParts>,
}

impl TransformsFile {
    fn open(file: &Path, part: Option<SplitParts>) -> Result<Self, FileError> {
        let json = Json::open(file)?;
        let top: Transforms = json.parse()?;
        let frames = json.parse::<Frames<'_>>()?.frames.into_iter();
        let frames = frames.map(|text| json.parse_part::<Frame>(text.get())).collect();
        Ok(Self { json, top, frames, part })
    }

    fn paths(&self) -> impl Iterator<Item = &str> {
        self.frames.iter().flatten().map(|frame| frame.file_path.as_str())
    }

    /// The part of each readable frame.
    fn parts(&self, frames: &[Result<Frame, FileError>], warnings: &mut Vec<Warning>) -> Vec<Option<SplitParts>> {
        let top = &self.top;
        let lists = [&top.train_filenames, &top.val_filenames, &top.test_filenames].map(Option::as_deref);
        let paths = frames.iter().flatten().map(|frame| frame.file_path.as_str()).collect();
        let lists = SplitLists { paths, lists };
        let parts = if self.part.is_some() { None } else { lists.parts(warnings) };
        let parts = parts.map(|parts| parts.into_iter().map(Some).collect());
        parts.unwrap_or_else(|| vec![self.part; lists.paths.len()])
    }
}

pub(super) fn read(dataset: &Path, strict: bool) -> Result<Model, Error> {
    let files: Vec<(PathBuf, Option<SplitParts>)> = match dataset.join(FILE) {
        file if file.is_file() => vec![(file, None)],
        _ => PARTS.iter().map(|(file, part)| (dataset.join(file), Some(*part))).collect(),
    };
    let mut all = Vec::new();
    for (file, part) in files.iter().filter(|(file, part)| part.is_none_or(|p| p.train) || file.is_file()) {
        all.push(TransformsFile::open(file, *part)?);
    }
    let (mut shots, mut warnings) = (Vec::new(), Vec::new());
    let mut found = photographs(dataset, &all, &mut warnings).into_iter();
    for read in &mut all {
        let frames = std::mem::take(&mut read.frames);
        let (before, mut tally) = (shots.len(), Tally::new(strict));
        let mut parts = read.parts(&frames, &mut warnings).into_iter();
        for (i, frame) in frames.into_iter().enumerate() {
            let (name, shot) = match frame {
                Ok(frame) => {
                    let (found, part) = (found.next().unwrap_or(NameMatch::Missing), parts.next().flatten());
                    (format!("'{}'", frame.file_path), shot(dataset, read, &frame, &found, part))
                }
                Err(error) => (format!("frame {i}"), Err(error.into())),
            };
            shots.extend(tally.take(name, shot)?);
        }
        warnings.extend(tally.end(&read.json.file, "frames", shots.len() - before)?.map(Warning::LeftOut));
    }
    // Names omit the usual folder, so that a reduced copy of it can take its place.
    let usual = !shots.is_empty() && shots.iter().all(|shot| shot.name.starts_with(USUAL));
    if usual {
        for shot in &mut shots {
            shot.name.drain(..USUAL.len());
            shot.file.clone_from(&shot.name);
        }
    }
    let cloud = all.iter().find_map(|read| Some((read, read.top.ply_file_path.as_deref()?)));
    let points_file = cloud.map(|(read, path)| points_file(dataset, read, path, &mut warnings)).transpose()?;
    let read = points_file.as_deref().map(|file| points_ply::read(file, strict)).transpose()?;
    let Points { list: points, colourless, left_out } = read.unwrap_or_default();
    warnings.extend(left_out.map(Warning::LeftOut));
    Ok(Model {
        format: Format::Nerfstudio,
        files: all.iter().map(|read| read.json.file.clone()).chain(points_file.clone()).collect(),
        file: files.into_iter().next().map(|(file, _)| file).unwrap_or_default(),
        shots,
        points,
        colourless,
        tracks: Tracks::default(),
        points_file,
        images: (!usual).then(|| dataset.to_owned()),
        coordinates: None,
        warnings,
    })
}

/// Finds the photographs of all frames. Paths may begin with `./` and may lack the extension.
fn photographs(dataset: &Path, all: &[TransformsFile], warnings: &mut Vec<Warning>) -> Vec<NameMatch> {
    let paths: Vec<&str> = all.iter().flat_map(TransformsFile::paths).collect();
    let with = |path: &str, extension: &str| format!("{path}.{extension}");
    let forms = |path: &&str| {
        let longer = ["png", "jpg", "jpeg", "webp"].map(|extension| with(path, extension));
        std::iter::once((*path).to_owned()).chain(longer).collect()
    };
    let forms: Vec<Vec<String>> = paths.iter().map(forms).collect();
    let found = Names::look_up(dataset, &forms, folder::may_hold(true, paths.iter().copied()));
    if let Some(renamed) = Renamed::of(paths.iter().copied().zip(&found)) {
        warnings.push(Warning::OtherNames { what: "photographs", of: paths.len(), renamed });
    }
    found
}

/// The points file, which must be inside the dataset.
fn points_file(
    dataset: &Path,
    read: &TransformsFile,
    path: &str,
    warnings: &mut Vec<Warning>,
) -> Result<PathBuf, Error> {
    let is_cloud = |path: &Path| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("ply"));
    let found = Names::look_up(dataset, &[vec![path.to_owned()]], is_cloud).pop().unwrap_or(NameMatch::Missing);
    let Some(file) = found.file() else {
        // A folder in place of the file is reported when it is opened.
        if stays_inside(path) && folder::exists(&dataset.join(path))? {
            return Ok(dataset.join(path));
        }
        let nearest = files::missing(path, &found, dataset, is_cloud);
        let (file, field) = (read.json.file.clone(), "ply_file_path".to_owned());
        return Err(Error::NoSuchFile { file, field, path: path.to_owned(), nearest });
    };
    if let Some(renamed) = Renamed::of([(path, &found)]) {
        warnings.push(Warning::OtherNames { what: "clouds", of: 1, renamed });
    }
    Ok(dataset.join(file))
}

fn shot(
    dataset: &Path,
    read: &TransformsFile,
    frame: &Frame,
    found: &NameMatch,
    part: Option<SplitParts>,
) -> Result<Shot, Error> {
    let path = frame.file_path.as_str();
    let plain = |mut path: &str| {
        while let Some(rest) = path.strip_prefix("./") {
            path = rest;
        }
        path.to_owned()
    };
    let name = plain(found.file().unwrap_or(path));
    // Sizes are read from photographs only, and not from other files.
    let size = || match found.file() {
        Some(file) => Ok(picture_file::header(&dataset.join(file))?.size),
        None if stays_inside(path) && folder::exists(&dataset.join(path))? => {
            Ok(picture_file::header(&dataset.join(path))?.size)
        }
        None => {
            let is = if files::leads_out(path) { "" } else { ", which is not there" };
            let nearest = is.to_owned() + &files::instead(path, found, &[], dataset, folder::may_hold(true, [path]));
            let (file, field) = (read.json.file.clone(), "file_path".to_owned());
            Err(Error::NoSuchFile { file, field, path: path.to_owned(), nearest })
        }
    };
    let (model, lens) = lens(&read.json, &read.top, frame, size)?;
    let (rotation, translation) = pose(&read.json, frame)?;
    let mask = frame.mask_path.clone();
    let (file, camera, observations) = (name.clone(), path.to_owned(), Vec::new());
    Ok(Shot { name, file, camera, model, lens, rotation, translation, mask, part, observations })
}

/// The lens of a frame. `of_photograph` reads the photograph's size.
fn lens(
    json: &Json,
    top: &Transforms,
    frame: &Frame,
    of_photograph: impl Fn() -> Result<(u32, u32), Error>,
) -> Result<(String, Lens), Error> {
    let of = |key: &str| frame.number(key).or_else(|| top.number(key));
    let wrong = |key: &str, problem: String| {
        json.error(&frame.file_path, format_args!("{key} of frame '{}'", frame.file_path), problem)
    };
    let named = frame.camera_model.as_deref().or(top.camera_model.as_deref()).map(kind);
    // instant-ngp writes `is_fisheye` instead of a camera model.
    let model = match (named, frame.is_fisheye.or(top.is_fisheye)) {
        (Some(model), Some(fisheye)) if fisheye != (model == FISHEYE) => {
            let problem =
                format!("is {fisheye}, which contradicts the camera_model {model}: remove the one that is wrong");
            return Err(wrong("is_fisheye", problem).into());
        }
        (Some(model), _) => model,
        (None, Some(true)) => FISHEYE,
        (None, _) => "OPENCV",
    };
    let mut size = [0; 2];
    for (axis, key) in ["w", "h"].into_iter().enumerate() {
        size[axis] = match of(key) {
            Some(side) if side.fract() == 0.0 && (1.0..=1_048_576.0).contains(&side) => side as u32,
            Some(side) => return Err(wrong(key, format!("is {side}")).into()),
            // instant-ngp's files for synthetic scenes have no size: the photographs have it.
            None => {
                let found = of_photograph()?;
                [found.0, found.1][axis]
            }
        };
    }
    let sides = size.map(f64::from);
    let from_angle = |key: &str, side: f64| of(key).map(|angle| 0.5 * side / (0.5 * angle).tan());
    let fx = of("fl_x").or_else(|| from_angle("camera_angle_x", sides[0]));
    let fy = of("fl_y").or_else(|| from_angle("camera_angle_y", sides[1])).or(fx);
    let positive = |key: &str, value: Option<f64>| match value {
        Some(f) if f > 0.0 && f.is_finite() => Ok(f),
        Some(f) => Err(wrong(key, format!("is {f}"))),
        None => Err(wrong(key, "is missing, and so is camera_angle_x".to_owned())),
    };
    let focal = [positive("fl_x", fx)?, positive("fl_y", fy)?];
    let center = [of("cx").unwrap_or(0.5 * sides[0]), of("cy").unwrap_or(0.5 * sides[1])];
    let k = ["k1", "k2", "k3", "k4"].map(|key| of(key).unwrap_or(0.0));
    let distortion = match model {
        "PINHOLE" | "SIMPLE_PINHOLE" => Distortion::brown([0.0; 3], [0.0; 2]),
        "OPENCV" | "SIMPLE_RADIAL" | "RADIAL" => {
            let tangential = ["p1", "p2"].map(|key| of(key).unwrap_or(0.0));
            Distortion::Brown { numerator: k, denominator: [0.0; 3], tangential }
        }
        FISHEYE => Distortion::Fisheye { k },
        other => {
            let known = "known are SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV and OPENCV_FISHEYE";
            let problem = match names::is_panorama(other) {
                true => format!("is {other}: {}", names::PANORAMA),
                false => format!("is {other}; {known}"),
            };
            return Err(wrong("camera_model", problem).into());
        }
    };
    Ok((model.to_owned(), Lens::new(focal, center, size, distortion)))
}

/// This module's name of a camera model in any usual spelling.
fn kind(name: &str) -> &str {
    match names::key(name).as_str() {
        "SIMPLEPINHOLE" => "SIMPLE_PINHOLE",
        "PINHOLE" => "PINHOLE",
        "SIMPLERADIAL" => "SIMPLE_RADIAL",
        "RADIAL" => "RADIAL",
        // Names of perspective cameras with these coefficients, which may all be zero.
        "OPENCV" | "PERSPECTIVE" | "BROWN" | "BROWNCONRADY" => "OPENCV",
        "OPENCVFISHEYE" | "FISHEYE" | "EQUIDISTANT" => FISHEYE,
        _ => name,
    }
}

/// The pose world to camera, with the camera's y down and z forwards.
fn pose(json: &Json, frame: &Frame) -> Result<([[f64; 3]; 3], [f64; 3]), FileError> {
    let wrong = |problem: String| {
        json.error(&frame.file_path, format_args!("transform_matrix of frame '{}'", frame.file_path), problem)
    };
    let rows = &frame.transform_matrix;
    if !(3..=4).contains(&rows.len()) || rows.iter().any(|row| row.len() != 4) {
        return Err(wrong("is not a matrix of 3 or 4 rows with 4 values".to_owned()));
    }
    let columns = [1.0, -1.0, -1.0];
    // The transpose is the rotation from the world's axes to the camera's.
    let turned: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| rows[j][i] * columns[i]));
    if rows.get(3).is_some_and(|last| last[..3].iter().any(|v| *v != 0.0)) {
        return Err(wrong(format!("its last row is {:?} and not [0, 0, 0, 1]: the matrix may be transposed", rows[3])));
    }
    let rotation = rotation::nearest(&turned).map_err(|are| wrong(format!("its first three columns are {are}")))?;
    let center = [rows[0][3], rows[1][3], rows[2][3]];
    let translation = rotation::apply(&rotation, center).map(|v| -v);
    Ok((rotation, translation))
}
