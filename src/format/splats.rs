//! Models in the compact formats of viewers.
//!
//! The coordinates of a file are those of the model, [`Model::shift`](super::ply::Model::shift) not added.

mod choice;
mod codebook;
pub(in crate::format) mod decoding;
pub(in crate::format) mod encoding;
mod file;
mod flip;
pub mod gltf;
mod palette;
pub mod placement;
pub mod sog;
pub mod splat;
pub mod spz;

pub use choice::Choice;
pub use encoding::EncodeError;
pub use file::{Format, Placed, read, read_content, read_placed};
