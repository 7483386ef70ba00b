//! Warnings about a dataset that loads.

mod text;

use std::fmt;
use std::path::PathBuf;

use super::{Colourless, Format, PoseFault, Renamed};
use crate::format::LeftOut;

/// A peculiarity of a dataset.
#[derive(Clone, Debug, PartialEq)]
pub enum Warning {
    /// All training cameras are at one place (or there is one only), so the scene's extent comes from the points.
    CamerasAtOnePlace {
        /// Number of training cameras.
        cameras: usize,
        /// The extent used instead, in dataset units.
        extent: f64,
    },
    /// A training camera is far from all others: its pose is probably wrong. The scene's extent is that of the others.
    CameraFarAway {
        /// The view.
        name: String,
        /// How many times as far from the middle of all cameras as half of them.
        times: f64,
    },
    /// The pose of a photograph is wrong.
    PoseWrong {
        /// The view.
        name: String,
        /// What speaks against the pose.
        fault: PoseFault,
        /// Whether the photograph is left out of training; held-out ones are scored all the same.
        left_out: bool,
    },
    /// The pose of a photograph is worse than those of the others. The photograph is used all the same.
    PoseDoubtful {
        /// The view.
        name: String,
        /// What speaks against the pose.
        fault: PoseFault,
    },
    /// Poses and points do not belong together.
    PosesAgainstPoints {
        /// The file with the poses.
        file: PathBuf,
        /// Photographs whose points are elsewhere.
        wrong: usize,
        /// Photographs that could be judged.
        of: usize,
    },
    /// Every pixel of photographs is masked: they are not used.
    AllMasked {
        /// How many.
        photographs: usize,
        /// The first of them.
        first: String,
    },
    /// Masks that leave out no pixel.
    MasksLeaveOutNothing {
        /// How many.
        masks: usize,
        /// How many masks there are.
        of: usize,
        /// The photograph of the first of them.
        first: String,
    },
    /// Masks whose colour says nothing, and whose transparency is taken in its place.
    MasksByTransparency {
        /// How many.
        masks: usize,
        /// How many masks there are.
        of: usize,
        /// The photograph of the first of them.
        first: String,
    },
    /// Photographs have pixels above the white level, which are white.
    BrighterThanWhite {
        /// Photographs that have such pixels.
        photographs: usize,
        /// Such pixels in all of them.
        pixels: u64,
    },
    /// Photographs have transparent pixels, which are left out.
    TransparentLeftOut {
        /// Photographs that have such pixels.
        photographs: usize,
        /// Such pixels in all of them.
        pixels: u64,
    },
    /// The folder has files of several formats.
    SeveralFormats {
        /// The one that was read.
        used: Format,
        /// The others.
        others: Vec<Format>,
    },
    /// The coordinates are of a map's grid less an offset, and the dataset does not say of which.
    CoordinatesUnknown {
        /// The file that should say it.
        file: PathBuf,
        /// Why it does not.
        problem: String,
    },
    /// The reconstruction fell into parts without a common frame, of which the largest is used.
    OtherParts {
        /// Photographs of the part that is used.
        used: usize,
        /// Other parts.
        parts: usize,
        /// Photographs in them.
        shots: usize,
    },
    /// There are several models of COLMAP, parts of a reconstruction without a common frame,
    /// of which the one with the most images is used.
    OtherModels {
        /// The folder of the one that is used, inside the dataset.
        used: String,
        /// Its images.
        images: u64,
        /// Folders and images of the others.
        others: Vec<(String, u64)>,
    },
    /// There are models in several places that are no parts of one reconstruction.
    OtherPlaces {
        /// The folder inside the dataset of the one that is used.
        used: String,
        /// The folders of the others.
        others: Vec<String>,
    },
    /// The lists of a `transforms.json` (`train_filenames` and others) and its frames do not agree.
    SplitLists {
        /// Whether the lists are used all the same; they are not where nothing would be left to train on.
        used: bool,
        /// Names in the lists that no frame has.
        unknown: usize,
        /// The first of them, and its list.
        first: Option<String>,
        /// Frames in no list: they are not used.
        in_none: usize,
        /// Frames to train on that are to be held out too: they are held out.
        in_both: usize,
    },
    /// Files were found whose names differ from those in the model.
    OtherNames {
        /// "photographs" or "masks".
        what: &'static str,
        /// How many there are in all.
        of: usize,
        /// How many differ by what.
        renamed: Renamed,
    },
    /// There is a folder of masks, and none belongs to a photograph.
    NoMaskMatches {
        /// The folder.
        folder: PathBuf,
    },
    /// There is a folder whose name is nearly that of the masks, and no folder of masks.
    UnreadMasks {
        /// The folder inside the dataset.
        folder: String,
    },
    /// There are too few photographs to hold any out.
    NothingHeldOut {
        /// Number of photographs.
        views: usize,
    },
    /// The model has no points: training begins with random ones, or with a model that is given.
    NoPoints {
        /// The points file, if there is one.
        file: Option<PathBuf>,
    },
    /// The colours of the points say nothing: training takes them from the photographs.
    PointsWithoutColours(Colourless),
    /// Records that cannot be used are left out.
    LeftOut(LeftOut),
    /// A text file announces another number of records than it holds.
    CountDiffers {
        /// The file.
        file: PathBuf,
        /// The kind of the records, in the plural.
        what: &'static str,
        /// How many the comment at the top announces.
        announced: u64,
        /// How many there are.
        found: u64,
    },
    /// Images of COLMAP share a number, by which points name them.
    SharedNumber {
        /// The first such number.
        number: u32,
        /// Images that have the number of an image before them.
        images: usize,
    },
    /// Points were seen from images that are not in the model.
    UnknownObservers {
        /// The file with the points.
        file: PathBuf,
        /// How many such points there are.
        points: usize,
        /// The first of them.
        point: u64,
        /// The number of the image that it names.
        image: u32,
    },
    /// The folder has photographs that the model does not place.
    PhotographsWithoutPose {
        /// How many.
        photographs: usize,
    },
}

