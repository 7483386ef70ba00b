//! Files that hold models, states of training and pictures.

mod error;
pub(crate) mod source;

pub use error::{At, Error};
