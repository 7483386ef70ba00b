//! A laser scanner over the world.

use std::io::{self, Cursor, Write};

use glam::{DVec3, Vec3};
use las::point::{Classification, Format};
use las::{Builder, Color, Point, Transform, Vector, Writer};
use rayon::prelude::*;

use super::light::develop;
use super::{Ray, Surface, World};
use crate::scene::random::Random;

/// The kind of object that a surface belongs to; the numbers are the LAS format's classes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Class {
    /// Cars, posts, poles, boards.
    Other = 1,
    /// The ground.
    Ground = 2,
    /// Trees, bushes, hedges.
    Vegetation = 5,
    /// Buildings.
    Building = 6,
    /// Water.
    Water = 9,
    /// Wires.
    Wire = 14,
}

impl Class {
    /// The number of the class in LAS files.
    pub fn code(self) -> u8 {
        self as u8
    }
}

/// An echo of a laser pulse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LidarPoint {
    /// World position, with the noise of the range.
    pub position: [f64; 3],
    /// Colour in daylight.
    pub colour: [u8; 3],
    /// Share of the pulse's light that comes back, scaled to 65535.
    pub intensity: u16,
    /// The kind of object that was hit.
    pub class: Class,
    /// Angle of the pulse from the vertical, degrees, positive towards larger y.
    pub angle: f32,
    /// Strip, from 0.
    pub strip: u8,
    /// Seconds since the start.
    pub time: f64,
}

/// Speed of the aircraft in metres per second, which affects only the points' times.
const SPEED: f64 = 30.0;

impl World {
    /// The kind of object that a surface belongs to.
    pub fn class(&self, surface: Surface, point: DVec3) -> Class {
        match surface {
            Surface::Terrain if self.ground.is_water(point.truncate()) => Class::Water,
            Surface::Terrain => Class::Ground,
            Surface::Solid { index, .. } => self.solids[index as usize].class,
        }
    }

    /// First echoes of a scanner that flies along x, once on either side of the middle, and sweeps across. A pulse aims
    /// at each point of a jittered grid on the ground, and the first surface in its way reflects it. Roofs are
    /// therefore as dense as the ground, walls have points only where pulses come in at a slant, and regions behind
    /// walls have none.
    pub fn lidar(&self) -> Vec<LidarPoint> {
        let (params, lidar) = (&self.params, &self.params.lidar);
        let half = 0.5 * lidar.coverage * params.extent;
        let spacing = (2.0 / lidar.density).sqrt();
        let side = (2.0 * half / spacing).round().max(1.0) as u32;
        let height = self.terrain.height(0.0, 0.0) + lidar.altitude * params.extent;
        let row = |strip: u8, i: u32| {
            let mut random = Random::stream(params.seed ^ (u64::from(strip) << 40) ^ (u64::from(i) << 8), 16);
            let line = lidar.strip_distance * params.extent * (f64::from(strip) - 0.5);
            let mut points = Vec::new();
            for j in 0..side {
                let at =
                    |k: u32, jitter: f64| ((f64::from(k) + 0.5 + 0.15 * jitter) / f64::from(side) - 0.5) * 2.0 * half;
                let (x, y) = (at(i, random.normal()), at(j, random.normal()));
                let (noise, luck) = (lidar.range_noise * random.normal(), random.unit());
                let origin = DVec3::new(x, line, height);
                let direction = (DVec3::new(x, y, self.terrain.height(x, y)) - origin).normalize();
                let ray = Ray { origin, direction };
                let Some(hit) = self.trace(&ray) else { continue };
                let point = ray.at(hit.t);
                let class = self.class(hit.surface, point);
                if class == Class::Water && luck >= lidar.water_returns {
                    continue;
                }
                let colour = develop(self.shade(&ray, &hit)).to_array().map(|c| c.round().clamp(0.0, 255.0) as u8);
                let bright = self.appearance(point, &hit).albedo.dot(Vec3::splat(1.0 / 3.0));
                let returned = f64::from(bright) * -direction.dot(hit.normal);
                points.push(LidarPoint {
                    position: ray.at(hit.t + noise).to_array(),
                    colour,
                    intensity: (returned.clamp(0.0, 1.0) * 65535.0) as u16,
                    class,
                    angle: (y - line).atan2(height - point.z).to_degrees() as f32,
                    strip,
                    time: f64::from(strip) * 60.0 + (x + half) / SPEED,
                });
            }
            points
        };
        let rows: Vec<(u8, u32)> = (0..2).flat_map(|strip| (0..side).map(move |i| (strip, i))).collect();
        rows.into_par_iter().flat_map_iter(|(strip, i)| row(strip, i)).collect()
    }
}

/// The points as a LAS 1.4 file (point format 7: time and colour), to the millimetre.
pub(super) fn las(points: &[LidarPoint]) -> Result<Vec<u8>, las::Error> {
    let mut builder = Builder::from((1, 4));
    builder.point_format = Format::new(7)?;
    builder.system_identifier = "simulated scanner".to_owned();
    builder.generating_software = "psrgs-vk".to_owned();
    // With the date, equal parameters would give different files.
    builder.date = None;
    let millimetres = Transform { scale: 0.001, offset: 0.0 };
    builder.transforms = Vector { x: millimetres, y: millimetres, z: millimetres };
    let mut writer = Writer::new(Cursor::new(Vec::new()), builder.into_header()?)?;
    for p in points {
        let [x, y, z] = p.position;
        // Colours have 16 bits in the format.
        let [red, green, blue] = p.colour.map(|c| u16::from(c) * 257);
        writer.write_point(Point {
            x,
            y,
            z,
            intensity: p.intensity,
            classification: Classification::new(p.class as u8)?,
            scan_angle: p.angle,
            point_source_id: u16::from(p.strip) + 1,
            gps_time: Some(p.time),
            color: Some(Color::new(red, green, blue)),
            return_number: 1,
            number_of_returns: 1,
            ..Point::default()
        })?;
    }
    Ok(writer.into_inner()?.into_inner())
}

/// The points as a binary PLY file.
pub(super) fn write_ply(points: &[LidarPoint], out: &mut dyn Write) -> io::Result<()> {
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\ncomment psrgs-vk simulated laser scan, metres\nelement vertex {}\n\
         property double x\nproperty double y\nproperty double z\nproperty uchar red\nproperty uchar green\n\
         property uchar blue\nproperty ushort intensity\nproperty uchar classification\nend_header\n",
        points.len()
    )?;
    for p in points {
        p.position.iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))?;
        out.write_all(&p.colour)?;
        out.write_all(&p.intensity.to_le_bytes())?;
        out.write_all(&[p.class as u8])?;
    }
    Ok(())
}
