//! Depth and normal maps of a cloud.

use std::collections::BTreeSet;

use glam::{DMat3, DVec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use super::normals::normal_at;
use crate::scene::Camera;
use crate::stereo::Prior;

/// Number of points from which the cloud's spacing is measured.
const SAMPLED: usize = 2000;
/// Most pixels to each side in which a nearer point hides others.
const MOST_REACH: usize = 8;
/// Steepest slope (depth over width) of a surface that does not hide its own points.
const SLOPE: f64 = 2.0;

/// The nearest point of each pixel and its depth.
struct NearestPoints {
    points: Vec<Option<u32>>,
    depth: Vec<f64>,
}

/// Depth and normals of a cloud for cameras in the cloud's coordinates. A pixel has the depth of the nearest point in
/// it, unless points in neighbouring pixels show a surface in front, and a normal if the point's neighbours lie on a
/// plane.
pub fn maps(cameras: &[Camera], points: &[[f64; 3]]) -> Vec<Prior> {
    if points.is_empty() {
        return cameras.iter().map(|camera| prior(camera, &NearestPoints::nothing(camera), &|_| None)).collect();
    }
    let tree = ImmutableKdTree::<f64, 3>::new_from_slice(points);
    let spacing = spacing(&tree, points);
    let seen: Vec<NearestPoints> =
        cameras.par_iter().map(|camera| NearestPoints::new(camera, points, spacing)).collect();
    let used: Vec<u32> =
        seen.iter().flat_map(|s| s.points.iter().flatten().copied()).collect::<BTreeSet<_>>().into_iter().collect();
    let at = |p: u32| points.get(p as usize).and_then(|place| normal_at(&tree, points, *place));
    let normals: Vec<Option<DVec3>> = used.par_iter().map(|p| at(*p)).collect();
    let normal = |p: u32| used.binary_search(&p).ok().and_then(|k| normals[k]);
    cameras.iter().zip(&seen).map(|(camera, seen)| prior(camera, seen, &normal)).collect()
}

/// Median distance from a point to the nearest other point.
fn spacing(tree: &ImmutableKdTree<f64, 3>, points: &[[f64; 3]]) -> f64 {
    let step = points.len().div_ceil(SAMPLED).max(1);
    let wanted = std::num::NonZero::new(2).unwrap_or(std::num::NonZero::<usize>::MIN);
    let second = |p: &[f64; 3]| tree.nearest_n::<SquaredEuclidean>(p, wanted).last().map_or(0.0, |n| n.distance.sqrt());
    let mut distances: Vec<f64> = points.iter().step_by(step).map(second).collect();
    let middle = distances.len() / 2;
    *distances.select_nth_unstable_by(middle, f64::total_cmp).1
}

impl NearestPoints {
    fn nothing(camera: &Camera) -> Self {
        let pixels = camera.width as usize * camera.height as usize;
        Self { points: vec![None; pixels], depth: vec![f64::INFINITY; pixels] }
    }

    fn new(camera: &Camera, points: &[[f64; 3]], spacing: f64) -> Self {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let mut seen = Self::nothing(camera);
        let c = camera.center();
        for (number, p) in points.iter().enumerate() {
            let [x, y, z] = camera.rotation.map(|row| (0..3).map(|k| row[k] * (p[k] - c[k])).sum::<f64>());
            if z.is_nan() || z <= 0.0 {
                continue;
            }
            let (u, v) = (camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy);
            if u >= 0.0 && v >= 0.0 && u < width as f64 && v < height as f64 {
                let pixel = v as usize * width + u as usize;
                if z < seen.depth[pixel] {
                    (seen.depth[pixel], seen.points[pixel]) = (z, Some(number as u32));
                }
            }
        }
        // Gaps between the points of a surface are as wide as the spacing of the points.
        let focal = camera.fx.max(camera.fy);
        let mut depths: Vec<f64> = seen.depth.iter().copied().filter(|z| z.is_finite()).collect();
        if depths.is_empty() {
            return seen;
        }
        let middle = depths.len() / 2;
        let typical = *depths.select_nth_unstable_by(middle, f64::total_cmp).1;
        let reach = ((2.0 * spacing * focal / typical).ceil() as usize).clamp(1, MOST_REACH);
        let nearest = least_around(&seen.depth, width, height, reach);
        for (pixel, nearest) in nearest.into_iter().enumerate() {
            let allowed = 2.0 * spacing + SLOPE * reach as f64 * nearest / focal;
            if seen.depth[pixel] - nearest > allowed {
                (seen.depth[pixel], seen.points[pixel]) = (f64::INFINITY, None);
            }
        }
        seen
    }
}

/// The least value within `reach` pixels to each side; first along rows, then along columns.
fn least_around(values: &[f64], width: usize, height: usize, reach: usize) -> Vec<f64> {
    let least = |from: &[f64], at: usize, step: usize, place: usize, count: usize| {
        let (first, last) = (place.saturating_sub(reach), (place + reach).min(count - 1));
        (first..=last).map(|k| from[at + k * step - place * step]).fold(f64::INFINITY, f64::min)
    };
    let rows: Vec<f64> = (0..width * height).map(|p| least(values, p, 1, p % width, width)).collect();
    (0..width * height).map(|p| least(&rows, p, width, p / width, height)).collect()
}

fn prior(camera: &Camera, seen: &NearestPoints, normal: &dyn Fn(u32) -> Option<DVec3>) -> Prior {
    let turned = DMat3::from_cols_array_2d(&camera.rotation).transpose();
    let mut out = Prior { width: camera.width, height: camera.height, ..Prior::default() };
    for (pixel, point) in seen.points.iter().enumerate() {
        let (x, y) = (pixel as u32 % camera.width, pixel as u32 / camera.width);
        let ray =
            DVec3::new((f64::from(x) + 0.5 - camera.cx) / camera.fx, (f64::from(y) + 0.5 - camera.cy) / camera.fy, 1.0);
        let facing = |n: DVec3| if n.dot(ray) > 0.0 { -n } else { n };
        let normal = point.and_then(normal).map_or(DVec3::ZERO, |n| facing(turned * n));
        out.depth.push(if point.is_some() { seen.depth[pixel] as f32 } else { 0.0 });
        out.normals.push(normal.as_vec3().to_array());
        out.confidence.push(if point.is_some() { 1.0 } else { 0.0 });
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Looks straight down from a height of 10.
    fn camera() -> Camera {
        Camera {
            rotation: [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
            translation: [0.0, 0.0, 10.0],
            fx: 40.0,
            fy: 40.0,
            cx: 20.0,
            cy: 16.0,
            width: 40,
            height: 32,
        }
    }

    fn ground() -> Vec<[f64; 3]> {
        let at = |k: u32| (f64::from(k) + 0.5) * 0.1 - 6.0;
        (0..120 * 120).map(|k| [at(k % 120), at(k / 120), 0.0]).collect()
    }

    #[test]
    fn a_plane_is_seen_at_its_depth_with_its_normal() {
        let maps = maps(&[camera()], &ground());
        let prior = &maps[0];
        assert!(prior.share() > 0.99, "{}", prior.share());
        for (pixel, depth) in prior.depth.iter().enumerate().filter(|(_, d)| **d > 0.0) {
            assert!((depth - 10.0).abs() < 1e-6);
            assert!((prior.normals[pixel][2] + 1.0).abs() < 1e-6, "{:?}", prior.normals[pixel]);
        }
    }

    /// A roof over the ground, with wide gaps between its points: the ground that shows through the gaps is hidden.
    #[test]
    fn what_lies_behind_a_surface_is_not_seen() {
        let mut points = ground();
        points.extend((0..400).map(|k| [f64::from(k % 20) * 0.25 - 2.5, f64::from(k / 20) * 0.25 - 2.5, 4.0]));
        let maps = maps(&[camera()], &points);
        for (pixel, depth) in maps[0].depth.iter().enumerate().filter(|(_, d)| **d > 0.0) {
            let (u, v) = ((pixel % 40) as f64 + 0.5 - 20.0, (pixel / 40) as f64 + 0.5 - 16.0);
            // The roof spans 2.5 * 40 / 6 = 16.7 pixels to each side of the middle.
            let inside = u.abs() < 14.0 && v.abs() < 14.0;
            assert!(!inside || (depth - 6.0).abs() < 1e-6, "pixel {u}, {v}: {depth}");
        }
        assert!(maps[0].depth.iter().filter(|d| (**d - 6.0).abs() < 1e-6).count() > 300);
    }

    #[test]
    fn nothing_is_known_without_points_or_behind_the_camera() {
        for points in [vec![], vec![[0.0, 0.0, 20.0]; 30]] {
            let maps = maps(&[camera()], &points);
            assert!(maps[0].depth.iter().all(|d| *d == 0.0) && maps[0].depth.len() == 40 * 32);
        }
    }
}
