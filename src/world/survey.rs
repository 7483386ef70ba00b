//! Where a world lies on Earth, and what a flight measures of that: positions in the photographs, and ground control
//! points.

use std::fmt::Write as _;
use std::io::Cursor;

use exif::experimental::Writer;
use exif::{Field, In, Rational, Tag, Value};
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::params::within;
use super::{Ray, Surface, World, WorldError};
use crate::format::FrameFile;
use crate::geodesy::{Error, Georeference, Tangent};
use crate::scene::random::Random;
use crate::scene::{Coordinates, Frame, Geodetic};

/// Least photographs that must see a control point.
const LEAST_MARKS: usize = 3;
/// Most marks of a control point.
const MOST_MARKS: usize = 12;
/// Standard deviation of marks in pixels.
const MARK_NOISE: f64 = 0.3;
/// Tolerance of the visibility check as a share of the depth.
const VISIBLE: f64 = 1e-4;
/// Places that are tried for each control point.
const TRIES: usize = 60;

/// Where the world lies, and how well that is measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SurveyParams {
    /// Degrees north of the world's origin.
    pub latitude: f64,
    /// Degrees east of the world's origin.
    pub longitude: f64,
    /// Height of the world's origin above the ellipsoid in metres.
    pub altitude: f64,
    /// Standard deviation in metres, towards east and towards north, of the positions in the photographs.
    pub gps_horizontal: f64,
    /// Standard deviation of their altitudes in metres.
    pub gps_vertical: f64,
    /// Ground control points.
    pub control_points: u32,
    /// Standard deviation of each of their coordinates in metres.
    pub control_noise: f64,
}

impl Default for SurveyParams {
    fn default() -> Self {
        // Foothills of the Alps, 1.3 degrees east of the middle of the UTM zone 32.
        Self {
            latitude: 47.65,
            longitude: 10.3,
            altitude: 740.0,
            gps_horizontal: 1.5,
            gps_vertical: 3.0,
            control_points: 8,
            control_noise: 0.01,
        }
    }
}

impl SurveyParams {
    pub(super) fn validate(&self) -> Result<(), WorldError> {
        within("survey.latitude", self.latitude, -79.0, 83.0)?;
        within("survey.longitude", self.longitude, -180.0, 180.0)?;
        within("survey.altitude", self.altitude, -500.0, 9000.0)?;
        within("survey.gps_horizontal", self.gps_horizontal, 0.0, 1000.0)?;
        within("survey.gps_vertical", self.gps_vertical, 0.0, 1000.0)?;
        within("survey.control_points", f64::from(self.control_points), 0.0, 1000.0)?;
        within("survey.control_noise", self.control_noise, 0.0, 100.0)
    }

    /// The place of the world's origin.
    fn origin(&self) -> Geodetic {
        Geodetic { latitude: self.latitude, longitude: self.longitude, altitude: self.altitude }
    }
}

/// A ground control point: its measured place in world coordinates, and its marks: the photograph and the pixel.
pub(super) struct ControlPoint {
    at: DVec3,
    marks: Vec<(usize, DVec2)>,
}

impl World {
    /// What the world's coordinates mean: metres east, north and up of a place.
    pub fn coordinates(&self) -> Coordinates {
        Coordinates::EastNorthUp { origin: self.params().survey.origin() }
    }

    /// The true way from the world to a map.
    pub fn georeference(&self) -> Result<Georeference, Error> {
        Georeference::of_coordinates(&self.coordinates(), None)
    }

    /// `frame.json` of the true world.
    pub(super) fn frame_file(&self) -> Result<FrameFile, Error> {
        let map = self.georeference()?.record([0.0; 3]);
        Ok(FrameFile::new(Frame::IDENTITY, Some(self.coordinates())).with_map(map))
    }

    /// The position of a photograph as its camera notes it, as EXIF.
    pub(super) fn geotag(&self, number: u32, center: [f64; 3]) -> Result<Vec<u8>, exif::Error> {
        let survey = &self.params().survey;
        let mut random = Random::stream(self.params().seed ^ (u64::from(number) << 20), 17);
        let deviation = [survey.gps_horizontal, survey.gps_horizontal, survey.gps_vertical];
        let at: [f64; 3] = std::array::from_fn(|k| center[k] + deviation[k] * random.normal());
        tag(Tangent::at(survey.origin()).to_geodetic(at), survey.gps_horizontal)
    }

