//! `images.bin` and `images.txt`: the poses.

use std::path::Path;

use super::image_lines::{ImageRecord, scan};
use super::{binary_records, wrong};
use crate::dataset::model::Observation;
use crate::dataset::{Error, Warning};
use crate::format::source::{Line, Source, whole};
use crate::format::{At, Error as FileError, Tally};

/// The pose of a photograph.
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
    /// Some of the points that the image observes.
    pub(crate) observations: Vec<Observation>,
    /// Position of the pose in its file.
    pub(crate) at: At,
}

/// Least bytes of an image in `images.bin`: no name, no keypoints.
const SMALLEST: u64 = 4 + 7 * 8 + 4 + 1 + 8;

/// The number of images in `images.bin`: its first value.
pub(super) fn count_binary(file: &Path) -> Result<u64, FileError> {
    Ok(Source::open(file)?.count(SMALLEST, "number of images")? as u64)
}

/// The number of images in `images.txt`.
pub(super) fn count_text(file: &Path) -> Result<u64, FileError> {
    let mut count = 0;
    scan(
        file,
        |_| true,
        |found| {
            count += u64::from(matches!(found, ImageRecord::Pose(_)));
            Ok(())
        },
    )?;
    Ok(count)
}

/// The poses of a file, and its images that cannot be used.
pub(crate) struct Poses {
    pub(crate) list: Vec<Pose>,
    /// Numbers of the images that are left out. Tracks of points may name them.
    pub(crate) left_out: Vec<u32>,
    pub(crate) tally: Tally<Error>,
}

impl Poses {
    fn new(strict: bool) -> Self {
        Self { list: Vec::new(), left_out: Vec::new(), tally: Tally::new(strict) }
    }

    fn add(&mut self, name: &str, number: Option<u32>, pose: Result<Pose, FileError>) -> Result<(), Error> {
        match pose {
            Ok(pose) => self.list.push(pose),
            Err(error) => {
                self.left_out.extend(number);
                self.tally.bad(name, error.into())?;
            }
        }
        Ok(())
    }
}

/// Reads `images.bin`: per image i32 number, f64 quaternion (w first) and translation, i32 camera, name ended by zero,
/// u64 number of keypoints and 24 bytes for each.
pub(crate) fn read_binary(file: &Path, strict: bool) -> Result<Poses, Error> {
    let mut poses = Poses::new(strict);
    let records = binary_records(file, "images", SMALLEST, |source, i| {
        let start = source.at();
        let number = source.u32(format_args!("number of image {i}"))?;
        let mut values = [0.0; 7];
        for (k, value) in values.iter_mut().enumerate() {
            *value = source.f64(format_args!("{} of image {i}", VALUES[k]))?;
        }
        let camera = source.u32(format_args!("camera of image {i}"))?;
        let at = source.at();
        let name = source.word(format_args!("name of image {i}"))?;
        let shown = String::from_utf8_lossy(&name).into_owned();
        let keypoints = source.count(24, format_args!("number of keypoints of image '{shown}'"))?;
        let some = keypoints.min(MOST_KEYPOINTS);
        let bytes = source.bytes(24 * some as u64, format_args!("keypoints of image '{shown}'"))?;
        source.skip(24 * (keypoints - some) as u64, format_args!("keypoints of image '{shown}'"))?;
        let places: [At; 7] = std::array::from_fn(|k| At::Byte(start + 4 + 8 * k as u64));
        let wrong_name = |problem: &str| wrong(file, At::Byte(at), format_args!("name of image {i}"), problem);
        let pose = match String::from_utf8(name) {
            Ok(name) if name.is_empty() => Err(wrong_name("is empty")),
            Ok(name) => pose(file, At::Byte(start), places, name, [number, camera], values),
            Err(_) => Err(wrong_name("is not UTF-8")),
        };
        let observations = observations(bytes.chunks_exact(24).filter_map(keypoint));
        Ok((shown, number, pose.map(|pose| Pose { observations, ..pose })))
    })?;
    for (i, (name, number, pose)) in records.into_iter().enumerate() {
        let name = if name.is_empty() { format!("image {i}") } else { format!("'{name}'") };
        poses.add(&name, Some(number), pose)?;
    }
    Ok(poses)
}

