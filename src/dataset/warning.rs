//! Warnings about a dataset that loads.

mod text;

use std::fmt;
use std::path::PathBuf;

use super::{Colourless, Format, PoseFault, Renamed};
use crate::format::LeftOut;

/// A warning about a dataset.
#[derive(Clone, Debug, PartialEq)]
pub enum Warning {
    /// All training cameras are at one place, or there is a single one: the scene's extent comes from the points.
    CamerasAtOnePlace {
        /// Number of training cameras.
        cameras: usize,
        /// The scene's extent in dataset units.
        extent: f64,
    },
    /// A training camera is far from all others, so its pose is probably wrong. The scene's extent ignores it.
    CameraFarAway {
        /// Name of the view.
        name: String,
        /// Its distance from the middle of all cameras in multiples of the median distance.
        times: f64,
    },
    /// The pose of a photograph is wrong.
    PoseWrong {
        /// Name of the view.
        name: String,
        /// Why the pose is wrong.
        fault: PoseFault,
        /// Whether the photograph is left out of training. Held-out ones are still scored.
        left_out: bool,
    },
    /// The pose of a photograph is worse than those of the others. The photograph is still used.
    PoseDoubtful {
        /// Name of the view.
        name: String,
        /// Why the pose is doubtful.
        fault: PoseFault,
    },
    /// Poses and points do not belong together.
    PosesAgainstPoints {
        /// The file with the poses.
        file: PathBuf,
        /// Photographs that do not see their points where they should be.
        wrong: usize,
        /// Photographs that were judged.
        of: usize,
    },
    /// Photographs with every pixel masked are not used.
    AllMasked {
        /// Their number.
        photographs: usize,
        /// The first of these photographs.
        first: String,
    },
    /// Masks that leave out no pixel.
    MasksLeaveOutNothing {
        /// Their number.
        masks: usize,
        /// Number of all masks.
        of: usize,
        /// Photograph of the first such mask.
        first: String,
    },
    /// Masks of uniform colour whose transparency takes the colour's place.
    MasksByTransparency {
        /// Their number.
        masks: usize,
        /// Number of all masks.
        of: usize,
        /// Photograph of the first such mask.
        first: String,
    },
    /// Photographs have pixels brighter than the white level, which become white.
    BrighterThanWhite {
        /// Number of these photographs.
        photographs: usize,
        /// Number of these pixels.
        pixels: u64,
    },
    /// Photographs have transparent pixels, which are left out.
    TransparentLeftOut {
        /// Number of these photographs.
        photographs: usize,
        /// Number of these pixels.
        pixels: u64,
    },
    /// The folder has files of several formats.
    SeveralFormats {
        /// The format that was read.
        used: Format,
        /// The other formats.
        others: Vec<Format>,
    },
    /// The coordinates are in a map's grid less an offset, and the dataset does not say which.
    CoordinatesUnknown {
        /// The file that should name grid and offset.
        file: PathBuf,
        /// Why it does not.
        problem: String,
    },
    /// The reconstruction has several parts without a common frame, and the largest is used.
    OtherParts {
        /// Photographs of the largest part.
        used: usize,
        /// Number of other parts.
        parts: usize,
        /// Photographs of the other parts.
        shots: usize,
    },
    /// There are several COLMAP models, parts of a reconstruction without a common frame. The one with the most images
    /// is used.
    OtherModels {
        /// Folder of the used model inside the dataset.
        used: String,
        /// Number of its images.
        images: u64,
        /// Folders of the other models, and the number of their images.
        others: Vec<(String, u64)>,
    },
    /// There are COLMAP models in several places that are no parts of one reconstruction.
    OtherPlaces {
        /// Folder of the used model inside the dataset.
        used: String,
        /// Folders of the other models.
        others: Vec<String>,
    },
    /// The lists of a `transforms.json` (`train_filenames` and others) do not match its frames.
    SplitLists {
        /// Whether the lists are used. They are not if they leave nothing for training.
        used: bool,
        /// Names in the lists without a frame.
        unknown: usize,
        /// The first such name, and its list.
        first: Option<String>,
        /// Frames in no list, which are not used.
        in_none: usize,
        /// Frames in the training list and in a held-out list: they are held out.
        in_both: usize,
    },
    /// Files were found whose names differ from those in the model.
    OtherNames {
        /// "photographs" or "masks".
        what: &'static str,
        /// Number of all files of this kind.
        of: usize,
        /// The differences, counted by kind.
        renamed: Renamed,
    },
    /// There is a folder of masks, but no mask matches a photograph.
    NoMaskMatches {
        /// The folder.
        folder: PathBuf,
    },
    /// A folder's name is similar to that of the masks, and there is no folder of masks.
    UnreadMasks {
        /// That folder inside the dataset.
        folder: String,
    },
    /// There are too few photographs to hold any out.
    NothingHeldOut {
        /// Number of photographs.
        views: usize,
    },
    /// The model has no points: training begins with random points or with a given model.
    NoPoints {
        /// The points file, if there is one.
        file: Option<PathBuf>,
    },
    /// The colours of the points cannot be used: training takes them from the photographs.
    PointsWithoutColours(Colourless),
    /// Records that cannot be used are left out.
    LeftOut(LeftOut),
    /// A text file announces another number of records than it holds.
    CountDiffers {
        /// The file.
        file: PathBuf,
        /// The kind of the records, in the plural.
        what: &'static str,
        /// Number in the comment at the top.
        announced: u64,
        /// Number of records in the file.
        found: u64,
    },
    /// COLMAP images share a number by which points name images.
    SharedNumber {
        /// The first such number.
        number: u32,
        /// Images whose number an earlier image has.
        images: usize,
    },
    /// Points name images that are not in the model.
    UnknownObservers {
        /// The file with the points.
        file: PathBuf,
        /// Number of these points.
        points: usize,
        /// Id of the first of these points.
        point: u64,
        /// Number of the missing image that it names.
        image: u32,
    },
    /// The folder has photographs without a pose in the model.
    PhotographsWithoutPose {
        /// Number of these photographs.
        photographs: usize,
    },
}

impl Warning {
    /// Whether the warning matters for training only, and not for scores and depths of photographs.
    pub fn is_of_training(&self) -> bool {
        matches!(self, Self::NoPoints { .. } | Self::PointsWithoutColours(_))
    }

    /// Whether the warning is about the contents of files, so that it matters without poses and points.
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
