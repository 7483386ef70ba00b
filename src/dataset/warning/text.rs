//! The texts of the warnings.

use std::fmt::{self, Formatter};
use std::path::Path;

use crate::dataset::{Format, PoseFault, Renamed};
use crate::numbers::{counted, grouped, of_count};

/// Most other models that a text names.
const NAMED: usize = 5;

/// "1 of 9 masks".
fn masks_of(masks: usize, of: usize) -> String {
    format!("{} of {}", grouped(masks), counted(of, "mask"))
}

/// The words before the name of the first file: nothing for a single one.
fn the_first(n: usize) -> &'static str {
    of_count(n, "", "the first ")
}

// Poses and cameras.

pub(super) fn cameras_at_one_place(f: &mut Formatter<'_>, cameras: usize, extent: f64) -> fmt::Result {
    write!(
        f,
        "the training cameras ({}) are all at one place, compared with the distance of the points: the scene's \
                 extent comes from the points ({extent} units)",
        grouped(cameras)
    )
}

pub(super) fn camera_far_away(f: &mut Formatter<'_>, name: &str, times: f64) -> fmt::Result {
    write!(
        f,
        "the camera of '{name}' is {times:.0} times as far from the others as they are from one another: its \
                 pose is probably wrong. Leave the photograph out, or mend its pose; the scene's extent comes from \
                 the others"
    )
}

pub(super) fn pose_wrong(f: &mut Formatter<'_>, name: &str, fault: &PoseFault, left_out: bool) -> fmt::Result {
    match left_out {
        true => write!(
            f,
            "'{name}' is left out of training, as its pose is wrong: {fault}. Mend the pose, or take the \
                 photograph out of the model"
        ),
        false => write!(
            f,
            "the pose of '{name}' is wrong, and so will be the score of this held-out photograph: {fault}. Mend \
                 the pose, or take the photograph out of the model"
        ),
    }
}

pub(super) fn pose_doubtful(f: &mut Formatter<'_>, name: &str, fault: &PoseFault) -> fmt::Result {
    write!(
        f,
        "the pose of '{name}' is in doubt: {fault}. If its pictures turn out blurred, leave the \
                     photograph out"
    )
}

pub(super) fn poses_against_points(f: &mut Formatter<'_>, file: &Path, wrong: usize, of: usize) -> fmt::Result {
    write!(
        f,
        "{}: {} of {} {} not agree with the points that their photographs observe: poses and points are of \
                 different reconstructions, or in different coordinates. Export both from the same one",
        file.display(),
        grouped(wrong),
        counted(of, "pose"),
        of_count(wrong, "does", "do")
    )
}

// Masks.

pub(super) fn all_masked(f: &mut Formatter<'_>, photographs: usize, first: &str) -> fmt::Result {
    match photographs {
        1 => write!(f, "'{first}': every pixel is masked; it is left out"),
        _ => write!(
            f,
            "{}, the first '{first}': every pixel is masked; they are left out",
            counted(photographs, "photograph")
        ),
    }
}

pub(super) fn masks_leave_out_nothing(f: &mut Formatter<'_>, masks: usize, of: usize, first: &str) -> fmt::Result {
    write!(
        f,
        "{} {} out no pixel, {}that of '{first}'",
        masks_of(masks, of),
        of_count(masks, "leaves", "leave"),
        the_first(masks)
    )
}

pub(super) fn masks_by_transparency(f: &mut Formatter<'_>, masks: usize, of: usize, first: &str) -> fmt::Result {
    write!(
        f,
        "{}, {}that of '{first}', {} transparency what is left out, as {} colour says nothing: transparent \
                 counts as black",
        masks_of(masks, of),
        the_first(masks),
        of_count(masks, "says by its", "say by their"),
        of_count(masks, "its", "their")
    )
}

pub(super) fn no_mask_matches(f: &mut Formatter<'_>, folder: &Path) -> fmt::Result {
    write!(f, "{}: no mask has the name of a photograph (a.jpg.png or a.png for a.jpg)", folder.display())
}

pub(super) fn unread_masks(f: &mut Formatter<'_>, folder: &str) -> fmt::Result {
    write!(
        f,
        "the pictures in {folder} are not read: masks are looked for in masks; rename the folder if that is \
                 what these are"
    )
}

// Photographs.

pub(super) fn brighter_than_white(f: &mut Formatter<'_>, photographs: usize, pixels: u64) -> fmt::Result {
    write!(
        f,
        "{} {} pixels brighter than white ({} in all), which are made white; the setting `white-level` says \
                 which value is white",
        counted(photographs, "photograph"),
        of_count(photographs, "has", "have"),
        grouped(pixels)
    )
}

pub(super) fn transparent_left_out(f: &mut Formatter<'_>, photographs: usize, pixels: u64) -> fmt::Result {
    write!(
        f,
        "{} {} transparent pixels ({} in all), which are left out: nothing keeps splats from \
                 them. If nothing is to be seen there, set `transparent` to `background`",
        counted(photographs, "photograph"),
        of_count(photographs, "has", "have"),
        grouped(pixels)
    )
}

pub(super) fn nothing_held_out(f: &mut Formatter<'_>, views: usize) -> fmt::Result {
    write!(
        f,
        "{} {} too few to hold any out: all are trained on, and no quality is measured",
        counted(views, "photograph"),
        of_count(views, "is", "are")
    )
}

