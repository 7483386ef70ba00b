//! Sparse points as structure from motion finds them: on textured spots that several photographs see, triangulated from
//! noisy observations.

use glam::{DMat3, DVec2, DVec3};
use image::RgbImage;
use rayon::prelude::*;

use super::photograph::pixel_ray;
use super::random::Random;
use super::{Ray, View, World};
use crate::scene::Camera;

/// A point seen from this far apart (cosine of the angle between two rays) no longer matches.
const MATCH_COSINE: f64 = 0.6;
/// Smallest sum of absolute differences to the neighbours, 8-bit steps, of a spot that can be matched.
const TEXTURE: i32 = 14;
/// Tolerance of the visibility check as a share of the depth.
const VISIBLE: f64 = 1e-4;

/// A sparse point.
#[derive(Clone, Debug, PartialEq)]
pub struct TiePoint {
    /// Triangulated position, metres.
    pub position: [f64; 3],
    /// Colour in the photograph that it was found in.
    pub colour: [u8; 3],
    /// Photographs (by index) with the observed position in pixels.
    pub track: Vec<(u32, [f64; 2])>,
    /// Mean distance of the observations from the projected position, pixels.
    pub error: f64,
}

/// A textured spot of a photograph.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spot {
    pixel: DVec2,
    colour: [u8; 3],
}

fn grid(params: &super::WorldParams) -> (f64, usize, usize) {
    let cell = f64::from(params.pixels_per_point).sqrt();
    let (width, height) = params.size();
    let count = |side: u32| (f64::from(side) / cell).ceil().max(1.0) as usize;
    (cell, count(width), count(height))
}

impl World {
    /// The most textured pixel of each grid cell of a photograph, where it is textured at all.
    pub(super) fn spots(&self, photograph: &RgbImage) -> Vec<Option<Spot>> {
        let (cell, columns, rows) = grid(self.params());
        let (width, height) = photograph.dimensions();
        let luma = |x: u32, y: u32| {
            let p = photograph.get_pixel(x, y).0;
            2 * i32::from(p[0]) + 5 * i32::from(p[1]) + i32::from(p[2])
        };
        let mut best = vec![(TEXTURE * 8 - 1, None); columns * rows];
        for y in 1..height.saturating_sub(1) {
            for x in 1..width.saturating_sub(1) {
                let c = luma(x, y);
                let score = (c - luma(x - 1, y)).abs()
                    + (c - luma(x + 1, y)).abs()
                    + (c - luma(x, y - 1)).abs()
                    + (c - luma(x, y + 1)).abs();
                let at = (f64::from(y) / cell) as usize * columns + (f64::from(x) / cell) as usize;
                if let Some(b) = best.get_mut(at)
                    && score > b.0
                {
                    let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                    *b = (score, Some(Spot { pixel, colour: photograph.get_pixel(x, y).0 }));
                }
            }
        }
        best.into_iter().map(|(_, s)| s).collect()
    }

    /// Sparse points from the spots of all photographs (in the order of `views`).
    pub(super) fn tie_points(&self, views: &[View], spots: &[Vec<Option<Spot>>]) -> Vec<TiePoint> {
        let (cell, columns, rows) = grid(self.params());
        let mut taken = vec![vec![false; columns * rows]; views.len()];
        let index = |p: DVec2| {
            let (i, j) = ((p.x / cell) as usize, (p.y / cell) as usize);
            (i < columns && j < rows).then_some(j * columns + i)
        };
        let min = self.params().min_views as usize;
        let noise = self.params().effects.observation_noise;
        let mut points = Vec::new();
        for (number, (view, spots)) in views.iter().zip(spots).enumerate() {
            let open: Vec<(usize, Spot)> = spots
                .iter()
                .enumerate()
                .filter(|(k, _)| !taken[number][*k])
                .filter_map(|(k, s)| s.map(|s| (k, s)))
                .collect();
            let seen: Vec<_> = open.par_iter().map(|(_, spot)| self.sightings(views, number, view, spot)).collect();
            for ((k, spot), (surface, sightings)) in open.into_iter().zip(seen) {
                let free = |&(v, p): &(usize, DVec2)| index(p).is_some_and(|k| !taken[v][k]);
                let kept: Vec<(usize, DVec2)> = sightings.into_iter().filter(free).collect();
                if taken[number][k] || kept.len() < min {
                    continue;
                }
                let mut random = Random::new(self.params().seed ^ ((number as u64) << 32) ^ k as u64, 13);
                let observed: Vec<(usize, DVec2)> =
                    kept.iter().map(|&(v, p)| (v, p + DVec2::new(random.normal(), random.normal()) * noise)).collect();
                let (position, error) = triangulate(views, &observed, surface);
                for (v, p) in kept {
                    if let Some(k) = index(p) {
                        taken[v][k] = true;
                    }
                }
                points.push(TiePoint {
                    position: position.to_array(),
                    colour: spot.colour,
                    track: observed.into_iter().map(|(v, p)| (v as u32, p.to_array())).collect(),
                    error,
                });
            }
        }
        points
    }

