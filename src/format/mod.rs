//! Files that hold models, states of training and pictures.

pub mod atomic;
pub mod checkpoint;
pub(crate) mod contain;
pub mod disk;
mod error;
mod exposure_file;
pub(crate) mod foreign;
mod frame_file;
pub mod image_out;
pub mod las;
pub mod lock;
pub(crate) mod markup;
pub mod ply;
pub(crate) mod source;
mod transform_file;

pub use error::{At, Error};
pub use exposure_file::{EXPOSURE_FILE, ExposureFile};
pub use frame_file::{FRAME_FILE, FrameFile};
pub use transform_file::read_transform;