    /// Ground control points on open ground, spread over the site, with their marks in photographs.
    pub(super) fn control_points(&self) -> Vec<ControlPoint> {
        let (survey, extent) = (&self.params().survey, self.params().extent);
        let side = f64::from(survey.control_points).sqrt().ceil().max(1.0);
        let mut found = Vec::new();
        for number in 0..survey.control_points {
            let mut random = Random::stream(self.params().seed ^ (u64::from(number) << 20), 18);
            let cell = DVec2::new((f64::from(number) / side).floor(), f64::from(number) % side);
            for _ in 0..TRIES {
                let inside = DVec2::new(random.unit(), random.unit());
                let at = ((cell + inside) / side - 0.5) * 0.8 * extent;
                let Some(point) = self.open_ground(at) else { continue };
                let mut marks = self.marks(point, &mut random);
                if marks.len() < LEAST_MARKS {
                    continue;
                }
                marks.truncate(MOST_MARKS);
                let noise = DVec3::new(random.normal(), random.normal(), random.normal()) * survey.control_noise;
                found.push(ControlPoint { at: point + noise, marks });
                break;
            }
        }
        found
    }

    /// The ground at a place, where nothing stands on it.
    fn open_ground(&self, at: DVec2) -> Option<DVec3> {
        let from = at.extend(self.terrain.height(at.x, at.y) + 10.0 * self.params().extent);
        let ray = Ray { origin: from, direction: DVec3::NEG_Z };
        let hit = self.trace(&ray).filter(|hit| hit.surface == Surface::Terrain)?;
        Some(ray.at(hit.t))
    }

    /// Where photographs see a point, with the noise of a person's marks.
    fn marks(&self, point: DVec3, random: &mut Random) -> Vec<(usize, DVec2)> {
        let mut seen = Vec::new();
        for (k, view) in self.views().iter().enumerate() {
            let Some((pixel, depth)) = self.seen_at(&view.camera, point) else { continue };
            let origin = DVec3::from_array(view.camera.center());
            // The parameter of a ray through a pixel is the depth.
            let ray = Ray { origin, direction: (point - origin) / depth };
            let is_free = self.trace(&ray).is_some_and(|hit| (hit.t - depth).abs() < VISIBLE * depth);
            if is_free {
                seen.push((k, pixel + DVec2::new(random.normal(), random.normal()) * MARK_NOISE));
            }
        }
        seen
    }

    /// `gcp_list.txt` in OpenDroneMap's format.
    pub(super) fn control_file(&self, points: &[ControlPoint]) -> Result<String, Error> {
        let found = self.georeference()?;
        let code = found.system().and_then(|system| system.code()).unwrap_or_default();
        let mut text = format!("EPSG:{code}\n");
        for (number, point) in (1..).zip(points) {
            let [x, y, z] = found.to_map(point.at.to_array());
            for (view, pixel) in &point.marks {
                // The format counts from the middle of the first pixel.
                let [u, v] = (*pixel - 0.5).to_array();
                let name = &self.views()[*view].name;
                let _ = writeln!(text, "{x:.4} {y:.4} {z:.4} {u:.2} {v:.2} {name} gcp{number:02}");
            }
        }
        Ok(text)
    }
}

/// A position in the words of EXIF. Seconds have five digits, which is less than a millimetre.
fn tag(at: Geodetic, deviation: f64) -> Result<Vec<u8>, exif::Error> {
    let rational = |value: f64, denom: u32| Rational { num: (value * f64::from(denom)).round() as u32, denom };
    let degrees = |value: f64| {
        let value = value.abs();
        let minutes = (value.fract() * 60.0).floor();
        let seconds = (value.fract() * 60.0 - minutes) * 60.0;
        Value::Rational(vec![rational(value.floor(), 1), rational(minutes, 1), rational(seconds, 100_000)])
    };
    let side = |negative, sides: [&str; 2]| Value::Ascii(vec![sides[usize::from(negative)].as_bytes().to_vec()]);
    let field = |tag, value| Field { tag, ifd_num: In::PRIMARY, value };
    let fields = [
        field(Tag::GPSVersionID, Value::Byte(vec![2, 3, 0, 0])),
        field(Tag::GPSLatitudeRef, side(at.latitude < 0.0, ["N", "S"])),
        field(Tag::GPSLatitude, degrees(at.latitude)),
        field(Tag::GPSLongitudeRef, side(at.longitude < 0.0, ["E", "W"])),
        field(Tag::GPSLongitude, degrees(at.longitude)),
        field(Tag::GPSAltitudeRef, Value::Byte(vec![u8::from(at.altitude < 0.0)])),
        field(Tag::GPSAltitude, Value::Rational(vec![rational(at.altitude.abs(), 1000)])),
        field(Tag::GPSHPositioningError, Value::Rational(vec![rational(deviation, 1000)])),
    ];
    let mut writer = Writer::new();
    fields.iter().for_each(|field| writer.push_field(field));
    let mut bytes = Cursor::new(Vec::new());
    writer.write(&mut bytes, true)?;
    Ok(bytes.into_inner())
}
