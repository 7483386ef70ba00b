//! `cameras.bin` and `cameras.txt`.

use crate::dataset::lens::SUPPORTED_MODELS;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::{binary_records, text_records, wrong};
use crate::dataset::lens::{Distortion, Lens, names};
use crate::dataset::{Error, Warning};
use crate::format::source::{Line, Source};
use crate::format::{At, Error as FileError, LeftOut, Tally};

/// COLMAP's camera models in the order of their numbers, with their numbers of parameters.
const MODELS: &[(&str, usize)] = &[
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    ("SIMPLE_DIVISION", 4),
    ("DIVISION", 5),
    ("SIMPLE_FISHEYE", 3),
    ("FISHEYE", 4),
    ("EUCM", 6),
    ("EQUIRECTANGULAR", 2),
];

/// A camera of the model.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Intrinsics {
    /// COLMAP's name of the camera model.
    pub(crate) model: &'static str,
    pub(crate) width: u32,
    pub(crate) height: u32,
    params: Vec<f64>,
}

impl Intrinsics {
    /// The lens, for the camera models that COLMAP's documentation ("Camera models") describes in full.
    pub(crate) fn lens(&self, file: &Path, camera: u32) -> Result<Lens, Error> {
        let none = Distortion::brown([0.0; 3], [0.0; 2]);
        let fisheye = |k1, k2, k3, k4| Distortion::Fisheye { k: [k1, k2, k3, k4] };
        let (focal, center, distortion) = match (self.model, self.params.as_slice()) {
            ("SIMPLE_PINHOLE", &[f, cx, cy]) => ([f, f], [cx, cy], none),
            ("PINHOLE", &[fx, fy, cx, cy]) => ([fx, fy], [cx, cy], none),
            ("SIMPLE_RADIAL", &[f, cx, cy, k]) => ([f, f], [cx, cy], Distortion::brown([k, 0.0, 0.0], [0.0; 2])),
            ("RADIAL", &[f, cx, cy, k1, k2]) => ([f, f], [cx, cy], Distortion::brown([k1, k2, 0.0], [0.0; 2])),
            ("OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2]) => {
                ([fx, fy], [cx, cy], Distortion::brown([k1, k2, 0.0], [p1, p2]))
            }
            ("FULL_OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6]) => {
                let (numerator, denominator) = ([k1, k2, k3, 0.0], [k4, k5, k6]);
                ([fx, fy], [cx, cy], Distortion::Brown { numerator, denominator, tangential: [p1, p2] })
            }
            ("SIMPLE_RADIAL_FISHEYE", &[f, cx, cy, k]) => ([f, f], [cx, cy], fisheye(k, 0.0, 0.0, 0.0)),
            ("RADIAL_FISHEYE", &[f, cx, cy, k1, k2]) => ([f, f], [cx, cy], fisheye(k1, k2, 0.0, 0.0)),
            ("OPENCV_FISHEYE", &[fx, fy, cx, cy, k1, k2, k3, k4]) => ([fx, fy], [cx, cy], fisheye(k1, k2, k3, k4)),
            _ => return Err(Error::UnsupportedCamera { file: file.to_owned(), camera, model: self.model }),
        };
        Ok(Lens::new(focal, center, [self.width, self.height], distortion))
    }
}

/// More parameters than any camera model of COLMAP has.
const MOST_PARAMETERS: usize = 32;

/// The cameras of a model by their numbers, each read or with its error.
pub(crate) struct Cameras {
    strict: bool,
    by_number: BTreeMap<u32, Result<Intrinsics, FileError>>,
    /// Errors of cameras that no image can name, and of repeated cameras.
    beside: Tally<FileError>,
    count: usize,
}

impl Cameras {
    fn new(strict: bool) -> Self {
        Self { strict, by_number: BTreeMap::new(), beside: Tally::new(strict), count: 0 }
    }

    /// The camera with a number.
    pub(crate) fn get(&self, number: u32) -> Option<&Result<Intrinsics, FileError>> {
        self.by_number.get(&number)
    }

