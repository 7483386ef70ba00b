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
    /// A photograph has changed since it was first read.
    #[error("{}: this photograph, or its mask, has changed since it was first read; put it back as it was", file.display())]
    ChangedSince {
        /// The photograph's file.
        file: PathBuf,
    },
    /// A name that no photograph has.
    #[error("{}: no photograph is named '{name}'; the dataset has changed, or is another one", dataset.display())]
    NoSuchPhotograph {
        /// The dataset's folder.
        dataset: PathBuf,
        /// The name.
        name: String,
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
    /// All poses have another convention than that of their format.
    #[error("{}: the poses are {what}", file.display())]
    PosesInOtherConvention {
        /// The file with the poses.
        file: PathBuf,
        /// The convention of the poses, and the remedy.
        what: WrongConvention,
    },
    /// Names and poses are in different orders.
    #[error(
        "{}: {} of {} fit better from the poses of others than from their own, as the colours of the points show: \
         names and poses are not in the same order. Export them again from the reconstruction",
        file.display(), grouped(*changed), counted(*of, "photograph")
    )]
    PosesOfOthers {
        /// The dataset.
        file: PathBuf,
        /// Photographs that fit better from the pose of another one.
        changed: usize,
        /// Photographs that were compared.
        of: usize,
    },
    /// No folder with photographs.
    #[error("{}: no folder of photographs; looked for {looked_for}; the setting `images` names another{elsewhere}", folder.display())]
    NoPhotographs {
        /// The dataset.
        folder: PathBuf,
        /// The folders tried.
        looked_for: String,
        /// The folder with photographs of these names, worded to follow the sentence; empty where none is known.
        elsewhere: String,
    },
    /// Photographs of the model are missing.
    #[error(
        "{}: {} of {} {} missing, {}'{first}'{nearest}; put {} back or remove {} from the model",
        folder.display(), grouped(*count), counted(*total, "photograph"), of_count(*count, "is", "are"),
        of_count(*count, "", "the first of them "), of_count(*count, "the file", "them"), of_count(*count, "the pose", "their poses")
    )]
    MissingPhotographs {
        /// The folder of photographs.
        folder: PathBuf,
        /// Missing photographs.
        count: usize,
        /// All photographs of the model.
        total: usize,
        /// The first missing photograph in bytewise order.
        first: String,
        /// The nearest name in the folder, worded to follow the sentence; may be empty.
        nearest: String,
    },
    /// A path in a file of the dataset that leads to no file in the dataset.
    #[error("{}: {field} is '{path}'{nearest}", file.display())]
    NoSuchFile {
        /// The file with the path.
        file: PathBuf,
        /// The field with the path.
        field: String,
        /// The path.
        path: String,
        /// Why the path leads nowhere, and the nearest file.
        nearest: String,
    },
    /// A photograph and its camera have different aspect ratios.
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
    /// A mask and its photograph have different aspect ratios.
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
        /// Width and height of the photograph.
        photograph: (u32, u32),
        /// Whether the mask would fit after a turn by 90 degrees.
        turned: bool,
    },
    /// Decoding a picture would take more memory than allowed.
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
    /// The system has too little memory for decoding a picture.
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
        /// Bytes that the decoder had read.
        at: u64,
        /// The decoder's message.
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
    /// Finite numbers from which others follow that are not finite.
    #[error("{}: {what} cannot be used: {problem}", file.display())]
    OutOfRange {
        /// The file with the poses, or with the points.
        file: PathBuf,
        /// The camera or point.
        what: String,
        /// Its problem.
        problem: String,
    },
    /// The options ask for an image of size 0.
    #[error("the longest side of an image (`max-side`) must be at least 1 pixel")]
    ZeroMaxSide,
    /// A size or factor that no image can have.
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
    /// No dataset was found, of the given format or of any.
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
