//! Maps of models: orthophoto and surface model from above, points on a map, and how accurate a map is.
//!
//! A map is a [`Grid`] of square cells in easting and northing. [`Surface`] renders any window of the grid under
//! parallel rays; a cell's values do not depend on the window that it is rendered in, so a map of any size is made of
//! windows that fit in memory, without seams.

pub mod accuracy;
mod area;
mod error;
mod grid;
mod ground;
mod hillshade;
mod photographs;
mod placement;
pub mod products;
mod quantile;
mod splat_points;
mod steps;
mod stereo_points;
mod surface;

pub use area::{Area, ground_sample_distance};
pub use error::Error;
pub use grid::{Bounds, Grid, Window};
pub use photographs::{IMAGE_ERROR, Photographs, Sight};
pub use placement::Placement;
pub use splat_points::SplatPoints;
pub use steps::steps;
pub use stereo_points::StereoPoints;
pub use surface::{Block, OPAQUE, Surface, SurfaceModel};
