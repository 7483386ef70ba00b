//! Where on Earth a dataset's coordinates are.

use std::fmt;

use serde::{Deserialize, Serialize};

/// A place on the WGS 84 ellipsoid.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Geodetic {
    /// Degrees north.
    pub latitude: f64,
    /// Degrees east.
    pub longitude: f64,
    /// Altitude in metres.
    pub altitude: f64,
}

/// What a dataset's x, y and z mean, in metres, where its files say so.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Coordinates {
    /// East, north and up in the plane that touches the ellipsoid at `origin`.
    EastNorthUp {
        /// The place where x, y and z are zero.
        origin: Geodetic,
    },
    /// Easting, northing and height in a map grid, minus an offset. North is grid north, not true north, and lengths
    /// are grid lengths.
    Grid {
        /// The reference system as the dataset names it, such as `WGS84 UTM 17N`.
        crs: String,
        /// Its EPSG code, where the name is known.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        epsg: Option<u32>,
        /// Its PROJ string, where the dataset has one.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        proj: Option<String>,
        /// Offset to add to x and y to obtain easting and northing; heights have no offset.
        offset: [f64; 2],
    },
}

impl Coordinates {
    /// A grid, with its EPSG code where `crs` names a UTM zone on WGS 84.
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
