//! Where the time of a training step goes: timestamps around every pass of warm steps, and the work of those passes.

mod error;
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
mod upscale;

pub use error::Error;
pub use measure::{COPY_BYTES, Options, commands, measure};
pub use memory_traffic::{Work, bytes};
pub use model::resized;
pub use quartiles::Quartiles;
pub use rates::Rates;
pub use report::{DeviceName, Loss, PassRow, PerStep, Report, StageRow, Workload};
pub use roofline::PerPixel;
pub use roofline::{Arithmetic, Floors, arithmetic};
pub use sort::{SortReport, sort};
