//! What files keep of the way from a dataset to a map.

use serde::{Deserialize, Serialize};

use super::Geodetic;

/// The way from dataset coordinates to easting, northing and height, as `frame.json` keeps it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MapFrame {
    /// Name of the map's reference system.
    pub system: String,
    /// Its EPSG code, if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub epsg: Option<u32>,
    /// Its PROJ string.
    pub proj: String,
    /// What heights are measured from.
    pub heights: String,
    /// What the place is known from: `dataset`, `gps` or `control-points`.
    pub known_from: String,
    /// The place of `at` on Earth.
    pub origin: Geodetic,
    /// The point of the dataset about which `dataset_to_map` is best.
    pub at: [f64; 3],
    /// The similarity from dataset to map coordinates that is best about `at`, row-major. A map is no plane picture of
    /// the Earth, so it is off by some centimetres a kilometre away.
    pub dataset_to_map: [[f64; 4]; 4],
    /// The plane that touches the Earth, and the similarity that leads from the dataset (or from its own grid, see
    /// `coordinates`) to metres east, north and up of it: what was fitted, where anything was.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fitted: Option<FittedPlane>,
}

/// A similarity to a plane that touches the Earth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FittedPlane {
    /// The place where east, north and up are zero.
    pub origin: Geodetic,
    /// The similarity to east, north and up in metres, row-major.
    pub similarity: [[f64; 4]; 4],
}
