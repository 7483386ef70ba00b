//! Where the time of a training step goes: timestamps around every pass of warm steps, and what those passes worked on.

mod error;
mod measure;
mod model;
mod quartiles;
mod report;
mod rows;
mod traffic;

pub use error::Error;
pub use measure::{Options, measure};
pub use model::resized;
pub use quartiles::Quartiles;
pub use report::{DeviceName, Loss, PassRow, PerPixel, PerStep, Report, StageRow, Workload};
pub use traffic::{Work, bytes};
