//! Why a dataset cannot be used.

use std::path::{Path, PathBuf};

use super::hint;
use super::lens::SUPPORTED_MODELS;
use super::model::Format;
use super::poses::WrongConvention;
use crate::byte_size::readable;
use crate::format::{self, OfRecord};
use crate::host_memory::DecodeLimit;
use crate::numbers::{counted, grouped, of_count};

/// A dataset could not be loaded.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file is missing, unreadable or not what its format asks for.
    #[error(transparent)]
    File(#[from] format::Error),
    /// No model was found.
    #[error("{}: no dataset here; looked for {looked_for}; {instead}", folder.display())]
    NoModel {
        /// The folder that was given.
        folder: PathBuf,
        /// The files that would have been read.
        looked_for: String,
        /// The contents found in its place, and the remedy.
        instead: String,
    },
    /// A camera model that is not known.
    #[error(
        "{}: camera {camera} has the model {model}, which is not supported ({} are). \
         Undistort the photographs with COLMAP's image_undistorter and use its output folder", file.display(), SUPPORTED_MODELS
    )]
    UnsupportedCamera {
        /// The cameras file.
        file: PathBuf,
        /// The camera's number in it.
        camera: u32,
        /// COLMAP's name of the model.
        model: &'static str,
    },
    /// A photograph that is read again is not the one that was read first.
    #[error("{}: this photograph, or its mask, has changed since it was first read; put it back as it was", file.display())]
    ChangedSince {
        /// Its file.
        file: PathBuf,
    },
    /// A model without photographs.
    #[error("{}: the model has no images", file.display())]
    NoImages {
        /// The images file.
        file: PathBuf,
    },
    /// Two poses with the same photograph.
    #[error("{}: two images are named '{name}'", file.display())]
    DuplicateName {
        /// The images file.
        file: PathBuf,
        /// The name.
        name: String,
    },
    /// A name that leaves the folder of the photographs.
    #[error("{}: the image name '{name}' leads out of the folder of photographs", file.display())]
    NameOutside {
        /// The images file.
        file: PathBuf,
        /// The name.
        name: String,
    },
    /// All poses are the wrong way round, or of other axes.
    #[error("{}: the poses are {what}", file.display())]
    PosesInOtherConvention {
        /// The file with the poses.
        file: PathBuf,
        /// The convention of the poses, and the remedy.
        what: WrongConvention,
    },
    /// Names and poses that do not belong together.
    #[error(
        "{}: {} of {} fit better from the poses of others than from their own, as the colours of the points show: \
         names and poses are not in the same order. Export them again from the reconstruction",
        file.display(), grouped(*changed), counted(*of, "photograph")
    )]
    PosesOfOthers {
        /// The dataset.
        file: PathBuf,
        /// How many photographs fit better from the pose of another.
        changed: usize,
        /// All that were looked at.
        of: usize,
    },
    /// No folder with photographs.
    #[error("{}: no folder of photographs; looked for {looked_for}; the setting `images` names another{elsewhere}", folder.display())]
    NoPhotographs {
        /// The dataset.
        folder: PathBuf,
        /// The folders tried.
        looked_for: String,
        /// Where photographs of these names are, to follow in the sentence; empty where that is not known.
        elsewhere: String,
    },
    /// Poses whose photographs are not there.
    #[error(
        "{}: {} of {} {} missing, {}'{first}'{nearest}; put {} back or remove {} from the model",
        folder.display(), grouped(*count), counted(*total, "photograph"), of_count(*count, "is", "are"),
        of_count(*count, "", "the first of them "), of_count(*count, "the file", "them"), of_count(*count, "the pose", "their poses")
    )]
    MissingPhotographs {
        /// Where they should be.
        folder: PathBuf,
        /// How many are missing.
        count: usize,
        /// How many the model names.
        total: usize,
        /// The first missing one, bytewise.
        first: String,
        /// What is there in its place, to follow in the sentence; may be empty.
        nearest: String,
    },
    /// A path in a file of the dataset that leads to nothing inside of it.
    #[error("{}: {field} is '{path}'{nearest}", file.display())]
    NoSuchFile {
        /// The file with the path.
        file: PathBuf,
        /// The field with the path.
        field: String,
        /// The path.
        path: String,
        /// Why it leads to nothing, and what is there in its place.
        nearest: String,
    },
    /// The photograph has not the shape its camera says.
    #[error(
        "{}: the photograph is {}x{}, its camera {camera} is {}x{}, which is another aspect ratio{hint}",
        file.display(), photograph.0, photograph.1, expected.0, expected.1
    )]
    AspectRatio {
        /// The photograph.
        file: PathBuf,
        /// Its width and height.
        photograph: (u32, u32),
        /// The name of the camera in the model.
        camera: String,
        /// The camera's width and height.
        expected: (u32, u32),
        /// A likely reason.
        hint: &'static str,
    },
    /// A mask has not the shape of its photograph.
    #[error(
        "{}: the mask is {}x{}, its photograph {}x{}, which is another aspect ratio{}",
        file.display(), mask.0, mask.1, photograph.0, photograph.1,
        if *turned { "; turned by 90 degrees the mask would fit: orientation tags of EXIF are not applied" }
        else { "; make the mask anew from this photograph, or take it out of the folder" }
    )]
    MaskSize {
        /// The mask.
        file: PathBuf,
        /// Its width and height.
        mask: (u32, u32),
        /// The photograph's.
        photograph: (u32, u32),
        /// Whether it would fit turned by 90 degrees.
        turned: bool,
    },
    /// Decoding a picture would take more memory than it may.
    #[error(
        "{}: the picture is {}x{} pixels, and decoding it takes {} of memory, of which {} may be used; store a \
         smaller picture, or {}",
        file.display(), size.0, size.1, readable(*needed), readable(limit.most),
        if limit.asked { "allow more host memory" } else { "use a machine with more memory" }
    )]
    PictureTooLarge {
        /// The picture.
        file: PathBuf,
        /// Its width and height.
        size: (u32, u32),
        /// Bytes that decoding takes.
        needed: u64,
        /// The memory that decoding may take.
        limit: DecodeLimit,
    },
    /// The system gives no memory for decoding a picture.
    #[error(
        "{}: the picture is {}x{} pixels, and decoding it takes {} of memory, which the system does not give; store a \
         smaller picture, or free memory", file.display(), size.0, size.1, readable(*needed)
    )]
    NoMemoryForPicture {
        /// The picture.
        file: PathBuf,
        /// Its width and height.
        size: (u32, u32),
        /// Bytes that decoding takes.
        needed: u64,
    },
    /// The photograph cannot be decoded.
    #[error("{}: {field} at byte {at}: {problem}", file.display())]
    Undecodable {
        /// The photograph.
        file: PathBuf,
        /// "header" or "pixels".
        field: &'static str,
        /// How far the decoder had read.
        at: u64,
        /// Its complaint.
        problem: String,
    },
    /// The photograph changed between loading the dataset and reading the pixels.
    #[error(
        "{}: the photograph is {}x{} now and was {}x{} when the dataset was loaded",
        file.display(), now.0, now.1, before.0, before.1
    )]
    Changed {
        /// The photograph.
        file: PathBuf,
        /// Width and height found now.
        now: (u32, u32),
        /// Width and height found at first.
        before: (u32, u32),
    },
    /// Numbers that are finite and lead to some that are not.
    #[error("{}: {what} cannot be used: {problem}", file.display())]
    OutOfRange {
        /// The file with the poses, or with the points.
        file: PathBuf,
        /// Which camera or point.
        what: String,
        /// What is wrong with it.
        problem: String,
    },
    /// The options ask for images of no size.
    #[error("the longest side of an image (`max-side`) must be at least 1 pixel")]
    ZeroMaxSide,
    /// A size or a factor that no image can have.
    #[error("a width and a height (`width`, `height`) must be at least 1 pixel, a factor (`downscale`) at least 1")]
    BadSize,
    /// A photograph cannot be reduced to the size asked for.
    #[error(
        "{}: {}x{} cannot be made {}x{}: sizes are only reduced, and by the same factor along both sides up to a pixel",
        file.display(), photograph.0, photograph.1, wanted.0, wanted.1
    )]
    SizeDoesNotFit {
        /// The photograph.
        file: PathBuf,
        /// Width and height of the file.
        photograph: (u32, u32),
        /// Width and height asked for.
        wanted: (u32, u32),
    },
}

impl Error {
    /// Nothing was found, of the format that was asked for or of any.
    pub(super) fn no_model(folder: &Path, looked_for: String, asked: Option<Format>) -> Self {
        match hint::unreadable(folder) {
            Some(error) => error.into(),
            None => {
                let instead = hint::instead_of_dataset(folder, asked);
                Self::NoModel { folder: folder.to_owned(), looked_for, instead }
            }
        }
    }

    pub(crate) fn undecodable(file: &Path, field: &'static str, at: u64, problem: impl std::fmt::Display) -> Self {
        Self::Undecodable { file: file.to_owned(), field, at, problem: problem.to_string() }
    }
}

impl OfRecord for Error {
    fn with(self, more: String) -> Self {
        match self {
            Self::File(file) => Self::File(file.with(more)),
            Self::OutOfRange { file, what, problem } => Self::OutOfRange { file, what, problem: problem + &more },
            Self::Undecodable { file, field, at, problem } => {
                Self::Undecodable { file, field, at, problem: problem + &more }
            }
            other => other,
        }
    }
}