pub(super) fn other_names(f: &mut Formatter<'_>, what: &str, of: usize, renamed: &Renamed) -> fmt::Result {
    write!(
        f,
        "{} of {} {what} {} than the model says and {} found all the same: {renamed}",
        grouped(renamed.count()),
        grouped(of),
        of_count(renamed.count(), "has another name", "have other names"),
        of_count(renamed.count(), "was", "were")
    )
}

pub(super) fn photographs_without_pose(f: &mut Formatter<'_>, photographs: usize) -> fmt::Result {
    write!(
        f,
        "{} {} no pose in the model and {} not used",
        counted(photographs, "photograph"),
        of_count(photographs, "has", "have"),
        of_count(photographs, "is", "are")
    )
}

// Formats and the parts of a reconstruction.

pub(super) fn several_formats(f: &mut Formatter<'_>, used: Format, others: &[Format]) -> fmt::Result {
    let others: Vec<String> = others.iter().map(ToString::to_string).collect();
    write!(f, "read as {used}; the folder could be read as {} too: the setting `format` chooses", others.join(", "))
}

pub(super) fn coordinates_unknown(f: &mut Formatter<'_>, file: &Path, problem: &str) -> fmt::Result {
    write!(
        f,
        "the coordinates are those of a map less an offset, and {} does not say of which: {problem}. Training \
                 and pictures need neither; for coordinates on a map put the file of the run there",
        file.display()
    )
}

pub(super) fn other_parts(f: &mut Formatter<'_>, used: usize, parts: usize, shots: usize) -> fmt::Result {
    write!(
        f,
        "the reconstruction is in {} parts without a common frame: only the largest, of {}, is used; {} {} not",
        grouped(parts + 1),
        counted(used, "photograph"),
        counted(shots, "photograph"),
        of_count(shots, "is", "are")
    )
}

pub(super) fn other_models(f: &mut Formatter<'_>, used: &str, images: u64, others: &[(String, u64)]) -> fmt::Result {
    let named: Vec<String> =
        others.iter().take(NAMED).map(|(folder, images)| format!("{folder} ({})", counted(*images, "image"))).collect();
    let more = if others.len() > NAMED { ", ..." } else { "" };
    write!(
        f,
        "the reconstruction is in {} parts without a common frame: only the largest, {used} ({}), is \
                     used; {}{more} {} not. SplitParts that share photographs can be joined by colmap model_merger",
        others.len() + 1,
        counted(images, "image"),
        named.join(", "),
        of_count(others.len(), "is", "are")
    )
}

pub(super) fn other_places(f: &mut Formatter<'_>, used: &str, others: &[String]) -> fmt::Result {
    let named = others.iter().take(NAMED).cloned().collect::<Vec<String>>().join(", ");
    let more = if others.len() > NAMED { ", ..." } else { "" };
    write!(
        f,
        "the model in {used} is read; there {}, in {named}{more}, which {} not. To read another one, \
                     leave that one alone in the dataset, in sparse/0",
        of_count(others.len(), "is another", "are others"),
        of_count(others.len(), "is", "are")
    )
}

pub(super) fn split_lists(
    f: &mut Formatter<'_>,
    used: bool,
    unknown: usize,
    first: Option<&str>,
    in_none: usize,
    in_both: usize,
) -> fmt::Result {
    write!(f, "train_filenames, val_filenames and test_filenames of transforms.json do not fit the frames: ")?;
    let mut said = Vec::new();
    if let Some(first) = first {
        said.push(format!(
            "{} in them {} no frame, {}{first}",
            counted(unknown, "name"),
            of_count(unknown, "is", "are"),
            the_first(unknown)
        ));
    }
    if in_none > 0 {
        said.push(format!("{} {} in none of them", counted(in_none, "frame"), of_count(in_none, "is", "are")));
    }
    if in_both > 0 {
        said.push(format!(
            "{} {} to be trained on and to be held out",
            counted(in_both, "frame"),
            of_count(in_both, "is", "are")
        ));
    }
    let done = match used {
        true => "frames in none are not used, and frames in two are held out",
        false => "nothing would be left to train on, so the lists are not used",
    };
    write!(f, "{}; {done}", said.join(", "))
}

// Points and other records.

pub(super) fn no_points(f: &mut Formatter<'_>, file: Option<&Path>) -> fmt::Result {
    match file {
        Some(file) => write!(f, "{}: the model has no points. ", file.display())?,
        None => write!(f, "the model has no points file. ")?,
    }
    write!(
        f,
        "Without `init`, training starts from random points in the cameras' common view, or from the \
                     surfaces that stereo finds: expect a lower quality, more splats and more of them in mid-air than \
                     from triangulated points"
    )
}

pub(super) fn count_differs(f: &mut Formatter<'_>, file: &Path, what: &str, announced: u64, found: u64) -> fmt::Result {
    let cut = if found < announced { "; it may have been cut off" } else { "" };
    write!(
        f,
        "{}: the comment at the top announces another number of {what} ({}) than the file holds ({}), \
                     which are used{cut}",
        file.display(),
        grouped(announced),
        grouped(found)
    )
}

pub(super) fn shared_number(f: &mut Formatter<'_>, number: u32, images: usize) -> fmt::Result {
    write!(
        f,
        "images with a number that another image has: {}, the first of them with {number}; which of them \
                 points were seen from is not known",
        grouped(images)
    )
}

pub(super) fn unknown_observers(
    f: &mut Formatter<'_>,
    file: &Path,
    points: usize,
    point: u64,
    image: u32,
) -> fmt::Result {
    write!(
        f,
        "{}: points that were seen from images that are not in the model: {}, the first of them point {point} \
                 from image {image}; these observations are not used",
        file.display(),
        grouped(points)
    )
}
