//! Methods against one another: which runs a comparison takes, what their metrics say together, and the table of it.

mod differences;
mod interval;
mod page;
mod plan;
mod table;

pub use interval::{Difference, holm, paired};
pub use page::page;
pub use plan::{ABLATIONS, Ablation, OWN_GRAD_THRESHOLD, Primary, Run, Size};
pub use table::{Finished, Summary, csv, markdown, summaries};
