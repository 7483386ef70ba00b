//! Scenes larger than one machine: the ground is cut into cells, a block of photographs is trained for each cell, and
//! each cell keeps the splats that lie in it.
//!
//! A [`PlanFile`] says which block has which cell and which photographs, and what it was made from. It is all that a
//! machine has to know to train a block.

mod cell;
mod done;
mod error;
mod folder;
mod frequency;
mod ground;
mod hash;
mod memory;
mod merge;
mod partition;
mod photographs;
mod picture;
mod plan;
mod plan_file;
mod surface;
mod table;
mod time;
mod unchanged;

pub use cell::Cell;
pub use done::{BEGUN_FILE, BlockMetrics, DONE_FILE, DoneFile, GLOBAL, Origin, Stale};
pub use error::{Error, Limit};
pub use folder::{BlockState, MODEL_FILE, PlanFolder};
pub use ground::Ground;
pub use hash::{FileRecord, sha256_of};
pub use merge::{BlockModel, Merged, merge};
pub use picture::picture;
pub use plan::{Count, PlanRequest, Planned, model_sha256, plan};
pub use plan_file::{
    Block, DatasetRecord, FORMAT, GlobalModel, PLAN_FILE, PLAN_PICTURE, PlanFile, PlannedPhotograph, VERSION, is_inside,
};
pub use table::table;
pub use unchanged::changed_photograph;
