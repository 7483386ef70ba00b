//! Errors of stereo.

use crate::{dataset, vk};

/// An error of multi-view stereo.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The device layer failed.
    #[error(transparent)]
    Device(#[from] vk::Error),
    /// A photograph could not be read.
    #[error(transparent)]
    Dataset(#[from] dataset::Error),
    /// A setting out of its range.
    #[error("stereo: {name} is {value}, but must be {allowed}")]
    Setting {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: String,
        /// The allowed values.
        allowed: &'static str,
    },
    /// A view's number of values differs from its number of pixels.
    #[error("stereo: view {view} has {found} values of {what} for {expected} pixels")]
    Pixels {
        /// The view.
        view: usize,
        /// Which values.
        what: &'static str,
        /// Number of values given.
        found: usize,
        /// Number of values needed.
        expected: usize,
    },
    /// A view names a source that does not exist or is the view itself.
    #[error("stereo: view {view} cannot have view {wrong} as a source")]
    Source {
        /// The view.
        view: usize,
        /// The source.
        wrong: usize,
    },
}
