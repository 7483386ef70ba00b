//! Errors of the world generator.

use std::path::PathBuf;

/// Errors of the world generator.
#[derive(Debug, thiserror::Error)]
pub enum WorldError {
    /// A parameter is out of its range.
    #[error("world parameter `{name}` is {value}, but must be from {low} to {high}")]
    Parameter {
        /// The parameter.
        name: &'static str,
        /// Its value.
        value: f64,
        /// Smallest value allowed.
        low: f64,
        /// Largest value allowed.
        high: f64,
    },
    /// Depth is taken along the ray through a pixel's centre, so the number of samples per side must be odd.
    #[error("world parameter `supersample` is {value}, but must be odd")]
    EvenSupersample {
        /// The value given.
        value: u32,
    },
    /// The distortion folds the photograph over within its frame.
    #[error(
        "world parameters `distortion` and `focal` make a lens that shows a point of the undistorted image twice, \
         or not at all: bring `distortion` nearer to 0 or raise `focal`"
    )]
    Lens,
    /// The folder has a file that does not belong to a world and would be replaced.
    #[error("{path}: no world made this file, and it would be replaced; choose another folder")]
    Taken {
        /// The file or folder.
        path: PathBuf,
    },
    /// A file or folder could not be written.
    #[error("cannot write {path}: {source}")]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// A photograph could not be encoded.
    #[error("cannot write the photograph {path}: {source}")]
    Photograph {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: image::ImageError,
    },
    /// The position of a photograph could not be encoded.
    #[error("cannot write the position in the photograph {path}: {source}")]
    Geotag {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: exif::Error,
    },
    /// The world lies on no map.
    #[error(transparent)]
    Map(#[from] crate::geodesy::Error),
    /// Ground truth could not be written.
    #[error(transparent)]
    File(#[from] crate::format::Error),
    /// The laser scan could not be written.
    #[error("cannot write the laser scan {path}: {source}")]
    Las {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: Box<las::Error>,
    },
    /// The parameters could not be written as TOML.
    #[error("cannot write the parameters: {0}")]
    Toml(#[from] toml::ser::Error),
}
