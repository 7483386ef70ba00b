//! The scene: Gaussians as attribute planes, cameras, and the frame that ties them to the dataset's coordinates.

mod camera;
mod coordinates;
mod frame;
mod gaussians;
pub mod init;
mod map_frame;
mod morton;
mod principal;
pub mod random;
mod real;
mod region;
pub mod sh;
mod sh_rotation;
mod similarity;
pub mod tile;
mod upright;
pub mod viewpoints;

pub use camera::Camera;
pub use coordinates::{Coordinates, Geodetic};
pub use frame::Frame;
pub use gaussians::{Gaussians, SH_GROUP_FLOATS, SH_GROUPS};
pub use map_frame::{FittedPlane, MapFrame};
pub use morton::rows_of;
pub use principal::principal;
pub use real::Real;
pub use region::Region;
pub use similarity::{NoSimilarity, Similarity};
pub use tile::TileGrid;
pub use upright::{turn, up_of};

/// An affine map of colours from 0 to 1, row-major: it takes (r, g, b, 1) of a render to the colour in the photograph.
pub type ExposureMatrix = [[f64; 4]; 3];
