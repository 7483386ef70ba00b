//! What the user should know about a dataset that loads.

use std::fmt;
use std::path::PathBuf;

use super::{Colourless, Format, PoseFault, Renamed};
use crate::format::LeftOut;
use crate::numbers::{counted, grouped, of_count};

/// Other models are named up to this many.
const NAMED: usize = 5;

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
        /// What the records are, in the plural.
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

/// "1 of 9 masks".
fn masks_of(masks: usize, of: usize) -> String {
    format!("{} of {}", grouped(masks), counted(of, "mask"))
}

/// What is said before the name of the first; a single one is not the first of several.
fn the_first(n: usize) -> &'static str {
    of_count(n, "", "the first ")
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::CamerasAtOnePlace { cameras, extent } => write!(
                f,
                "the training cameras ({}) are all at one place beside the distance of the points: the scene's extent \
                 is taken from these ({extent} units)",
                grouped(*cameras)
            ),
            Self::CameraFarAway { name, times } => write!(
                f,
                "the camera of '{name}' is {times:.0} times as far from the others as they are from one another: its \
                 pose is probably wrong. Leave the photograph out, or mend its pose; the scene's extent is taken from \
                 the others"
            ),
            Self::PoseWrong { name, fault, left_out: true } => write!(
                f,
                "'{name}' is left out of training, as its pose is wrong: {fault}. Mend the pose, or take the \
                 photograph out of the model"
            ),
            Self::PoseWrong { name, fault, left_out: false } => write!(
                f,
                "the pose of '{name}' is wrong, and so will be the score of this held-out photograph: {fault}. Mend \
                 the pose, or take the photograph out of the model"
            ),
            Self::PoseDoubtful { name, fault } => {
                write!(
                    f,
                    "the pose of '{name}' is in doubt: {fault}. If its pictures turn out blurred, leave the \
                     photograph out"
                )
            }
            Self::PosesAgainstPoints { file, wrong, of } => write!(
                f,
                "{}: {} of {} {} not agree with the points that their photographs observe: poses and points are of \
                 different reconstructions, or in different coordinates. Export both from the same one",
                file.display(),
                grouped(*wrong),
                counted(*of, "pose"),
                of_count(*wrong, "does", "do")
            ),
            Self::AllMasked { photographs: 1, first } => {
                write!(f, "'{first}': every pixel is masked; it is left out")
            }
            Self::AllMasked { photographs, first } => {
                write!(
                    f,
                    "{}, the first '{first}': every pixel is masked; they are left out",
                    counted(*photographs, "photograph")
                )
            }
            Self::MasksLeaveOutNothing { masks, of, first } => {
                write!(
                    f,
                    "{} {} out no pixel, {}that of '{first}'",
                    masks_of(*masks, *of),
                    of_count(*masks, "leaves", "leave"),
                    the_first(*masks)
                )
            }
            Self::MasksByTransparency { masks, of, first } => write!(
                f,
                "{}, {}that of '{first}', {} transparency what is left out, as {} colour says nothing: transparent \
                 counts as black",
                masks_of(*masks, *of),
                the_first(*masks),
                of_count(*masks, "says by its", "say by their"),
                of_count(*masks, "its", "their")
            ),
            Self::BrighterThanWhite { photographs, pixels } => write!(
                f,
                "{} {} pixels brighter than white ({} in all), which are made white; the setting `white-level` says \
                 which value is white",
                counted(*photographs, "photograph"),
                of_count(*photographs, "has", "have"),
                grouped(*pixels)
            ),
            Self::TransparentLeftOut { photographs, pixels } => write!(
                f,
                "{} {} transparent pixels ({} in all), which are left out: nothing keeps splats from \
                 them. If nothing is to be seen there, set `transparent` to `background`",
                counted(*photographs, "photograph"),
                of_count(*photographs, "has", "have"),
                grouped(*pixels)
            ),
            Self::NothingHeldOut { views } => {
                write!(
                    f,
                    "{} {} too few to hold any out: all are trained on, and no quality is measured",
                    counted(*views, "photograph"),
                    of_count(*views, "is", "are")
                )
            }
            Self::SeveralFormats { used, others } => {
                let others: Vec<String> = others.iter().map(ToString::to_string).collect();
                write!(
                    f,
                    "read as {used}; the folder could be read as {} too: the setting `format` chooses",
                    others.join(", ")
                )
            }
            Self::CoordinatesUnknown { file, problem } => write!(
                f,
                "the coordinates are those of a map less an offset, and {} does not say of which: {problem}. Training \
                 and pictures need neither; for coordinates on a map put the file of the run there",
                file.display()
            ),
            Self::OtherParts { used, parts, shots } => write!(
                f,
                "the reconstruction is in {} parts without a common frame: only the largest, of {}, is used; {} {} not",
                grouped(parts + 1),
                counted(*used, "photograph"),
                counted(*shots, "photograph"),
                of_count(*shots, "is", "are")
            ),
            Self::OtherModels { used, images, others } => {
                let named: Vec<String> = others
                    .iter()
                    .take(NAMED)
                    .map(|(folder, images)| format!("{folder} ({})", counted(*images, "image")))
                    .collect();
                let more = if others.len() > NAMED { ", ..." } else { "" };
                write!(
                    f,
                    "the reconstruction is in {} parts without a common frame: only the largest, {used} ({}), is \
                     used; {}{more} {} not. Parts that share photographs can be joined by colmap model_merger",
                    others.len() + 1,
                    counted(*images, "image"),
                    named.join(", "),
                    of_count(others.len(), "is", "are")
                )
            }
            Self::OtherPlaces { used, others } => {
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
            Self::SplitLists { used, unknown, first, in_none, in_both } => {
                write!(
                    f,
                    "train_filenames, val_filenames and test_filenames of transforms.json do not fit the frames: "
                )?;
                let mut said = Vec::new();
                if let Some(first) = first {
                    said.push(format!(
                        "{} in them {} no frame, {}{first}",
                        counted(*unknown, "name"),
                        of_count(*unknown, "is", "are"),
                        the_first(*unknown)
                    ));
                }
                if *in_none > 0 {
                    said.push(format!(
                        "{} {} in none of them",
                        counted(*in_none, "frame"),
                        of_count(*in_none, "is", "are")
                    ));
                }
                if *in_both > 0 {
                    said.push(format!(
                        "{} {} to be trained on and to be held out",
                        counted(*in_both, "frame"),
                        of_count(*in_both, "is", "are")
                    ));
                }
                let done = match used {
                    true => "frames in none are not used, and frames in two are held out",
                    false => "nothing would be left to train on, so the lists are not used",
                };
                write!(f, "{}; {done}", said.join(", "))
            }
            Self::OtherNames { what, of, renamed } => {
                write!(
                    f,
                    "{} of {} {what} {} than the model says and {} found all the same: {renamed}",
                    grouped(renamed.count()),
                    grouped(*of),
                    of_count(renamed.count(), "has another name", "have other names"),
                    of_count(renamed.count(), "was", "were")
                )
            }
            Self::NoMaskMatches { folder } => {
                write!(f, "{}: no mask has the name of a photograph (a.jpg.png or a.png for a.jpg)", folder.display())
            }
            Self::UnreadMasks { folder } => write!(
                f,
                "the pictures in {folder} are not read: masks are looked for in masks; rename the folder if that is \
                 what these are"
            ),
            Self::NoPoints { file } => {
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
            Self::PointsWithoutColours(colourless) => colourless.fmt(f),
            Self::LeftOut(left_out) => left_out.fmt(f),
            Self::CountDiffers { file, what, announced, found } => {
                let cut = if found < announced { "; it may have been cut off" } else { "" };
                write!(
                    f,
                    "{}: the comment at the top announces another number of {what} ({}) than the file holds ({}), \
                     which are used{cut}",
                    file.display(),
                    grouped(*announced),
                    grouped(*found)
                )
            }
            Self::SharedNumber { number, images } => write!(
                f,
                "images with a number that another image has: {}, the first of them with {number}; which of them \
                 points were seen from is not known",
                grouped(*images)
            ),
            Self::UnknownObservers { file, points, point, image } => write!(
                f,
                "{}: points that were seen from images that are not in the model: {}, the first of them point {point} \
                 from image {image}; these observations are not used",
                file.display(),
                grouped(*points)
            ),
            Self::PhotographsWithoutPose { photographs } => {
                write!(
                    f,
                    "{} {} no pose in the model and {} not used",
                    counted(*photographs, "photograph"),
                    of_count(*photographs, "has", "have"),
                    of_count(*photographs, "is", "are")
                )
            }
        }
    }
}
