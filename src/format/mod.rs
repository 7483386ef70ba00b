//! File formats of models, training states and images.

pub mod atomic;
pub mod checkpoint;
pub(crate) mod contain;
pub mod disk;
mod error;
mod exposure_file;
pub(crate) mod foreign;
mod frame_file;
pub mod georaster;
pub mod geotiff;
#[cfg(feature = "html-viewer")]
pub mod html;
pub mod image_out;
pub mod las;
mod left_out;
pub mod lock;
pub(crate) mod markup;
pub mod names;
pub mod ply;
pub(crate) mod source;
pub mod splats;
mod text;
mod transform_file;

pub use error::{At, Error};
pub use exposure_file::{EXPOSURE_FILE, ExposureFile};
pub use frame_file::{FRAME_FILE, FrameFile};
pub use left_out::LeftOut;
pub(crate) use left_out::{OfRecord, Tally, few};
pub use text::read_text;
pub(crate) use text::{MARK, decode};
pub use transform_file::read_transform;
