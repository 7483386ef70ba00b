//! Sparse points as structure from motion gives them: on textured spots that several photographs see, triangulated from
//! noisy observations.

use glam::{DMat3, DVec2, DVec3};
use image::RgbImage;
use rayon::prelude::*;

use super::{Ray, World, WorldView};
use crate::scene::Camera;
use crate::scene::random::Random;

/// Smallest cosine of the angle between two rays for a point to match in both photographs.
const MATCH_COSINE: f64 = 0.6;
/// Smallest sum of absolute luma differences to the four neighbours, in 8-bit steps, of a spot that can be matched.
const TEXTURE: i32 = 14;
/// Tolerance of the visibility check as a share of the depth.
const VISIBLE: f64 = 1e-4;
/// Range of the relative depth error of a wrong match.
const MISMATCH: [f64; 2] = [0.04, 0.4];

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

/// Cells of a photograph, each of which has one sparse point at most.
#[derive(Clone, Copy)]
struct Grid {
    cell: DVec2,
    columns: usize,
    rows: usize,
}

impl Grid {
    fn new(pixels_per_point: u32, size: [u32; 2]) -> Self {
        let side = f64::from(pixels_per_point).sqrt();
        let [columns, rows] = size.map(|s| (f64::from(s) / side).floor().max(1.0));
        let cell = DVec2::new(f64::from(size[0]) / columns, f64::from(size[1]) / rows);
        Self { cell, columns: columns as usize, rows: rows as usize }
    }

    fn index(&self, p: DVec2) -> Option<usize> {
        let (i, j) = ((p.x / self.cell.x) as usize, (p.y / self.cell.y) as usize);
        (i < self.columns && j < self.rows).then_some(j * self.columns + i)
    }
}

impl World {
    /// The most textured pixel of each grid cell of a photograph, where it is textured at all.
    pub(super) fn spots(&self, photograph: &RgbImage) -> Vec<Option<Spot>> {
        let (width, height) = photograph.dimensions();
        let grid = Grid::new(self.params().pixels_per_point, [width, height]);
        let luma = |x: u32, y: u32| {
            let p = photograph.get_pixel(x, y).0;
            2 * i32::from(p[0]) + 5 * i32::from(p[1]) + i32::from(p[2])
        };
        let mut best = vec![(TEXTURE * 8 - 1, None); grid.columns * grid.rows];
        for y in 1..height.saturating_sub(1) {
            for x in 1..width.saturating_sub(1) {
                let c = luma(x, y);
                let score = (c - luma(x - 1, y)).abs()
                    + (c - luma(x + 1, y)).abs()
                    + (c - luma(x, y - 1)).abs()
                    + (c - luma(x, y + 1)).abs();
                let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                if let Some(b) = grid.index(pixel).and_then(|at| best.get_mut(at))
                    && score > b.0
                {
                    *b = (score, Some(Spot { pixel, colour: photograph.get_pixel(x, y).0 }));
                }
            }
        }
        best.into_iter().map(|(_, s)| s).collect()
    }

    /// Width and height of the photographs of a view.
    fn photograph_size(&self, view: &WorldView) -> [u32; 2] {
        self.lens().map_or([view.camera.width, view.camera.height], |lens| lens.size)
    }

    /// The position of a world point in a camera's photograph, in pixels, and its depth; `None` outside the photograph.
    pub(super) fn seen_at(&self, camera: &Camera, point: DVec3) -> Option<(DVec2, f64)> {
        let (straight, depth) = project(camera, point)?;
        let (at, [width, height]) = match &self.optics {
            None => (straight, [camera.width, camera.height]),
            Some(optics) => (optics.bend(camera, straight)?, optics.lens.size),
        };
        let inside = at.cmpgt(DVec2::ONE).all() && at.x < f64::from(width) - 1.0 && at.y < f64::from(height) - 1.0;
        inside.then_some((at, depth))
    }

