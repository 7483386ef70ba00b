//! nerfstudio's `transforms.json`, as its documentation ("Data conventions") describes it; instant-ngp's is read too.
//!
//! Scenes of NeRF's own layout (Mildenhall et al. 2020) have a file for each part: `transforms_train.json`, `transforms_val.json` and
//! `transforms_test.json`.
//!
//! Poses are camera to world with the camera's x right, y up and z backwards; intrinsics stand at the top or in the frames.

use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde_json::value::RawValue;

use super::error::Error;
use super::json::Json;
use super::lens::{Distortion, Lens, names};
use super::model::{Format, Model, Shot};
use super::points_ply::Points;
use super::split::Part;
use super::{Tracks, Warning, folder, picture_file, points_ply, rotation};
use crate::format::{Error as FileError, Tally};

const FILE: &str = "transforms.json";
/// The camera model that instant-ngp's `is_fisheye` stands for.
const FISHEYE: &str = "OPENCV_FISHEYE";
/// The folder of photographs that other formats have.
const USUAL: &str = "images/";
/// The first of them has to be there.
const PARTS: [(&str, Part); 3] =
    [("transforms_train.json", Part::Train), ("transforms_val.json", Part::Val), ("transforms_test.json", Part::Test)];

/// Declares a struct with the keys of a camera, all of them optional, and others.
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
    }
}

/// The frames, each to be read alone.
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

/// Whether a folder has such files.
pub(super) fn is_in(dataset: &Path) -> bool {
    dataset.join(FILE).is_file() || dataset.join(PARTS[0].0).is_file()
}

pub(super) fn read(dataset: &Path, strict: bool) -> Result<Model, Error> {
    let files: Vec<(PathBuf, Option<Part>)> = match dataset.join(FILE) {
        file if file.is_file() => vec![(file, None)],
        _ => PARTS.iter().map(|(file, part)| (dataset.join(file), Some(*part))).collect(),
    };
    let (mut shots, mut warnings) = (Vec::new(), Vec::new());
    let mut points_file = None;
    for (file, part) in files.iter().filter(|(file, part)| part.is_none_or(|p| p == Part::Train) || file.is_file()) {
        let json = Json::open(file)?;
        let top: Transforms = json.parse()?;
        let (before, mut tally) = (shots.len(), Tally::new(strict));
        for (i, text) in json.parse::<Frames<'_>>()?.frames.into_iter().enumerate() {
            let (name, shot) = match json.parse_part::<Frame>(text.get()) {
                Ok(frame) => (format!("'{}'", frame.file_path), shot(dataset, &json, &top, &frame, *part)),
                Err(error) => (format!("frame {i}"), Err(error.into())),
            };
            shots.extend(tally.take(name, shot)?);
        }
        warnings.extend(tally.end(file, "frames", shots.len() - before)?.map(Warning::LeftOut));
        points_file = points_file.or(top.ply_file_path.map(|file| dataset.join(file)));
    }
    // The usual folder is left out of the names, so that its reduced copies can stand in for it.
    let usual = !shots.is_empty() && shots.iter().all(|shot| shot.name.starts_with(USUAL));
    if usual {
        for shot in &mut shots {
            shot.name.drain(..USUAL.len());
        }
    }
    let read = points_file.as_deref().map(|file| points_ply::read(file, strict)).transpose()?;
    let Points { list: points, colourless, left_out } = read.unwrap_or_default();
    warnings.extend(left_out.map(Warning::LeftOut));
    Ok(Model {
        format: Format::Nerfstudio,
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

fn shot(dataset: &Path, json: &Json, top: &Transforms, frame: &Frame, part: Option<Part>) -> Result<Shot, Error> {
    let name = file_of(dataset, &frame.file_path);
    // Sizes may be asked of the photographs: of no other files.
    if !folder::stays_inside(&name) {
        return Err(Error::NameOutside { file: json.file.clone(), name });
    }
    let (model, lens) = lens(json, dataset, top, frame, &name)?;
    let (rotation, translation) = pose(json, frame)?;
    let mask = frame.mask_path.as_ref().map(|mask| dataset.join(mask));
    Ok(Shot {
        name,
        camera: frame.file_path.clone(),
        model,
        lens,
        rotation,
        translation,
        mask,
        part,
        observations: Vec::new(),
    })
}

/// Paths may begin with `./`, and lack the extension.
fn file_of(dataset: &Path, path: &str) -> String {
    let mut path = path;
    while let Some(rest) = path.strip_prefix("./") {
        path = rest;
    }
    if !dataset.join(path).is_file() {
        for extension in ["png", "jpg", "jpeg", "webp"] {
            let longer = format!("{path}.{extension}");
            if dataset.join(&longer).is_file() {
                return longer;
            }
        }
    }
    path.to_owned()
}

fn lens(json: &Json, dataset: &Path, top: &Transforms, frame: &Frame, name: &str) -> Result<(String, Lens), Error> {
    let of = |key: &str| frame.number(key).or_else(|| top.number(key));
    let wrong = |key: &str, problem: String| {
        json.error(&frame.file_path, format_args!("{key} of frame '{}'", frame.file_path), problem)
    };
    let named = frame.camera_model.as_deref().or(top.camera_model.as_deref()).map(kind);
    // instant-ngp names no models, and says this of its cameras.
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
            // instant-ngp's files for made-up scenes leave the size to the photographs.
            None => {
                let found = picture_file::header(&dataset.join(name))?.size;
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

/// The name that a camera model has here, of any usual spelling.
fn kind(name: &str) -> &str {
    match names::key(name).as_str() {
        "SIMPLEPINHOLE" => "SIMPLE_PINHOLE",
        "PINHOLE" => "PINHOLE",
        "SIMPLERADIAL" => "SIMPLE_RADIAL",
        "RADIAL" => "RADIAL",
        // What other programs call a perspective camera with these coefficients, all of which may be zero.
        "OPENCV" | "PERSPECTIVE" | "BROWN" | "BROWNCONRADY" => "OPENCV",
        "OPENCVFISHEYE" | "FISHEYE" | "EQUIDISTANT" => FISHEYE,
        _ => name,
    }
}

/// World to camera, with the camera's y down and z forwards.
fn pose(json: &Json, frame: &Frame) -> Result<([[f64; 3]; 3], [f64; 3]), FileError> {
    let wrong = |problem: String| {
        json.error(&frame.file_path, format_args!("transform_matrix of frame '{}'", frame.file_path), problem)
    };
    let rows = &frame.transform_matrix;
    if !(3..=4).contains(&rows.len()) || rows.iter().any(|row| row.len() != 4) {
        return Err(wrong("is not a matrix of 3 or 4 rows with 4 values".to_owned()));
    }
    let columns = [1.0, -1.0, -1.0];
    // The transpose: from the world's axes to the camera's.
    let turned: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| rows[j][i] * columns[i]));
    if rows.get(3).is_some_and(|last| last[..3].iter().any(|v| *v != 0.0)) {
        return Err(wrong(format!("its last row is {:?} and not [0, 0, 0, 1]: the matrix may be transposed", rows[3])));
    }
    let rotation = rotation::nearest(&turned).map_err(|are| wrong(format!("its first three columns are {are}")))?;
    let center = [rows[0][3], rows[1][3], rows[2][3]];
    let translation = rotation::apply(&rotation, center).map(|v| -v);
    Ok((rotation, translation))
}
