//! Errors of saliency.

/// An error of saliency.
#[derive(Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The number of values does not fit the size.
    #[error("{what}: {found} values where {expected} are needed")]
    Size {
        /// What the values belong to.
        what: &'static str,
        /// Number of values given.
        found: usize,
        /// Number of values needed.
        expected: usize,
    },
    /// An image without pixels.
    #[error("the image is {width}x{height}")]
    Empty {
        /// Its width.
        width: u32,
        /// Its height.
        height: u32,
    },
    /// A value of an image is infinite or not a number.
    #[error("value {index} of the image is {value}")]
    NotFinite {
        /// Its position, row by row from the top.
        index: usize,
        /// The value.
        value: f32,
    },
    /// A setting is out of its range.
    #[error("{name} must be {want}, but is {value}")]
    Setting {
        /// Name of the setting.
        name: &'static str,
        /// The allowed values.
        want: &'static str,
        /// The value given.
        value: f64,
    },
    /// An image does not exist.
    #[error("image {index} does not exist: {images} images are numbered from 0")]
    NoImage {
        /// Number of the image.
        index: usize,
        /// Number of images.
        images: usize,
    },
    /// A saved state does not belong to this network.
    #[error("the saved state of the sigma network: {0}")]
    State(String),
}

impl Error {
    /// Fails unless `found` equals `expected`.
    pub(super) fn check(what: &'static str, found: usize, expected: usize) -> Result<(), Self> {
        if found == expected { Ok(()) } else { Err(Self::Size { what, found, expected }) }
    }
}
