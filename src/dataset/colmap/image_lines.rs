//! Tells the poses from the keypoints in `images.txt`.
//!
//! COLMAP writes two lines for each image: the pose, and the keypoints, which may be an empty line. Other programs omit
//! the second line or add empty lines. So a line is recognised by its content and not by its position.

use std::path::Path;

use super::{Counts, announced_count};
use crate::format::source::{Line, Lines, whole};
use crate::format::{At, Error as FileError};

/// A pose has a number, a quaternion, a translation and a camera before its name.
const BEFORE_NAME: usize = 9;
/// Most words of a line that are read to tell a damaged pose from damaged keypoints.
const LOOKED_AT: usize = 12;
/// Largest deviation of a quaternion's length from 1, for the digits of a file.
const UNIT: f64 = 1e-3;

/// The kind of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LineKind {
    Pose,
    Keypoints,
    /// Pose and keypoints are both possible.
    Either,
    DamagedPose,
    DamagedKeypoints,
}

/// A record of the file.
pub(super) enum ImageRecord<'a> {
    /// The line of a pose, sound or not.
    Pose(Line<'a>),
    /// The keypoints of the preceding pose.
    Keypoints(Line<'a>),
    /// A damaged line of keypoints.
    Damaged(At, FileError),
}

/// Whether the second line of an image is still to come.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Second {
    Awaited,
    /// Maybe: an empty line has come, which may be the keypoints.
    MaybeEmpty,
    Done,
}

/// Reads the lines and passes on the records. `is_camera` says whether a camera with a number exists.
pub(super) fn scan(
    file: &Path,
    is_camera: impl Fn(u32) -> bool,
    mut found: impl FnMut(ImageRecord<'_>) -> Result<(), FileError>,
) -> Result<Counts, FileError> {
    let mut lines = Lines::open(file)?;
    let (mut announced, mut second) = (None, Second::Done);
    while let Some(line) = lines.next()? {
        let text = line.text.trim();
        if let Some(comment) = text.strip_prefix('#') {
            announced = announced.or_else(|| announced_count(comment));
            continue;
        }
        if text.is_empty() {
            second = if second == Second::Awaited { Second::MaybeEmpty } else { second };
            continue;
        }
        second = match (kind(text, &is_camera), second) {
            (LineKind::Either, Second::Awaited) => return Err(ambiguous(&line)),
            (LineKind::Pose | LineKind::Either | LineKind::DamagedPose, _) | (_, Second::Done) => {
                found(ImageRecord::Pose(line))?;
                Second::Awaited
            }
            (LineKind::Keypoints, _) => {
                found(ImageRecord::Keypoints(line))?;
                Second::Done
            }
            (LineKind::DamagedKeypoints, _) => {
                let problem = format!("{} values are not a multiple of three (x, y, point)", line.left());
                let error = line.error("keypoints", problem);
                if !line.ended {
                    return Err(error);
                }
                found(ImageRecord::Damaged(line.at(), error))?;
                Second::Done
            }
        };
    }
    Ok(Counts { announced, ended: lines.ended(), at: lines.at() })
}

fn ambiguous(line: &Line<'_>) -> FileError {
    let problem = "could be the pose of an image, or keypoints of the image before; write the second line of each \
                   image as COLMAP does, empty where there are no keypoints";
    line.error("line", problem)
}

fn kind(text: &str, is_camera: impl Fn(u32) -> bool) -> LineKind {
    let words: Vec<&str> = text.split_whitespace().collect();
    let numeric = |word: &&str| word.parse::<f64>().is_ok();
    let has_pose = words.len() >= BEFORE_NAME
        && whole::<u32>(words[0]).is_some()
        && words[1..8].iter().all(numeric)
        && whole::<u32>(words[8]).is_some();
    if has_pose && !words[BEFORE_NAME..].iter().all(numeric) {
        return LineKind::Pose;
    }
    if !has_pose {
        let some = &words[..words.len().min(LOOKED_AT)];
        return match (some.iter().all(numeric), words.len() % 3) {
            (true, 0) => LineKind::Keypoints,
            (true, _) => LineKind::DamagedKeypoints,
            (false, _) => LineKind::DamagedPose,
        };
    }
    // All words are numbers: the image's name may be a number.
    let length = words[1..5].iter().filter_map(|q| q.parse::<f64>().ok()).map(|q| q * q).sum::<f64>().sqrt();
    let plausible = (length - 1.0).abs() < UNIT && whole(words[8]).is_some_and(is_camera);
    let point = |word: &&str| *word == "-1" || *word == "-1.0" || whole::<u64>(word).is_some();
    let keypoints = words.len().is_multiple_of(3) && words.iter().skip(2).step_by(3).all(point);
    match (plausible, keypoints) {
        (true, true) => LineKind::Either,
        (false, true) => LineKind::Keypoints,
        (_, false) => LineKind::Pose,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_told_by_what_is_in_them() {
        for (text, want) in [
            ("1 1 0 0 0 0 0 0 1 a.png", LineKind::Pose),
            ("1 1 0 0 0 0 0 0 1 my photo 1.jpg", LineKind::Pose),
            ("1.0 1 0 0 0 0 0 0 1.0 a.png", LineKind::Pose),
            ("1 nan 0 0 0 0 0 0 1 a.png", LineKind::Pose),
            ("1 0 0 0 0 0 0 0 7 12 34 a.png", LineKind::Pose),
            ("1 0.6 0.8 0 0 1.5 0.25 9 1 0001", LineKind::Pose),
            ("1 0.6 0.8 0 0 1.5 0.25 9 1 12 34 56", LineKind::Pose),
            ("1 1 0 0 0 0 0 0 1 12 34 56", LineKind::Either),
            ("1 1 0 0 0 0 0 0 1", LineKind::Either),
            ("1 1 0 0 0 0 0 0 9 12 34 56", LineKind::Keypoints),
            ("12.5 7.25 -1 30 40 12", LineKind::Keypoints),
            ("12 7 -1 30 40 12 50 60 70 1 2 3", LineKind::Keypoints),
            ("12.5 7.25 -1 30 40", LineKind::DamagedKeypoints),
            ("1 1 0 zero 0 0 0 0 1 a.png", LineKind::DamagedPose),
        ] {
            assert_eq!(kind(text, |camera| camera == 1), want, "{text}");
        }
    }
}