    fn add(
        &mut self,
        file: &Path,
        at: At,
        number: u32,
        camera: Result<Intrinsics, FileError>,
    ) -> Result<(), FileError> {
        self.count += 1;
        let camera = if self.strict { Ok(camera?) } else { camera };
        let again = || wrong(file, at, "camera", format_args!("the number {number} occurs twice"));
        match self.by_number.get(&number) {
            None => drop(self.by_number.insert(number, camera)),
            Some(Ok(before)) if camera.as_ref().is_ok_and(|camera| camera == before) => {
                self.beside.bad(format_args!("camera {number}"), again())?;
            }
            // Two cameras with one number: which one the images mean is not known.
            Some(_) if self.strict => return Err(again()),
            Some(_) => drop(self.by_number.insert(number, Err(again()))),
        }
        Ok(())
    }

    /// The warning about unusable cameras that no image needs.
    pub(crate) fn unneeded(mut self, file: &Path, needed: &BTreeSet<u32>) -> Result<Option<LeftOut>, FileError> {
        for (number, camera) in self.by_number {
            if let (Err(error), false) = (camera, needed.contains(&number)) {
                self.beside.bad(format_args!("camera {number}"), error)?;
            }
        }
        Ok(self.beside.told(file, "cameras", self.count))
    }
}

/// Reads `cameras.bin`: per camera i32 number, i32 model, u64 width, u64 height, f64 parameters.
pub(crate) fn read_binary(file: &Path, strict: bool) -> Result<Cameras, FileError> {
    let first = match binary(file, strict, None) {
        Ok(cameras) => return Ok(cameras),
        Err(error) if strict => return Err(error),
        Err(error) => error,
    };
    // A camera with an unknown model has an unknown number of parameters: the number with which the rest of the file
    // can be read as cameras.
    let mut fitting = (0..=MOST_PARAMETERS).filter_map(|count| binary(file, false, Some(count)).ok());
    match (fitting.next(), fitting.next()) {
        (Some(cameras), None) => Ok(cameras),
        _ => Err(first),
    }
}

/// Reads the cameras, with `unknown` parameters for each unknown model. Where `strict` is set, an unsound camera is an
/// error.
fn binary(file: &Path, strict: bool, unknown: Option<usize>) -> Result<Cameras, FileError> {
    let mut cameras = Cameras::new(strict);
    binary_records(file, "cameras", 24, |source, i| {
        let start = source.at();
        let id = source.u32(format_args!("number of camera {i}"))?;
        let at = source.at();
        let number = source.i32(format_args!("model of camera {id}"))?;
        let known = usize::try_from(number).ok().and_then(|n| MODELS.get(n));
        let not_known = source.error(
            at,
            format_args!("model of camera {id}"),
            format_args!("{number} is unknown; supported are {SUPPORTED_MODELS}"),
        );
        let (model, count) = match (known, unknown) {
            (Some((model, count)), _) => (Ok(*model), *count),
            (None, Some(count)) => (Err(not_known), count),
            (None, None) => return Err(not_known),
        };
        let camera = binary_camera(source, file, id, model, count)?;
        match (known, unknown, camera) {
            (Some(_), Some(_), Err(error)) => Err(error),
            (.., camera) => cameras.add(file, At::Byte(start), id, camera),
        }
    })?;
    Ok(cameras)
}

/// Reads the fields after the camera model.
fn binary_camera(
    source: &mut Source,
    file: &Path,
    id: u32,
    model: Result<&'static str, FileError>,
    count: usize,
) -> Result<Result<Intrinsics, FileError>, FileError> {
    let at = source.at();
    let size = [source.u64(format_args!("width of camera {id}"))?, source.u64(format_args!("height of camera {id}"))?];
    let params_at = source.at();
    let (mut params, mut infinite) = (Vec::with_capacity(count), None);
    for k in 0..count {
        let (at, field) = (source.at(), format!("parameter {k} of camera {id}"));
        let value = source.f64(&field)?;
        if !value.is_finite() {
            infinite = infinite.or(Some(wrong(file, At::Byte(at), field, format_args!("is {value}"))));
        }
        params.push(value);
    }
    Ok(match (model, infinite) {
        (Err(error), _) | (_, Some(error)) => Err(error),
        (Ok(model), None) => checked(file, [At::Byte(at), At::Byte(params_at)], id, model, size, params),
    })
}

