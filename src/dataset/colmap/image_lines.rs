//! Which lines of `images.txt` are poses.
//!
//! COLMAP writes two lines for each image: the pose, and the keypoints, which may be none. Others leave the second line
//! out, or empty lines in. So lines are told by what is in them, and not by their turn.

use std::path::Path;

use super::{Counts, announced_count};
use crate::format::source::{Line, Lines, whole};
use crate::format::{At, Error as FileError};

/// A pose has a number, a quaternion, a translation and a camera before its name.
const BEFORE_NAME: usize = 9;
/// Words that are looked at to tell a damaged pose from damaged keypoints.
const LOOKED_AT: usize = 12;
/// A quaternion is one as far as its digits say.
const UNIT: f64 = 1e-3;

/// The kind of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Pose,
    Keypoints,
    /// It could be both.
    Either,
    DamagedPose,
    DamagedKeypoints,
}

/// The records found in the file.
pub(super) enum Found<'a> {
    /// The line of a pose, be it sound or not.
    Pose(Line<'a>),
    /// The keypoints of the pose before.
    Keypoints(Line<'a>),
    /// A line of keypoints that are none.
    Damaged(At, FileError),
}

/// Where the lines of an image go on.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Second {
    Awaited,
    /// An empty line has come, which is no keypoints, or nothing at all.
    MaybeEmpty,
    Done,
}

/// Goes through the lines and gives what is found; `is_camera` says whether there is a camera of a number.
pub(super) fn scan(
    file: &Path,
    is_camera: impl Fn(u32) -> bool,
    mut found: impl FnMut(Found<'_>) -> Result<(), FileError>,
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
            (Kind::Either, Second::Awaited) => return Err(ambiguous(&line)),
            (Kind::Pose | Kind::Either | Kind::DamagedPose, _) | (_, Second::Done) => {
                found(Found::Pose(line))?;
                Second::Awaited
            }
            (Kind::Keypoints, _) => {
                found(Found::Keypoints(line))?;
                Second::Done
            }
            (Kind::DamagedKeypoints, _) => {
                let problem = format!("{} values are not a multiple of three (x, y, point)", line.left());
                let error = line.error("keypoints", problem);
                if !line.ended {
                    return Err(error);
                }
                found(Found::Damaged(line.at(), error))?;
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

fn kind(text: &str, is_camera: impl Fn(u32) -> bool) -> Kind {
    let words: Vec<&str> = text.split_whitespace().collect();
    let numeric = |word: &&str| word.parse::<f64>().is_ok();
    let has_pose = words.len() >= BEFORE_NAME
        && whole::<u32>(words[0]).is_some()
        && words[1..8].iter().all(numeric)
        && whole::<u32>(words[8]).is_some();
    if has_pose && !words[BEFORE_NAME..].iter().all(numeric) {
        return Kind::Pose;
    }
    if !has_pose {
        let some = &words[..words.len().min(LOOKED_AT)];
        return match (some.iter().all(numeric), words.len() % 3) {
            (true, 0) => Kind::Keypoints,
            (true, _) => Kind::DamagedKeypoints,
            (false, _) => Kind::DamagedPose,
        };
    }
    // Numbers all over, as of an image whose name is one.
    let length = words[1..5].iter().filter_map(|q| q.parse::<f64>().ok()).map(|q| q * q).sum::<f64>().sqrt();
    let plausible = (length - 1.0).abs() < UNIT && whole(words[8]).is_some_and(is_camera);
    let point = |word: &&str| *word == "-1" || *word == "-1.0" || whole::<u64>(word).is_some();
    let keypoints = words.len().is_multiple_of(3) && words.iter().skip(2).step_by(3).all(point);
    match (plausible, keypoints) {
        (true, true) => Kind::Either,
        (false, true) => Kind::Keypoints,
        (_, false) => Kind::Pose,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_told_by_what_is_in_them() {
        for (text, want) in [
            ("1 1 0 0 0 0 0 0 1 a.png", Kind::Pose),
            ("1 1 0 0 0 0 0 0 1 my photo 1.jpg", Kind::Pose),
            ("1.0 1 0 0 0 0 0 0 1.0 a.png", Kind::Pose),
            ("1 nan 0 0 0 0 0 0 1 a.png", Kind::Pose),
            ("1 0 0 0 0 0 0 0 7 12 34 a.png", Kind::Pose),
            ("1 0.6 0.8 0 0 1.5 0.25 9 1 0001", Kind::Pose),
            ("1 0.6 0.8 0 0 1.5 0.25 9 1 12 34 56", Kind::Pose),
            ("1 1 0 0 0 0 0 0 1 12 34 56", Kind::Either),
            ("1 1 0 0 0 0 0 0 1", Kind::Either),
            ("1 1 0 0 0 0 0 0 9 12 34 56", Kind::Keypoints),
            ("12.5 7.25 -1 30 40 12", Kind::Keypoints),
            ("12 7 -1 30 40 12 50 60 70 1 2 3", Kind::Keypoints),
            ("12.5 7.25 -1 30 40", Kind::DamagedKeypoints),
            ("1 1 0 zero 0 0 0 0 1 a.png", Kind::DamagedPose),
        ] {
            assert_eq!(kind(text, |camera| camera == 1), want, "{text}");
        }
    }
}