    /// The surface point under a spot, and the photographs that see it with its exact position in each.
    fn sightings(&self, views: &[View], number: usize, view: &View, spot: &Spot) -> (DVec3, Vec<(usize, DVec2)>) {
        let ray = pixel_ray(&view.camera, spot.pixel.x, spot.pixel.y);
        let Some(hit) = self.trace(&ray) else {
            return (DVec3::ZERO, Vec::new());
        };
        let point = ray.at(hit.t);
        let from_source = ray.direction.normalize();
        let seen = views.iter().enumerate().filter_map(|(k, other)| {
            if k == number {
                return Some((k, spot.pixel));
            }
            let (pixel, depth) = project(&other.camera, point)?;
            let (width, height) = (f64::from(other.camera.width), f64::from(other.camera.height));
            let inside = pixel.x > 1.0 && pixel.y > 1.0 && pixel.x < width - 1.0 && pixel.y < height - 1.0;
            let origin = DVec3::from_array(other.camera.center());
            let direction = (point - origin) / depth;
            if !inside || direction.normalize().dot(from_source) < MATCH_COSINE {
                return None;
            }
            let met = self.trace(&Ray { origin, direction })?;
            ((met.t - depth).abs() < VISIBLE * depth).then_some((k, pixel))
        });
        (point, seen.collect())
    }
}

/// Pixel position and depth of a world point in front of the camera.
pub(crate) fn project(camera: &Camera, p: DVec3) -> Option<(DVec2, f64)> {
    let (r, t) = (&camera.rotation, &camera.translation);
    let q = DVec3::from_array(std::array::from_fn(|k| DVec3::from_array(r[k]).dot(p) + t[k]));
    let pixel = DVec2::new(camera.fx * q.x / q.z + camera.cx, camera.fy * q.y / q.z + camera.cy);
    (q.z > 1e-6).then_some((pixel, q.z))
}

/// Least squares of the reprojection error by Gauss and Newton's steps from a close start: the point and the mean error.
fn triangulate(views: &[View], observed: &[(usize, DVec2)], start: DVec3) -> (DVec3, f64) {
    let mut x = start;
    for _ in 0..3 {
        let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for &(v, seen) in observed {
            let camera = &views[v].camera;
            let Some((pixel, depth)) = project(camera, x) else { continue };
            let r = camera.rotation.map(DVec3::from_array);
            let u = (pixel - DVec2::new(camera.cx, camera.cy)) / DVec2::new(camera.fx, camera.fy);
            let rows = [
                ((r[0] - r[2] * u.x) * (camera.fx / depth), seen.x - pixel.x),
                ((r[1] - r[2] * u.y) * (camera.fy / depth), seen.y - pixel.y),
            ];
            for (j, e) in rows {
                normal += DMat3::from_cols(j * j.x, j * j.y, j * j.z);
                right += j * e;
            }
        }
        let step = normal.inverse() * right;
        if step.is_finite() {
            x += step;
        }
    }
    let total: f64 = observed
        .iter()
        .filter_map(|&(v, seen)| project(&views[v].camera, x).map(|(pixel, _)| pixel.distance(seen)))
        .sum();
    (x, total / observed.len().max(1) as f64)
}
