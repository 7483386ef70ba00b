//! The parameters of a world.

use serde::{Deserialize, Serialize};

use super::{Effects, SurveyParams, WorldError};

/// All parameters of a world. Equal parameters give equal files.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WorldParams {
    /// Number of photographs.
    pub images: u32,
    /// Longer side of a photograph in pixels. The shorter side is three quarters as long (approximately, with
    /// distortion).
    pub max_side: u32,
    /// Side of the square site in metres.
    pub extent: f64,
    /// Seed of everything random.
    pub seed: u64,
    /// Number of off-path views.
    pub offpath: u32,
    /// Samples along each side of a pixel: odd, so that one ray goes through the centre.
    pub supersample: u32,
    /// Height of the nadir flight above the ground, as a share of the extent.
    pub altitude: f64,
    /// Share of the photographs that look straight down; the others look in from around the site.
    pub nadir_share: f64,
    /// The lens.
    pub camera: CameraKind,
    /// Focal length of the undistorted image as a share of the longer side.
    pub focal: f64,
    /// Offset of the undistorted image's principal point from its centre, as shares of the longer side.
    pub principal_offset: [f64; 2],
    /// k1, k2, p1, p2 of the lens when `camera` is [`CameraKind::Opencv`].
    pub distortion: [f64; 4],
    /// Direction towards the sun: azimuth (clockwise from north, +y) and elevation in degrees.
    pub sun: [f64; 2],
    /// A photograph has at most one sparse point per this many pixels.
    pub pixels_per_point: u32,
    /// Smallest number of photographs that must see a sparse point.
    pub min_views: u32,
    /// The flight of a laser scanner.
    pub lidar: LidarParams,
    /// The place on Earth, and what is measured of it.
    pub survey: SurveyParams,
    /// Effects that make the world hard to reconstruct.
    pub effects: Effects,
}

/// The lens of the photographs. The undistorted images of both kinds are equal, pixel for pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum CameraKind {
    /// COLMAP's PINHOLE: no distortion.
    #[default]
    Pinhole,
    /// COLMAP's OPENCV: radial and tangential distortion.
    Opencv,
}

/// A laser scanner that flies two parallel strips over the site.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LidarParams {
    /// Pulses per square metre of flat ground, both strips together. Roofs have about as many points; walls have points
    /// only where slanted pulses hit them.
    pub density: f64,
    /// Standard deviation of the measured range in metres.
    pub range_noise: f64,
    /// Height above the ground, as a share of the extent.
    pub altitude: f64,
    /// Distance of the two strips, as a share of the extent.
    pub strip_distance: f64,
    /// Side of the covered square, as a share of the extent.
    pub coverage: f64,
    /// Share of the pulses on water that come back.
    pub water_returns: f64,
}

impl Default for LidarParams {
    fn default() -> Self {
        Self { density: 8.0, range_noise: 0.03, altitude: 2.0, strip_distance: 0.5, coverage: 1.4, water_returns: 0.03 }
    }
}

impl Default for WorldParams {
    fn default() -> Self {
        Self {
            images: 40,
            max_side: 320,
            extent: 80.0,
            seed: 0,
            offpath: 8,
            supersample: 3,
            altitude: 0.6,
            nadir_share: 0.5,
            camera: CameraKind::Pinhole,
            focal: 0.9,
            principal_offset: [0.011, -0.007],
            distortion: [-0.12, 0.035, 0.0012, -0.0008],
            sun: [215.0, 48.0],
            pixels_per_point: 200,
            min_views: 3,
            lidar: LidarParams::default(),
            survey: SurveyParams::default(),
            effects: Effects::default(),
        }
    }
}

impl WorldParams {
    /// Width and height of an undistorted image in pixels.
    pub fn size(&self) -> (u32, u32) {
        (self.max_side, (self.max_side * 3 / 4).max(1))
    }

    /// Fails where a value is out of its range.
    pub fn validate(&self) -> Result<(), WorldError> {
        within("images", f64::from(self.images), 1.0, 10_000.0)?;
        within("max_side", f64::from(self.max_side), 16.0, 8192.0)?;
        within("extent", self.extent, 30.0, 2000.0)?;
        within("offpath", f64::from(self.offpath), 0.0, 10_000.0)?;
        within("supersample", f64::from(self.supersample), 1.0, 15.0)?;
        if self.supersample.is_multiple_of(2) {
            return Err(WorldError::EvenSupersample { value: self.supersample });
        }
        within("altitude", self.altitude, 0.2, 3.0)?;
        within("nadir_share", self.nadir_share, 0.0, 1.0)?;
        within("focal", self.focal, 0.5, 4.0)?;
        within("principal_offset[0]", self.principal_offset[0], -0.2, 0.2)?;
        within("principal_offset[1]", self.principal_offset[1], -0.2, 0.2)?;
        // Barrel distortion only, which fills the undistorted image to its edges.
        let [k1, k2, p1, p2] = self.distortion;
        within("distortion[0]", k1, -0.3, 0.0)?;
        within("distortion[1]", k2, 0.0, 0.1)?;
        within("distortion[2]", p1, -0.01, 0.01)?;
        within("distortion[3]", p2, -0.01, 0.01)?;
        within("sun[0]", self.sun[0], -360.0, 360.0)?;
        within("sun[1]", self.sun[1], 5.0, 90.0)?;
        within("pixels_per_point", f64::from(self.pixels_per_point), 1.0, 1e6)?;
        within("min_views", f64::from(self.min_views), 2.0, 100.0)?;
        within("lidar.density", self.lidar.density, 0.01, 1000.0)?;
        within("lidar.range_noise", self.lidar.range_noise, 0.0, 10.0)?;
        within("lidar.altitude", self.lidar.altitude, 1.0, 100.0)?;
        within("lidar.strip_distance", self.lidar.strip_distance, 0.0, 2.0)?;
        within("lidar.coverage", self.lidar.coverage, 0.1, 4.0)?;
        within("lidar.water_returns", self.lidar.water_returns, 0.0, 1.0)?;
        self.survey.validate()?;
        self.effects.validate()
    }
}

pub(super) fn within(name: &'static str, value: f64, low: f64, high: f64) -> Result<(), WorldError> {
    if (low..=high).contains(&value) { Ok(()) } else { Err(WorldError::Parameter { name, value, low, high }) }
}
