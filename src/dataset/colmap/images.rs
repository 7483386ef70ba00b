//! `images.bin` and `images.txt`: the poses.

use std::path::Path;

use super::{binary_records, text_records, wrong};
use crate::dataset::model::Observation;
use crate::format::source::{Line, Lines, Source};
use crate::format::{At, Error as FileError};

/// One photograph's pose.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Pose {
    pub(crate) name: String,
    /// COLMAP's number of the image.
    pub(crate) number: u32,
    pub(crate) camera: u32,
    /// Rotation from the dataset's axes to the camera's, row-major.
    pub(crate) rotation: [[f64; 3]; 3],
    /// x_cam = rotation x + translation.
    pub(crate) translation: [f64; 3],
    /// Some of the points that it shows.
    pub(crate) observations: Vec<Observation>,
    /// Where the pose stands in its file.
    pub(crate) at: At,
}

/// Bytes of an image in `images.bin`, at least: without a name, and without keypoints.
const SMALLEST: u64 = 4 + 7 * 8 + 4 + 1 + 8;

/// How many images `images.bin` has: its first number.
pub(super) fn count_binary(file: &Path) -> Result<u64, FileError> {
    Ok(Source::open(file)?.count(SMALLEST, "number of images")? as u64)
}

/// How many images `images.txt` has: each is two lines, the second of which may be empty.
pub(super) fn count_text(file: &Path) -> Result<u64, FileError> {
    let mut lines = Lines::open(file)?;
    let mut count = 0;
    while let Some(line) = lines.next()? {
        let text = line.text.trim_start();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        count += 1;
        lines.next()?;
    }
    Ok(count)
}

/// Reads `images.bin`: per image i32 number, f64 quaternion (w first) and translation, i32 camera, name ended by zero, u64
/// number of keypoints and 24 bytes for each.
pub(crate) fn read_binary(file: &Path) -> Result<Vec<Pose>, FileError> {
    binary_records(file, "images", SMALLEST, |source, i| {
        let start = source.at();
        let number = source.u32(format_args!("number of image {i}"))?;
        let mut values = [0.0; 7];
        for (k, value) in values.iter_mut().enumerate() {
            *value = source.f64(format_args!("{} of image {i}", VALUES[k]))?;
        }
        let camera = source.u32(format_args!("camera of image {i}"))?;
        let at = source.at();
        let name = source.text(format_args!("name of image {i}"))?;
        if name.is_empty() {
            return Err(source.error(at, format_args!("name of image {i}"), "is empty"));
        }
        let keypoints = source.count(24, format_args!("number of keypoints of image '{name}'"))?;
        let some = keypoints.min(MOST_KEYPOINTS);
        let bytes = source.bytes(24 * some as u64, format_args!("keypoints of image '{name}'"))?;
        source.skip(24 * (keypoints - some) as u64, format_args!("keypoints of image '{name}'"))?;
        let pose = pose(file, At::Byte(start), name, [number, camera], values)?;
        Ok(Pose { observations: observations(bytes.chunks_exact(24).filter_map(keypoint)), ..pose })
    })
}

/// Reads `images.txt`: per image one line with number, quaternion, translation, camera and name, and one with the keypoints,
/// which is empty when there are none.
pub(crate) fn read_text(file: &Path) -> Result<Vec<Pose>, FileError> {
    let mut i = 0;
    let first = |mut line: Line<'_>| {
        let at = line.at();
        let number = line.value(format_args!("number of image {i}"))?;
        let mut values = [0.0; 7];
        for (k, value) in values.iter_mut().enumerate() {
            *value = line.f64(format_args!("{} of image {i}", VALUES[k]))?;
        }
        let camera = line.value(format_args!("camera of image {i}"))?;
        // The rest of the line: names may hold spaces.
        let name = line.rest().to_owned();
        if name.is_empty() {
            return Err(line.error(format_args!("name of image {i}"), "is missing"));
        }
        i += 1;
        pose(file, at, name, [number, camera], values)
    };
    let mut seen = Vec::new();
    let mut second = |line: Line<'_>| {
        seen.push(keypoints(line)?);
        Ok(())
    };
    let poses = text_records(file, "images", first, Some(&mut second))?;
    let all = seen.into_iter().chain(std::iter::repeat(Vec::new()));
    Ok(poses.into_iter().zip(all).map(|(pose, observations)| Pose { observations, ..pose }).collect())
}

fn keypoints(line: Line<'_>) -> Result<Vec<Observation>, FileError> {
    match line.left() {
        n if n % 3 == 0 => {
            let words: Vec<&str> = line.rest().split_whitespace().take(3 * MOST_KEYPOINTS).collect();
            let of = |three: &[&str]| {
                let [x, y, point] = three else { return None };
                Some(Observation { at: [x.parse().ok()?, y.parse().ok()?], point: point.parse().ok()? })
            };
            Ok(observations(words.chunks_exact(3).filter_map(of)))
        }
        n => Err(line.error("keypoints", format_args!("{n} values are not a multiple of three (x, y, point)"))),
    }
}

/// A keypoint of `images.bin` that shows a point.
fn keypoint(bytes: &[u8]) -> Option<Observation> {
    let word = |k: usize| bytes.get(8 * k..8 * k + 8)?.try_into().ok();
    let point = u64::from_le_bytes(word(2)?);
    Some(Observation { at: [f64::from_le_bytes(word(0)?), f64::from_le_bytes(word(1)?)], point })
}

/// As many as a pose can be judged by.
fn observations(all: impl Iterator<Item = Observation>) -> Vec<Observation> {
    let shows = |seen: &Observation| seen.point != u64::MAX && seen.at.iter().all(|v| v.is_finite());
    all.filter(shows).take(MOST_OBSERVATIONS).collect()
}

/// Keypoints of an image that are looked at, and those of them that are kept: enough to judge its pose by.
const MOST_KEYPOINTS: usize = 8192;
const MOST_OBSERVATIONS: usize = 256;

const VALUES: [&str; 7] = ["qw", "qx", "qy", "qz", "tx", "ty", "tz"];

fn pose(file: &Path, at: At, name: String, [number, camera]: [u32; 2], v: [f64; 7]) -> Result<Pose, FileError> {
    let length = v[..4].iter().map(|q| q * q).sum::<f64>().sqrt();
    if !(length.is_finite() && length > 1e-6) {
        return Err(wrong(file, at, format_args!("rotation of image '{name}'"), "the quaternion is zero"));
    }
    let [w, x, y, z] = [v[0] / length, v[1] / length, v[2] / length, v[3] / length];
    let rotation = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ];
    Ok(Pose { name, number, camera, rotation, translation: [v[4], v[5], v[6]], observations: Vec::new(), at })
}
