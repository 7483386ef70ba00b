//! What can be wrong with weights, and with what a distance is asked of.

use std::path::PathBuf;

use crate::{format, vk};

/// An error of the perceptual distance.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read, or its content breaks the rules of its format.
    #[error(transparent)]
    File(#[from] format::Error),
    /// The device layer failed.
    #[error(transparent)]
    Device(#[from] vk::Error),
    /// The file is of no known format.
    #[error("{}: no weights in a known format (ncnn .param and .bin, PyTorch .pth, .safetensors)", file.display())]
    UnknownFormat {
        /// The file.
        file: PathBuf,
    },
    /// The file lacks an array: it belongs to another network.
    #[error("{}: there is no '{field}', so it is not of {network}", file.display())]
    Missing {
        /// The file.
        file: PathBuf,
        /// The array.
        field: String,
        /// What was to be read.
        network: &'static str,
    },
    /// An array has another shape: the file belongs to another network.
    #[error("{}: '{field}' has the shape {found:?} where {wanted:?} is expected", file.display())]
    Shape {
        /// The file.
        file: PathBuf,
        /// The array.
        field: String,
        /// Its shape.
        found: Vec<usize>,
        /// The shape it should have.
        wanted: Vec<usize>,
    },
    /// An array holds something that is not a number, or a negative number where there must be none.
    #[error("{}: '{field}' holds {value}, which no weight can be", file.display())]
    Value {
        /// The file.
        file: PathBuf,
        /// The array.
        field: String,
        /// The value.
        value: f32,
    },
    /// A folder holds no weights.
    #[error("{}: there is no file of {what} in this folder (looked for {names})", folder.display())]
    NotFound {
        /// The folder.
        folder: PathBuf,
        /// What was looked for.
        what: &'static str,
        /// The names that it may have.
        names: String,
    },
    /// An image that the network reduces to nothing.
    #[error("an image of {width}x{height} is too small for the perceptual distance: {least}x{least} is the least")]
    TooSmall {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
        /// Smallest side.
        least: u32,
    },
    /// A window that is not inside of its image.
    #[error("a window of {size:?} at {at:?} is not inside of an image of {image:?} pixels")]
    Outside {
        /// Width and height of the window.
        size: (u32, u32),
        /// Its first column and row.
        at: (u32, u32),
        /// Width and height of the image.
        image: (u32, u32),
    },
    /// Pixels that are not as many as the size says.
    #[error("{found} bytes of pixels where {expected} are expected")]
    Pixels {
        /// Bytes given.
        found: usize,
        /// Bytes needed.
        expected: usize,
    },
    /// A gradient was asked for where room was made for the value alone.
    #[error("a gradient was asked of a distance that was made for its value alone")]
    ValueOnly,
}
