//! Errors of the perceptual distance.

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
    #[error("{}: the array '{field}' is missing, so the file does not hold {network}", file.display())]
    Missing {
        /// The file.
        file: PathBuf,
        /// The array.
        field: String,
        /// The network to be read.
        network: &'static str,
    },
    /// An array has another shape: the file belongs to another network.
    #[error("{}: '{field}' has the shape {found:?}, expected {wanted:?}", file.display())]
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
    /// An array holds a value that is not finite, or a negative value where none is allowed.
    #[error("{}: '{field}' holds {value}, which is no valid weight", file.display())]
    Value {
        /// The file.
        file: PathBuf,
        /// The array.
        field: String,
        /// The value.
        value: f32,
    },
    /// A folder has no file of weights.
    #[error(
        "{}: this folder has no file with the weights of {what}; add one of {names}",
        folder.display()
    )]
    NotFound {
        /// The folder.
        folder: PathBuf,
        /// The weights that are missing.
        what: &'static str,
        /// The names that the file may have.
        names: String,
    },
    /// An image is too small for the network.
    #[error(
        "an image of {width}x{height} pixels is too small for the perceptual distance, which needs {least}x{least}"
    )]
    TooSmall {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
        /// Smallest side.
        least: u32,
    },
    /// A window is not inside its image.
    #[error("a window of {size:?} pixels at {at:?} is not inside an image of {image:?} pixels")]
    Outside {
        /// Width and height of the window.
        size: (u32, u32),
        /// Its first column and row.
        at: (u32, u32),
        /// Width and height of the image.
        image: (u32, u32),
    },
    /// The number of bytes does not fit the image's size.
    #[error("{found} bytes of pixels, expected {expected}")]
    Pixels {
        /// Bytes given.
        found: usize,
        /// Bytes needed.
        expected: usize,
    },
    /// A gradient was requested from windows without memory for gradients.
    #[error("these windows have no memory for gradients: make them with `gradient` set")]
    ValueOnly,
}
