//! Errors of a benchmark.

use crate::{train, vk};

/// An error of a benchmark.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The device layer failed.
    #[error(transparent)]
    Device(#[from] vk::Error),
    /// A training step failed.
    #[error(transparent)]
    Train(#[from] train::Error),
    /// The timed work was not the work of a real training.
    #[error("the results are not live, so the times say nothing: {0}")]
    NotLive(String),
    /// The queue takes no timestamps.
    #[error("{device} takes no timestamps on its compute queue: passes cannot be timed")]
    NoTimestamps {
        /// Name of the device.
        device: String,
    },
    /// No step is to be timed.
    #[error("at least one step has to be timed")]
    NoSteps,
}