/// Reads `images.txt`: for each image a line with number, quaternion, translation, camera and name, and a line with the
/// keypoints, empty without keypoints. `is_camera` says whether a camera with a number exists.
pub(crate) fn read_text(
    file: &Path,
    strict: bool,
    is_camera: impl Fn(u32) -> bool,
) -> Result<(Poses, Vec<Warning>), Error> {
    let mut poses = Poses::new(strict);
    let mut keypoints = Tally::new(strict);
    let (mut records, mut position) = (Vec::new(), 0);
    let counts = scan(file, is_camera, |found| {
        match found {
            ImageRecord::Pose(line) => {
                let ended = line.ended;
                match text_pose(line, file, position) {
                    (.., Err(error)) if !ended => return Err(error),
                    record => records.push(record),
                }
                position += 1;
            }
            ImageRecord::Keypoints(line) => {
                if let Some((.., Ok(pose))) = records.last_mut() {
                    pose.observations = text_keypoints(&line);
                }
            }
            ImageRecord::Damaged(at, error) => keypoints.bad(at, error)?,
        }
        Ok(())
    })?;
    for (name, number, pose) in records {
        poses.add(&name, number, pose)?;
    }
    let counted = counts.check(file, "images", position, strict)?.into_iter();
    let sound = position.saturating_sub(keypoints.count());
    let damaged = keypoints.end(file, "lines of keypoints", sound)?.map(Warning::LeftOut);
    Ok((poses, counted.chain(damaged).collect()))
}

/// An image's name, its number, and its pose.
type ReadPose = (String, Option<u32>, Result<Pose, FileError>);

fn text_pose(mut line: Line<'_>, file: &Path, i: usize) -> ReadPose {
    // Names may hold spaces.
    let shown = line.beyond(VALUES.len() + 2);
    let called = if shown.is_empty() { format!("image {i}") } else { format!("image '{shown}'") };
    let told = if shown.is_empty() { called.clone() } else { format!("'{shown}'") };
    let at = line.at();
    let number = line.whole::<u32>(format_args!("number of {called}"));
    let known = number.as_ref().ok().copied();
    let read = || {
        let number = number?;
        let mut values = [0.0; 7];
        for (k, value) in values.iter_mut().enumerate() {
            *value = line.f64(format_args!("{} of {called}", VALUES[k]))?;
        }
        let camera = line.whole(format_args!("camera of {called}"))?;
        let name = line.rest().to_owned();
        if name.is_empty() {
            return Err(line.error(format_args!("name of {called}"), "is missing"));
        }
        pose(file, at, [at; 7], name, [number, camera], values)
    };
    let pose = read();
    (told, known, pose)
}

fn text_keypoints(line: &Line<'_>) -> Vec<Observation> {
    let words: Vec<&str> = line.text.split_whitespace().take(3 * MOST_KEYPOINTS).collect();
    let of = |three: &[&str]| {
        let [x, y, point] = three else { return None };
        Some(Observation { at: [x.parse().ok()?, y.parse().ok()?], point: whole(point)? })
    };
    observations(words.chunks_exact(3).filter_map(of))
}

/// A keypoint of `images.bin` that belongs to a point.
fn keypoint(bytes: &[u8]) -> Option<Observation> {
    let word = |k: usize| bytes.get(8 * k..8 * k + 8)?.try_into().ok();
    let point = u64::from_le_bytes(word(2)?);
    Some(Observation { at: [f64::from_le_bytes(word(0)?), f64::from_le_bytes(word(1)?)], point })
}

/// Enough observations to judge a pose by.
fn observations(all: impl Iterator<Item = Observation>) -> Vec<Observation> {
    let shows = |seen: &Observation| seen.point != u64::MAX && seen.at.iter().all(|v| v.is_finite());
    all.filter(shows).take(MOST_OBSERVATIONS).collect()
}

/// Most keypoints of an image that are read, and most of them that are kept: enough to judge the pose by.
const MOST_KEYPOINTS: usize = 8192;
const MOST_OBSERVATIONS: usize = 256;

const VALUES: [&str; 7] = ["qw", "qx", "qy", "qz", "tx", "ty", "tz"];

fn pose(
    file: &Path,
    at: At,
    places: [At; 7],
    name: String,
    [number, camera]: [u32; 2],
    v: [f64; 7],
) -> Result<Pose, FileError> {
    if let Some(k) = v.iter().position(|value| !value.is_finite()) {
        return Err(wrong(
            file,
            places[k],
            format_args!("{} of image '{name}'", VALUES[k]),
            format_args!("is {}", v[k]),
        ));
    }
    let length = v[..4].iter().map(|q| q * q).sum::<f64>().sqrt();
    if !(length.is_finite() && length > 1e-6) {
        let problem = if length > 1.0 { "the quaternion is beyond all range" } else { "the quaternion is zero" };
        return Err(wrong(file, at, format_args!("rotation of image '{name}'"), problem));
    }
    let [w, x, y, z] = [v[0] / length, v[1] / length, v[2] / length, v[3] / length];
    let rotation = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ];
    Ok(Pose { name, number, camera, rotation, translation: [v[4], v[5], v[6]], observations: Vec::new(), at })
}
