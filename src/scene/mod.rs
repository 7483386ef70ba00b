//! The scene: Gaussians as attribute planes, cameras, and the frame that ties them to the dataset's coordinates.

mod camera;
mod coordinates;
mod frame;
mod gaussians;
pub mod init;
mod morton;
mod sh_rotation;
mod similarity;

pub use camera::Camera;
pub use coordinates::{Coordinates, Geodetic};
pub use frame::Frame;
pub use gaussians::{Gaussians, SH_GROUP_FLOATS, SH_GROUPS};
pub use morton::{SplatOrder, rows_of};
pub use similarity::{NoSimilarity, Similarity};
