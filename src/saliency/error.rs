//! What can be wrong with what saliency is asked for.

/// An error of saliency.
#[derive(Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Values do not make an image of the size that was named.
    #[error("{what}: {found} values where {expected} are needed")]
    Size {
        /// What the values are of.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many there should be.
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
    /// A setting makes no sense.
    #[error("{name}: must be {want}, and is {value}")]
    Setting {
        /// Its name.
        name: &'static str,
        /// What it may be.
        want: &'static str,
        /// What it is.
        value: f64,
    },
    /// An image that is not there was asked for.
    #[error("there is no image {index} among {images}")]
    NoImage {
        /// Its number.
        index: usize,
        /// How many there are.
        images: usize,
    },
    /// A saved state is not one of this network.
    #[error("the saved state of the sigma network: {0}")]
    State(String),
}

impl Error {
    /// Refuses all but `count` values.
    pub(super) fn check(what: &'static str, found: usize, expected: usize) -> Result<(), Self> {
        if found == expected { Ok(()) } else { Err(Self::Size { what, found, expected }) }
    }
}
