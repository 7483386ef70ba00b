//! Where a dataset lies on a map: reference systems by EPSG code or PROJ string, and the way from a dataset's coordinates
//! to easting, northing and height.
//!
//! Heights are those above the WGS 84 ellipsoid, unless the dataset's heights are others: no height is converted.

mod earth;
mod error;
pub mod fit;
mod georeference;
mod proj_string;
mod system;

pub use earth::Tangent;
pub use error::Error;
pub use georeference::{Georeference, KnownFrom};
pub use system::{ReferenceSystem, VerticalDatum};
