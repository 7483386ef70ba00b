//! One cloud from the depths of all views.

use glam::DVec3;

use super::homography::{Homography, intrinsics, rotation};
use super::{Prior, Settings, StereoView};
use crate::scene::Camera;

/// Largest angle in degrees between the normals of pixels that fuse into one point.
const SAME_DIRECTION: f64 = 30.0;

/// A point of the fused cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FusedPoint {
    /// In the views' coordinates.
    pub position: [f64; 3],
    /// Unit normal in the views' coordinates.
    pub normal: [f32; 3],
    /// 8-bit colour; grey where the views have no colours.
    pub colour: [u8; 3],
    /// Number of pixels fused into the point.
    pub pixels: u32,
    /// The view and the pixel that show it first.
    pub first: (u32, u32),
}

/// A pixel's point in space.
struct PixelPoint {
    position: DVec3,
    normal: DVec3,
    colour: [f64; 3],
}

/// Fuses pixels of different views that show the same point in space: their depths agree within
/// [`Settings::agree_depth`] and their normals are similar. Each pixel is used once.
pub fn fuse(views: &[StereoView], priors: &[Prior], settings: &Settings) -> Vec<FusedPoint> {
    let mut used: Vec<Vec<bool>> = priors.iter().map(|prior| vec![false; prior.depth.len()]).collect();
    let mut points = Vec::new();
    for (i, (view, prior)) in views.iter().zip(priors).enumerate() {
        let links: Vec<(usize, Homography)> =
            view.sources.iter().map(|&s| (s, Homography::new(&view.camera, &views[s].camera))).collect();
        for pixel in 0..prior.depth.len() {
            if used[i][pixel] || prior.depth[pixel] <= 0.0 {
                continue;
            }
            used[i][pixel] = true;
            let first = lifted(view, prior, pixel);
            let mut group = vec![];
            let (u, v) = middle(prior, pixel);
            let z = f64::from(prior.depth[pixel]);
            for (source, link) in &links {
                let Some((place, depth)) = seen_at(link, [u, v], z, &priors[*source]) else { continue };
                if used[*source][place] {
                    continue;
                }
                let there = f64::from(priors[*source].depth[place]);
                if there <= 0.0 || (there / depth - 1.0).abs() >= f64::from(settings.agree_depth) {
                    continue;
                }
                let other = lifted(&views[*source], &priors[*source], place);
                if other.normal.dot(first.normal) < SAME_DIRECTION.to_radians().cos() {
                    continue;
                }
                used[*source][place] = true;
                group.push(other);
            }
            group.push(first);
            points.push(FusedPoint { first: (i as u32, pixel as u32), ..merged(&group) });
        }
    }
    points
}

/// The point of one pixel with a depth.
pub fn lifted_pixel(view: &StereoView, prior: &Prior, pixel: usize) -> FusedPoint {
    merged(&[lifted(view, prior, pixel)])
}

fn middle(prior: &Prior, pixel: usize) -> (f64, f64) {
    let (x, y) = (pixel % prior.width as usize, pixel / prior.width as usize);
    (x as f64 + 0.5, y as f64 + 0.5)
}

/// The pixel of another view that sees a position at a depth, and the depth in the other view.
fn seen_at(link: &Homography, [u, v]: [f64; 2], depth: f64, other: &Prior) -> Option<(usize, f64)> {
    let h = link.applied(u, v, 1.0 / depth);
    let (x, y) = (h.x / h.z, h.y / h.z);
    let inside = h.z > 0.0 && x >= 0.0 && y >= 0.0 && x < f64::from(other.width) && y < f64::from(other.height);
    inside.then(|| (y as usize * other.width as usize + x as usize, h.z * depth))
}

fn lifted(view: &StereoView, prior: &Prior, pixel: usize) -> PixelPoint {
    let (u, v) = middle(prior, pixel);
    let (position, normal) = in_space(&view.camera, [u, v], f64::from(prior.depth[pixel]), prior.normals[pixel]);
    PixelPoint { position, normal, colour: view.colours.get(pixel).copied().unwrap_or([128; 3]).map(f64::from) }
}

/// The point in space of a position (u, v) at a depth, and its normal, rotated from the camera frame.
pub(super) fn in_space(camera: &Camera, [u, v]: [f64; 2], depth: f64, normal: [f32; 3]) -> (DVec3, DVec3) {
    let back = rotation(camera).transpose();
    let ray = intrinsics(camera).inverse() * DVec3::new(u, v, 1.0);
    let position = DVec3::from_array(camera.center()) + back * (ray * depth);
    (position, back * DVec3::from_array(normal.map(f64::from)))
}

fn merged(group: &[PixelPoint]) -> FusedPoint {
    let share = 1.0 / group.len() as f64;
    let mean = |of: &dyn Fn(&PixelPoint) -> DVec3| group.iter().map(of).sum::<DVec3>() * share;
    // The mean is taken relative to the first point: large coordinates keep their digits.
    let origin = group[0].position;
    let position = origin + mean(&|p| p.position - origin);
    FusedPoint {
        position: position.to_array(),
        normal: mean(&|p| p.normal).normalize_or_zero().as_vec3().to_array(),
        colour: mean(&|p| DVec3::from_array(p.colour)).to_array().map(|c| c.round() as u8),
        pixels: group.len() as u32,
        first: (0, 0),
    }
}
