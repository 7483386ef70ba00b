//! Models in the compact formats of viewers.
//!
//! The coordinates of a file are those of the model, [`Model::shift`](super::ply::Model::shift) not added.

mod codebook;
mod decoding;
mod encoding;
pub mod sog;

pub use encoding::EncodeError;
