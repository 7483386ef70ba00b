//! The WGS 84 ellipsoid, and planes that touch it.

use crate::scene::{Geodetic, Similarity};

/// Semi-major axis in metres.
const A: f64 = 6_378_137.0;
/// Flattening.
const F: f64 = 1.0 / 298.257_223_563;
/// Square of the eccentricity.
const E2: f64 = F * (2.0 - F);

/// Metres in axes that turn with the Earth: from its centre towards latitude and longitude 0, towards 90 degrees east,
/// and north.
pub(super) fn to_earth(place: Geodetic) -> [f64; 3] {
    let (sin, cos) = place.latitude.to_radians().sin_cos();
    let (east, along) = place.longitude.to_radians().sin_cos();
    let n = A / (1.0 - E2 * sin * sin).sqrt();
    let out = (n + place.altitude) * cos;
    [out * along, out * east, (n * (1.0 - E2) + place.altitude) * sin]
}

/// The inverse of [`to_earth`], by Bowring's formula for the reduced latitude and its repetition. The altitude is that
/// above the ellipsoid.
pub(super) fn to_geodetic([x, y, z]: [f64; 3]) -> Geodetic {
    let b = A * (1.0 - F);
    let out = x.hypot(y);
    let mut reduced = (z * A).atan2(out * b);
    let mut latitude = 0.0_f64;
    for _ in 0..3 {
        let (sin, cos) = reduced.sin_cos();
        let second = E2 / (1.0 - E2);
        latitude = (z + second * b * sin.powi(3)).atan2(out - E2 * A * cos.powi(3));
        reduced = ((1.0 - F) * latitude.sin()).atan2(latitude.cos());
    }
    let (sin, cos) = latitude.sin_cos();
    // Near the poles and near the equator this is the distance along the normal all the same.
    let altitude = out * cos + z * sin - A * (1.0 - E2 * sin * sin).sqrt();
    Geodetic { latitude: latitude.to_degrees(), longitude: y.atan2(x).to_degrees(), altitude }
}

/// The plane that touches the ellipsoid, lifted to a place: metres east, north and up of the place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tangent {
    origin: Geodetic,
    center: [f64; 3],
    /// Rows: east, north and up in the axes of the Earth.
    axes: [[f64; 3]; 3],
}

impl Tangent {
    /// The plane at a place.
    pub fn at(origin: Geodetic) -> Self {
        let (sin, cos) = origin.latitude.to_radians().sin_cos();
        let (s, c) = origin.longitude.to_radians().sin_cos();
        let axes = [[-s, c, 0.0], [-sin * c, -sin * s, cos], [cos * c, cos * s, sin]];
        Self { origin, center: to_earth(origin), axes }
    }

    /// The plane in the middle of places, at their mean height. `None` without places.
    pub fn amid(places: &[Geodetic]) -> Option<Self> {
        let n = places.len() as f64;
        let sum = places.iter().map(|place| to_earth(*place)).reduce(|a, b| std::array::from_fn(|k| a[k] + b[k]))?;
        let altitude = places.iter().map(|place| place.altitude).sum::<f64>() / n;
        // The mean of points on the Earth lies below its surface: only its direction counts.
        Some(Self::at(Geodetic { altitude, ..to_geodetic(sum.map(|v| v / n)) }))
    }

    /// The place of the zero.
    pub fn origin(&self) -> Geodetic {
        self.origin
    }

    /// Metres east, north and up of the origin.
    pub fn from_geodetic(&self, place: Geodetic) -> [f64; 3] {
        let at = to_earth(place);
        let off: [f64; 3] = std::array::from_fn(|k| at[k] - self.center[k]);
        self.axes.map(|axis| (0..3).map(|k| axis[k] * off[k]).sum())
    }

    /// From metres east, north and up of the origin to the axes of the Earth (ECEF).
    pub fn to_earth(&self) -> Similarity {
        let rotation = std::array::from_fn(|i| std::array::from_fn(|j| self.axes[j][i]));
        Similarity { rotation, scale: 1.0, translation: self.center }
    }

    /// The place of a point.
    pub fn to_geodetic(&self, point: [f64; 3]) -> Geodetic {
        to_geodetic(std::array::from_fn(|k| self.center[k] + (0..3).map(|i| self.axes[i][k] * point[i]).sum::<f64>()))
    }
}
