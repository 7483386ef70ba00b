//! What a world is made from.

use serde::{Deserialize, Serialize};

use super::WorldError;

/// Everything that decides a world. Equal parameters give equal files.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WorldParams {
    /// Number of photographs.
    pub images: u32,
    /// Longer side of a photograph in pixels; the shorter one is three quarters of it.
    pub max_side: u32,
    /// Side of the square site in metres.
    pub extent: f64,
    /// Seed of everything random.
    pub seed: u64,
    /// Samples along each side of a pixel: odd, so that one ray goes through the centre.
    pub supersample: u32,
    /// Height of the nadir flight above the ground, as a share of the extent.
    pub altitude: f64,
    /// Share of the photographs that look straight down; the others look in from around the site.
    pub nadir_share: f64,
    /// Focal length as a share of the longer side.
    pub focal: f64,
    /// Offset of the principal point from the image centre, as shares of the longer side.
    pub principal_offset: [f64; 2],
    /// Direction towards the sun: azimuth (clockwise from north, +y) and elevation in degrees.
    pub sun: [f64; 2],
    /// A photograph has at most one sparse point per this many pixels.
    pub pixels_per_point: u32,
    /// Photographs that must see a sparse point.
    pub min_views: u32,
    /// Effects that make photographs harder, each with its own switch.
    pub effects: Effects,
}

/// Effects on photographs and sparse points. A value of zero or `false` turns one off.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Effects {
    /// Quality of the JPEG files, 1 to 100.
    pub jpeg_quality: u8,
    /// Standard deviation of sparse observations in pixels; the points are triangulated from them.
    pub observation_noise: f64,
    /// Largest relative change of a photograph's exposure.
    pub exposure: f64,
    /// Standard deviation of the sensor's noise in 8-bit steps.
    pub sensor_noise: f64,
    /// Shadows of the sun.
    pub shadows: bool,
    /// Windows that reflect the sky, so that their colour depends on the view.
    pub reflections: bool,
    /// Trees, bushes and hedges.
    pub vegetation: bool,
    /// Cars.
    pub vehicles: bool,
    /// Thin lamp posts.
    pub masts: bool,
}

impl Default for WorldParams {
    fn default() -> Self {
        Self {
            images: 40,
            max_side: 320,
            extent: 80.0,
            seed: 0,
            supersample: 3,
            altitude: 0.6,
            nadir_share: 0.5,
            focal: 0.9,
            principal_offset: [0.011, -0.007],
            sun: [215.0, 48.0],
            pixels_per_point: 40,
            min_views: 3,
            effects: Effects::default(),
        }
    }
}

impl Default for Effects {
    fn default() -> Self {
        Self {
            jpeg_quality: 92,
            observation_noise: 0.3,
            exposure: 0.0,
            sensor_noise: 0.0,
            shadows: true,
            reflections: true,
            vegetation: true,
            vehicles: true,
            masts: true,
        }
    }
}

impl WorldParams {
    /// Width and height of a photograph in pixels.
    pub fn size(&self) -> (u32, u32) {
        (self.max_side, (self.max_side * 3 / 4).max(1))
    }

    /// Checks every value.
    pub fn validate(&self) -> Result<(), WorldError> {
        let within = |name: &'static str, value: f64, low: f64, high: f64| {
            if (low..=high).contains(&value) { Ok(()) } else { Err(WorldError::Parameter { name, value, low, high }) }
        };
        within("images", f64::from(self.images), 1.0, 10_000.0)?;
        within("max_side", f64::from(self.max_side), 16.0, 8192.0)?;
        within("extent", self.extent, 30.0, 2000.0)?;
        within("supersample", f64::from(self.supersample), 1.0, 15.0)?;
        if self.supersample.is_multiple_of(2) {
            return Err(WorldError::EvenSupersample { value: self.supersample });
        }
        within("altitude", self.altitude, 0.2, 3.0)?;
        within("nadir_share", self.nadir_share, 0.0, 1.0)?;
        within("focal", self.focal, 0.5, 4.0)?;
        within("principal_offset[0]", self.principal_offset[0], -0.2, 0.2)?;
        within("principal_offset[1]", self.principal_offset[1], -0.2, 0.2)?;
        within("sun[0]", self.sun[0], -360.0, 360.0)?;
        within("sun[1]", self.sun[1], 5.0, 90.0)?;
        within("pixels_per_point", f64::from(self.pixels_per_point), 1.0, 1e6)?;
        within("min_views", f64::from(self.min_views), 2.0, 100.0)?;
        within("effects.jpeg_quality", f64::from(self.effects.jpeg_quality), 1.0, 100.0)?;
        within("effects.observation_noise", self.effects.observation_noise, 0.0, 10.0)?;
        within("effects.exposure", self.effects.exposure, 0.0, 0.9)?;
        within("effects.sensor_noise", self.effects.sensor_noise, 0.0, 100.0)
    }
}
