//! Where on Earth a dataset's coordinates are.

use std::fmt;

use serde::{Deserialize, Serialize};

/// A place on the WGS 84 ellipsoid.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Geodetic {
    /// Degrees to the north.
    pub latitude: f64,
    /// Degrees to the east.
    pub longitude: f64,
    /// Metres.
    pub altitude: f64,
}

/// What x, y and z of a dataset are, in metres, where its files say it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Coordinates {
    /// East, north and up in the plane that touches the ellipsoid at `origin`.
    EastNorthUp {
        /// Where all three are zero.
        origin: Geodetic,
    },
    /// Easting, northing and height in a map's grid, less an offset. North is the grid's, not the true one,
    /// and lengths are the grid's.
    Grid {
        /// The reference system as the dataset names it, such as `WGS84 UTM 17N`.
        crs: String,
        /// Its EPSG code, where the name is one that is known.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        epsg: Option<u32>,
        /// Its PROJ string, where the dataset has one.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        proj: Option<String>,
        /// What to add to x and y to have easting and northing; heights have no offset.
        offset: [f64; 2],
    },
}

impl Coordinates {
    /// A grid with the EPSG code of its name: UTM on WGS 84 has one.
    pub fn grid(crs: &str, proj: Option<String>, offset: [f64; 2]) -> Self {
        Self::Grid { crs: crs.to_owned(), epsg: utm(crs), proj, offset }
    }
}

/// The EPSG code of `WGS84 UTM 17N` and the like.
fn utm(crs: &str) -> Option<u32> {
    let words: Vec<&str> = crs.split_whitespace().collect();
    let ["WGS84", "UTM", zone] = words.as_slice() else { return None };
    let south = zone.ends_with('S');
    let zone: u32 = zone.strip_suffix(['N', 'S'])?.parse().ok()?;
    (1..=60).contains(&zone).then_some(if south { 32_700 } else { 32_600 } + zone)
}

impl fmt::Display for Geodetic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let side = |degrees: f64, sides: [char; 2]| sides[usize::from(degrees < 0.0)];
        let (north, east) = (side(self.latitude, ['N', 'S']), side(self.longitude, ['E', 'W']));
        write!(f, "{} {north}, {} {east}, {} m", self.latitude.abs(), self.longitude.abs(), self.altitude)
    }
}

impl fmt::Display for Coordinates {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::EastNorthUp { origin } => write!(f, "metres east, north and up of {origin}"),
            Self::Grid { crs, epsg, offset: [east, north], .. } => {
                let code = epsg.map(|code| format!(" (EPSG:{code})")).unwrap_or_default();
                write!(f, "{crs}{code} less {east} m east and {north} m north")
            }
        }
    }
}