    /// Sparse points from the spots of all photographs (in the order of `views`).
    pub(super) fn tie_points(&self, views: &[WorldView], spots: &[Vec<Option<Spot>>]) -> Vec<TiePoint> {
        let Some(first) = views.first() else { return Vec::new() };
        let grid = Grid::new(self.params().pixels_per_point, self.photograph_size(first));
        let mut taken = vec![vec![false; grid.columns * grid.rows]; views.len()];
        let min = self.params().min_views as usize;
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
                let free = |&(v, p): &(usize, DVec2)| grid.index(p).is_some_and(|k| !taken[v][k]);
                let kept: Vec<(usize, DVec2)> = sightings.into_iter().filter(free).collect();
                if taken[number][k] || kept.len() < min {
                    continue;
                }
                let seed = self.params().seed ^ ((number as u64) << 32) ^ k as u64;
                let mismatched = self.mismatched(views, view, surface, &kept, seed).map(|(point, seen)| {
                    let seen: Vec<(usize, DVec2)> = seen.into_iter().filter(free).collect();
                    (point, seen)
                });
                let (start, matched) = mismatched.filter(|(_, seen)| seen.len() >= min).unwrap_or((surface, kept));
                let mut random = Random::stream(seed, 13);
                let noise = self.params().effects.observation_noise;
                let mut noisy =
                    |&(v, p): &(usize, DVec2)| (v, p + DVec2::new(random.normal(), random.normal()) * noise);
                let observed: Vec<(usize, DVec2)> = matched.iter().map(&mut noisy).collect();
                let Some((position, error)) = self.triangulate(views, &observed, start) else { continue };
                for (v, p) in matched {
                    if let Some(k) = grid.index(p) {
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

    /// For the share of wrong matches: another point on the first camera's ray, and the positions at which the cameras
    /// of the track would see it. Repeated patterns cause such matches: the observations agree with each other, so that
    /// no check detects them.
    fn mismatched(
        &self,
        views: &[WorldView],
        view: &WorldView,
        surface: DVec3,
        kept: &[(usize, DVec2)],
        seed: u64,
    ) -> Option<(DVec3, Vec<(usize, DVec2)>)> {
        let mut random = Random::stream(seed, 15);
        if !random.chance(self.params().effects.outliers) {
            return None;
        }
        let off = random.range(MISMATCH[0], MISMATCH[1]) * if random.chance(0.5) { 1.0 } else { -1.0 };
        let origin = DVec3::from_array(view.camera.center());
        let point = origin + (surface - origin) * (1.0 + off);
        let seen = kept.iter().filter_map(|(v, _)| Some((*v, self.seen_at(&views[*v].reconstructed, point)?.0)));
        Some((point, seen.collect()))
    }

    /// The surface point under a spot, and the photographs that see the point, with its exact position in each. No
    /// photographs for a surface without texture: only noise would match.
    fn sightings(
        &self,
        views: &[WorldView],
        number: usize,
        view: &WorldView,
        spot: &Spot,
    ) -> (DVec3, Vec<(usize, DVec2)>) {
        let nothing = (DVec3::ZERO, Vec::new());
        let Some(ray) = self.photograph_ray(view, spot.pixel.x, spot.pixel.y) else { return nothing };
        let Some(hit) = self.trace(&ray) else { return nothing };
        let point = ray.at(hit.t);
        if self.appearance(point, &hit).plain {
            return nothing;
        }
        let from_source = ray.direction.normalize();
        let seen = views.iter().enumerate().filter_map(|(k, other)| {
            if k == number {
                return Some((k, spot.pixel));
            }
            let (pixel, depth) = self.seen_at(&other.camera, point)?;
            let origin = DVec3::from_array(other.camera.center());
            let direction = (point - origin) / depth;
            if direction.normalize().dot(from_source) < MATCH_COSINE {
                return None;
            }
            let met = self.trace(&Ray { origin, direction })?;
            ((met.t - depth).abs() < VISIBLE * depth).then_some((k, pixel))
        });
        (point, seen.collect())
    }

    /// The point that minimises the squared reprojection error in the reconstructed cameras, by Gauss-Newton steps from
    /// a close start, and the mean error in pixels of the photographs.
    fn triangulate(&self, views: &[WorldView], observed: &[(usize, DVec2)], start: DVec3) -> Option<(DVec3, f64)> {
        let straight = |&(v, p): &(usize, DVec2)| match &self.optics {
            None => Some((v, p)),
            Some(optics) => optics.straighten(&views[v].camera, p).map(|p| (v, p)),
        };
        let undistorted = observed.iter().map(straight).collect::<Option<Vec<_>>>()?;
        let point = intersection(views, &undistorted, start);
        let apart = |&(v, p): &(usize, DVec2)| {
            let camera = &views[v].reconstructed;
            let (straight, _) = project(camera, point)?;
            let at = match &self.optics {
                None => straight,
                Some(optics) => optics.bend(camera, straight)?,
            };
            Some(at.distance(p))
        };
        let apart = observed.iter().map(apart).collect::<Option<Vec<f64>>>()?;
        Some((point, apart.iter().sum::<f64>() / apart.len().max(1) as f64))
    }
}

/// Pixel position and depth of a world point in front of the camera.
pub(crate) fn project(camera: &Camera, p: DVec3) -> Option<(DVec2, f64)> {
    let (r, t) = (&camera.rotation, &camera.translation);
    let q = DVec3::from_array(std::array::from_fn(|k| DVec3::from_array(r[k]).dot(p) + t[k]));
    let pixel = DVec2::new(camera.fx * q.x / q.z + camera.cx, camera.fy * q.y / q.z + camera.cy);
    (q.z > 1e-6).then_some((pixel, q.z))
}

fn intersection(views: &[WorldView], observed: &[(usize, DVec2)], start: DVec3) -> DVec3 {
    let mut x = start;
    for _ in 0..3 {
        let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for &(v, seen) in observed {
            let camera = &views[v].reconstructed;
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
    x
}

#[cfg(test)]
mod tests {
    use super::super::{Effects, LidarParams, WorldParams};
    use super::*;

    /// Without any noise, points lie where the rays of their observations end.
    #[test]
    fn no_point_is_on_what_has_no_texture() {
        let effects = Effects { observation_noise: 0.0, outliers: 0.0, pose_noise: 0.0, ..Effects::default() };
        let lidar = LidarParams { density: 0.1, ..LidarParams::default() };
        let params =
            WorldParams { images: 10, max_side: 96, pixels_per_point: 20, effects, lidar, ..Default::default() };
        let world = World::new(&params).unwrap();
        let shots: Vec<_> = (0..).zip(world.views()).map(|(k, view)| world.shot(view, k).photograph).collect();
        let spots: Vec<_> = shots.iter().map(|photograph| world.spots(photograph)).collect();
        let points = world.tie_points(world.views(), &spots);
        let is_plain = |view: &WorldView, pixel: DVec2| {
            let ray = world.photograph_ray(view, pixel.x, pixel.y).unwrap();
            let hit = world.trace(&ray).unwrap();
            (world.appearance(ray.at(hit.t), &hit).plain, ray.at(hit.t))
        };
        for point in &points {
            let (view, pixel) = point.track[0];
            let (plain, surface) = is_plain(&world.views()[view as usize], DVec2::from_array(pixel));
            assert!(!plain && surface.distance(DVec3::from_array(point.position)) < 1e-6, "{point:?}");
            assert!(point.error < 1e-6 && point.track.len() >= 3);
        }
        let found = spots.iter().flatten().flatten().count();
        let plain = spots.iter().zip(world.views()).flat_map(|(s, view)| s.iter().flatten().map(move |s| (view, s)));
        let plain = plain.filter(|(view, spot)| is_plain(view, spot.pixel).0).count();
        println!("{} points; {plain} of {found} textured spots are on plain surfaces", points.len());
        assert!(points.len() > 200 && plain > 10, "noise gives plain surfaces some texture: {plain} of {found}");
    }
}
