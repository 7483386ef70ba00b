//! Rays through pixels.

use glam::DVec3;

use super::Ray;
use crate::scene::Camera;

/// The ray through a point of the image (pixels); its parameter is the depth.
pub(crate) fn pixel_ray(camera: &Camera, x: f64, y: f64) -> Ray {
    let (u, v) = ((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy);
    let r = &camera.rotation;
    let direction = std::array::from_fn(|k| r[0][k] * u + r[1][k] * v + r[2][k]);
    Ray { origin: DVec3::from_array(camera.center()), direction: DVec3::from_array(direction) }
}
