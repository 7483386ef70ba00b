//! The result of stereo for a view.

use super::homography::intrinsics;
use crate::scene::Camera;
use glam::DVec3;

/// Depth, normals and confidence of a view, row by row from the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Prior {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Depth along the camera's axis in the views' coordinates; 0 where nothing is known.
    pub depth: Vec<f32>,
    /// Unit normals in the camera frame, towards the camera; zero where nothing is known.
    pub normals: Vec<[f32; 3]>,
    /// NCC of the best sources times n / (n + 1) where n views agree, from 0 to 1; 0 where nothing is known.
    pub confidence: Vec<f32>,
}

impl Prior {
    /// From rows of hypothesis and confidence, one per pixel.
    pub(super) fn new(camera: &Camera, rows: &[[f32; 4]]) -> Self {
        let (width, height) = (camera.width, camera.height);
        let mut out = Self { width, height, ..Self::default() };
        for (pixel, plane) in rows.iter().enumerate() {
            let known = plane[3] > 0.0 && plane[0] > 0.0;
            out.depth.push(if known { 1.0 / plane[0] } else { 0.0 });
            out.confidence.push(if known { plane[3] } else { 0.0 });
            let (x, y) = (pixel as u32 % width, pixel as u32 / width);
            let middle = [f64::from(x) + 0.5, f64::from(y) + 0.5];
            let normal = if known { normal(camera, middle, [plane[0], plane[1], plane[2]]) } else { [0.0; 3] };
            out.normals.push(normal);
        }
        out
    }

    /// The prior at another size, from the nearest pixels.
    pub fn at_size(self, width: u32, height: u32) -> Self {
        if (width, height) == (self.width, self.height) {
            return self;
        }
        let nearest =
            |k: u32, to: u32, from: u32| ((2 * u64::from(k) + 1) * u64::from(from) / (2 * u64::from(to))) as usize;
        let mut out = Self { width, height, ..Self::default() };
        for pixel in 0..width * height {
            let (x, y) = (nearest(pixel % width, width, self.width), nearest(pixel / width, height, self.height));
            let at = y * self.width as usize + x;
            out.depth.push(self.depth.get(at).copied().unwrap_or(0.0));
            out.normals.push(self.normals.get(at).copied().unwrap_or([0.0; 3]));
            out.confidence.push(self.confidence.get(at).copied().unwrap_or(0.0));
        }
        out
    }

    /// Share of the pixels that have a depth.
    pub fn share(&self) -> f64 {
        let known = self.depth.iter().filter(|d| **d > 0.0).count();
        known as f64 / self.depth.len().max(1) as f64
    }
}

/// The normal of a hypothesis at a position in pixels.
pub(super) fn normal(camera: &Camera, [u, v]: [f64; 2], hypothesis: [f32; 3]) -> [f32; 3] {
    let [d, gx, gy] = hypothesis.map(f64::from);
    // 1/z = q (u, v, 1) = (K^T q) ray, and -p is the normal, towards the camera, of the plane p X = 1.
    let q = DVec3::new(gx, gy, d - gx * u - gy * v);
    let p = intrinsics(camera).transpose() * q;
    (-p).normalize_or_zero().as_vec3().to_array()
}

/// The hypothesis of a surface at a position in pixels, with a depth and a normal in the camera frame; `None` where the
/// surface is seen from behind or edge-on.
pub(super) fn hypothesis(camera: &Camera, [u, v]: [f64; 2], depth: f64, normal: [f64; 3]) -> Option<[f32; 3]> {
    let ray = DVec3::new((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
    let n = DVec3::from_array(normal);
    let towards = -n.dot(ray);
    let usable = depth > 0.0 && depth.is_finite() && towards > 0.05 * n.length() * ray.length();
    // p = -s n with p ray = 1 / depth.
    let s = 1.0 / (depth * towards);
    usable.then(|| [(1.0 / depth) as f32, (-s * n.x / camera.fx) as f32, (-s * n.y / camera.fy) as f32])
}
