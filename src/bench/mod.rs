//! Where the time of a training step goes: timestamps around every pass of warm steps, and what those passes worked on.

mod enlarge;
mod error;
mod floors;
mod measure;
mod model;
pub mod pareto;
mod per_pixel;
pub mod plot;
mod quartiles;
mod rates;
mod report;
mod rows;
mod sort;
mod traffic;

pub use error::Error;
pub use floors::{Arithmetic, Floors, arithmetic};
pub use measure::{COPY_BYTES, Options, commands, measure};
pub use model::resized;
pub use per_pixel::PerPixel;
pub use quartiles::Quartiles;
pub use rates::Rates;
pub use report::{DeviceName, Loss, PassRow, PerStep, Report, StageRow, Workload};
pub use sort::{SortReport, sort};
pub use traffic::{Work, bytes};
