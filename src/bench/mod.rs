//! Where the time of a training step goes: timestamps around every pass of warm steps, and the work of those passes.

mod measure;
mod memory_traffic;
mod model;
pub mod pareto;
pub mod plot;
mod quartiles;
mod rates;
mod report;
mod roofline;
mod rows;
mod sort;
mod statistics;
mod upscale;

pub use measure::{COPY_BYTES, Options, commands, measure};
pub use memory_traffic::{Work, bytes};
pub use model::resized;
pub use quartiles::Quartiles;
pub use rates::Rates;
pub use report::{DeviceName, Loss, PassRow, PerStep, Report, StageRow, Workload};
pub use roofline::PerPixel;
pub use roofline::{Arithmetic, Floors, arithmetic};
pub use sort::{SortReport, sort};
pub use statistics::statistics;

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
