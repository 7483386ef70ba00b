//! Small valid files of every kind, generated.

pub mod clouds;
pub mod documents;
pub mod folders;
pub mod pictures;
pub mod places;
pub mod runs;
pub mod splats;
pub mod weights;