impl Warning {
    /// Whether it is of use to who trains alone: scores and depths of photographs are what they are without.
    pub fn is_of_training(&self) -> bool {
        matches!(self, Self::NoPoints { .. } | Self::PointsWithoutColours(_))
    }

    /// Whether it is of what the files hold, also to who needs the poses alone.
    pub fn is_of_files(&self) -> bool {
        matches!(self, Self::LeftOut(_) | Self::CountDiffers { .. })
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::CamerasAtOnePlace { cameras, extent } => text::cameras_at_one_place(f, *cameras, *extent),
            Self::CameraFarAway { name, times } => text::camera_far_away(f, name, *times),
            Self::PoseWrong { name, fault, left_out } => text::pose_wrong(f, name, fault, *left_out),
            Self::PoseDoubtful { name, fault } => text::pose_doubtful(f, name, fault),
            Self::PosesAgainstPoints { file, wrong, of } => text::poses_against_points(f, file, *wrong, *of),
            Self::AllMasked { photographs, first } => text::all_masked(f, *photographs, first),
            Self::MasksLeaveOutNothing { masks, of, first } => text::masks_leave_out_nothing(f, *masks, *of, first),
            Self::MasksByTransparency { masks, of, first } => text::masks_by_transparency(f, *masks, *of, first),
            Self::NoMaskMatches { folder } => text::no_mask_matches(f, folder),
            Self::UnreadMasks { folder } => text::unread_masks(f, folder),
            Self::BrighterThanWhite { photographs, pixels } => text::brighter_than_white(f, *photographs, *pixels),
            Self::TransparentLeftOut { photographs, pixels } => text::transparent_left_out(f, *photographs, *pixels),
            Self::NothingHeldOut { views } => text::nothing_held_out(f, *views),
            Self::OtherNames { what, of, renamed } => text::other_names(f, what, *of, renamed),
            Self::PhotographsWithoutPose { photographs } => text::photographs_without_pose(f, *photographs),
            Self::SeveralFormats { used, others } => text::several_formats(f, *used, others),
            Self::CoordinatesUnknown { file, problem } => text::coordinates_unknown(f, file, problem),
            Self::OtherParts { used, parts, shots } => text::other_parts(f, *used, *parts, *shots),
            Self::OtherModels { used, images, others } => text::other_models(f, used, *images, others),
            Self::OtherPlaces { used, others } => text::other_places(f, used, others),
            Self::SplitLists { used, unknown, first, in_none, in_both } => {
                text::split_lists(f, *used, *unknown, first.as_deref(), *in_none, *in_both)
            }
            Self::NoPoints { file } => text::no_points(f, file.as_deref()),
            Self::CountDiffers { file, what, announced, found } => {
                text::count_differs(f, file, what, *announced, *found)
            }
            Self::SharedNumber { number, images } => text::shared_number(f, *number, *images),
            Self::UnknownObservers { file, points, point, image } => {
                text::unknown_observers(f, file, *points, *point, *image)
            }
            Self::PointsWithoutColours(colourless) => colourless.fmt(f),
            Self::LeftOut(left_out) => left_out.fmt(f),
        }
    }
}
