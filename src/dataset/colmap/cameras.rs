//! `cameras.bin` and `cameras.txt`.

use std::collections::BTreeMap;
use std::path::Path;

use super::{binary_records, text_records, wrong};
use crate::dataset::Error;
use crate::dataset::lens::{Distortion, Lens};
use crate::format::{At, Error as FileError};

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

/// Those that [`Intrinsics::lens`] makes lenses of, to be told.
pub(crate) const SUPPORTED: &str = "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, \
                                    SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE and OPENCV_FISHEYE";

/// A camera of the model, of any kind.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Intrinsics {
    /// COLMAP's name of the model.
    pub(crate) model: &'static str,
    pub(crate) width: u32,
    pub(crate) height: u32,
    params: Vec<f64>,
}

impl Intrinsics {
    /// The lens, for the models whose parameters COLMAP's documentation ("Camera models") describes in full.
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

/// Reads `cameras.bin`: per camera i32 number, i32 model, u64 width, u64 height, f64 parameters.
pub(crate) fn read_binary(file: &Path) -> Result<BTreeMap<u32, Intrinsics>, FileError> {
    let list = binary_records(file, "cameras", 24 + 3 * 8, |source, i| {
        let start = source.at();
        let id = source.u32(format_args!("number of camera {i}"))?;
        let at = source.at();
        let number = source.i32(format_args!("model of camera {id}"))?;
        let &(model, count) = usize::try_from(number).ok().and_then(|n| MODELS.get(n)).ok_or_else(|| {
            source.error(
                at,
                format_args!("model of camera {id}"),
                format_args!("{number} is unknown; supported are {SUPPORTED}"),
            )
        })?;
        let at = source.at();
        let size =
            [source.u64(format_args!("width of camera {id}"))?, source.u64(format_args!("height of camera {id}"))?];
        let params_at = source.at();
        let mut params = Vec::with_capacity(count);
        for k in 0..count {
            params.push(source.f64(format_args!("parameter {k} of camera {id}"))?);
        }
        let camera = checked(file, [At::Byte(at), At::Byte(params_at)], id, model, size, params)?;
        Ok((At::Byte(start), id, camera))
    })?;
    by_number(file, list)
}

/// Reads `cameras.txt`: per line number, model, width, height, parameters.
pub(crate) fn read_text(file: &Path) -> Result<BTreeMap<u32, Intrinsics>, FileError> {
    let mut number = 0;
    let list = text_records(
        file,
        "cameras",
        |mut line| {
            let at = line.at();
            let id = line.value(format_args!("number of camera {number}"))?;
            number += 1;
            let word = line.word(format_args!("model of camera {id}"))?;
            let &(model, count) = MODELS.iter().find(|(name, _)| *name == word).ok_or_else(|| {
                line.error(
                    format_args!("model of camera {id}"),
                    format_args!("'{word}' is unknown; supported are {SUPPORTED}"),
                )
            })?;
            let size =
                [line.value(format_args!("width of camera {id}"))?, line.value(format_args!("height of camera {id}"))?];
            let given = line.left();
            if given < count {
                let problem = format!("{given} where {model} has {count}");
                return Err(line.error(format_args!("parameters of camera {id}"), problem));
            }
            let mut params = Vec::with_capacity(count);
            for k in 0..count {
                params.push(line.f64(format_args!("parameter {k} of camera {id}"))?);
            }
            if line.left() > 0 {
                let problem = format!("{} more than {model} has", line.left());
                return Err(line.error(format_args!("parameters of camera {id}"), problem));
            }
            Ok((at, id, checked(file, [at; 2], id, model, size, params)?))
        },
        None,
    )?;
    by_number(file, list)
}

fn checked(
    file: &Path,
    at: [At; 2],
    id: u32,
    model: &'static str,
    size: [u64; 2],
    params: Vec<f64>,
) -> Result<Intrinsics, FileError> {
    // Beyond this no image library goes, and products of two sides stay far inside 64 bits.
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

fn by_number(file: &Path, list: Vec<(At, u32, Intrinsics)>) -> Result<BTreeMap<u32, Intrinsics>, FileError> {
    let mut out = BTreeMap::new();
    for (at, id, camera) in list {
        if out.insert(id, camera).is_some() {
            return Err(wrong(file, at, "camera", format_args!("the number {id} occurs twice")));
        }
    }
    Ok(out)
}
