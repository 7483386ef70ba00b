//! Maps of models: points on a map, and how accurate a map is.

pub mod accuracy;
mod splat_points;
mod steps;
mod stereo_points;

pub use splat_points::SplatPoints;
pub use steps::steps;
pub use stereo_points::StereoPoints;
