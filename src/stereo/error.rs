//! What can be wrong with what stereo is asked for.

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
    #[error("stereo: {name} is {value}; it is {allowed}")]
    Setting {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: String,
        /// What it may be.
        allowed: &'static str,
    },
    /// A view's values are not as many as its pixels.
    #[error("stereo: view {view} has {found} values of {what} for {expected} pixels")]
    Pixels {
        /// The view.
        view: usize,
        /// Which values.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many there should be.
        expected: usize,
    },
    /// A view names a source that is none.
    #[error("stereo: view {view} cannot have view {wrong} as a source")]
    Source {
        /// The view.
        view: usize,
        /// The source.
        wrong: usize,
    },
}