/// Reads `cameras.txt`: per line number, model, width, height, parameters.
pub(crate) fn read_text(file: &Path, strict: bool) -> Result<(Cameras, Option<Warning>), FileError> {
    let mut cameras = Cameras::new(strict);
    let mut position = 0;
    let counts = text_records(file, |mut line| {
        let at = line.at();
        let number = line.whole::<u32>(format_args!("number of camera {position}"));
        position += 1;
        match number {
            Ok(id) => match text_camera(&mut line, file, id) {
                Err(error) if !line.ended => Err(error),
                camera => cameras.add(file, at, id, camera),
            },
            Err(error) if !line.ended => Err(error),
            Err(error) => {
                cameras.count += 1;
                cameras.beside.bad(format_args!("'{}'", line.text.trim()), error)
            }
        }
    })?;
    let warning = counts.check(file, "cameras", cameras.count, strict)?;
    Ok((cameras, warning))
}

fn text_camera(line: &mut Line<'_>, file: &Path, id: u32) -> Result<Intrinsics, FileError> {
    let word = line.word(format_args!("model of camera {id}"))?;
    let size = [line.whole(format_args!("width of camera {id}")), line.whole(format_args!("height of camera {id}"))];
    let given = line.left();
    let &(model, count) = named(word, given).ok_or_else(|| {
        line.error(
            format_args!("model of camera {id}"),
            format_args!("'{word}' is unknown; supported are {SUPPORTED_MODELS}"),
        )
    })?;
    let [width, height] = size;
    let size = [width?, height?];
    if given != count {
        let problem = match given.checked_sub(count) {
            Some(more) => format!("{more} more than {model} has"),
            None => format!("{given} where {model} has {count}"),
        };
        return Err(line.error(format_args!("parameters of camera {id}"), problem));
    }
    let mut params = Vec::with_capacity(count);
    for k in 0..count {
        params.push(line.finite(format_args!("parameter {k} of camera {id}"))?);
    }
    checked(file, [line.at(); 2], id, model, size, params)
}

/// The camera model for a name in any usual spelling. `parameters` is the number of parameters of the camera.
fn named(word: &str, parameters: usize) -> Option<&'static (&'static str, usize)> {
    let wanted = match (names::key(word).as_str(), parameters) {
        ("PERSPECTIVE", 3) => "SIMPLEPINHOLE".to_owned(),
        ("PERSPECTIVE", _) => "PINHOLE".to_owned(),
        (key, _) => key.to_owned(),
    };
    MODELS.iter().find(|(name, _)| names::key(name) == wanted)
}

fn checked(
    file: &Path,
    at: [At; 2],
    id: u32,
    model: &'static str,
    size: [u64; 2],
    params: Vec<f64>,
) -> Result<Intrinsics, FileError> {
    // No image library reads longer sides, and products of two sides stay far inside 64 bits.
    let side = |v: u64| u32::try_from(v).ok().filter(|v| (1..=1 << 20).contains(v));
    let (Some(width), Some(height)) = (side(size[0]), side(size[1])) else {
        return Err(wrong(
            file,
            at[0],
            format_args!("size of camera {id}"),
            format_args!("is {}x{}", size[0], size[1]),
        ));
    };
    let one = [
        "SIMPLE_PINHOLE",
        "SIMPLE_RADIAL",
        "RADIAL",
        "SIMPLE_RADIAL_FISHEYE",
        "RADIAL_FISHEYE",
        "SIMPLE_DIVISION",
        "SIMPLE_FISHEYE",
    ];
    let focal_lengths = if one.contains(&model) { 1 } else { 2 };
    if let Some(f) = params.iter().take(focal_lengths).find(|f| **f <= 0.0) {
        return Err(wrong(file, at[1], format_args!("focal length of camera {id}"), format_args!("is {f}")));
    }
    Ok(Intrinsics { model, width, height, params })
}
