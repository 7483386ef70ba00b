//! Photographs and depth maps.

use glam::{DVec3, Vec3};
use image::RgbImage;
use rayon::prelude::*;

use super::light::develop;
use super::random::{Random, cell};
use super::{Ray, World};
use crate::scene::Camera;

/// Relative difference of a pixel's first samples above which it gets all of them.
const CONTRAST: f32 = 0.06;

/// The ray through a point of the image (pixels); its parameter is the depth.
pub(crate) fn pixel_ray(camera: &Camera, x: f64, y: f64) -> Ray {
    let (u, v) = ((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy);
    let r = &camera.rotation;
    let direction = std::array::from_fn(|k| r[0][k] * u + r[1][k] * v + r[2][k]);
    Ray { origin: DVec3::from_array(camera.center()), direction: DVec3::from_array(direction) }
}

impl World {
    /// Depth (z in the camera frame, metres) along the ray through each pixel's centre, row-major; 0 where there is only sky.
    pub fn depth(&self, camera: &Camera) -> Vec<f32> {
        let width = camera.width as usize;
        let mut out = vec![0.0f32; width * camera.height as usize];
        out.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
            for (x, z) in row.iter_mut().enumerate() {
                let ray = pixel_ray(camera, x as f64 + 0.5, y as f64 + 0.5);
                *z = self.trace(&ray).map_or(0.0, |h| h.t as f32);
            }
        });
        out
    }

    /// A photograph and its depth. `number` selects the photograph's exposure and noise.
    pub fn photograph(&self, camera: &Camera, number: u32) -> (RgbImage, Vec<f32>) {
        let effects = &self.params().effects;
        let mut random = Random::new(self.params().seed ^ (u64::from(number) << 20), 11);
        let gain = (1.0 + effects.exposure * random.range(-1.0, 1.0)) as f32;
        let noise = effects.sensor_noise;
        let width = camera.width as usize;
        let mut pixels = vec![0u8; 3 * width * camera.height as usize];
        let mut depth = vec![0.0f32; width * camera.height as usize];
        pixels.par_chunks_mut(3 * width.max(1)).zip(depth.par_chunks_mut(width.max(1))).enumerate().for_each(
            |(y, (row, depths))| {
                let mut random = Random::new(self.params().seed ^ (u64::from(number) << 20) ^ y as u64, 12);
                for (x, (out, z)) in row.chunks_exact_mut(3).zip(depths).enumerate() {
                    let (radiance, hit) = self.pixel(camera, x as u32, y as u32);
                    *z = hit;
                    let mut colour = develop(radiance * gain);
                    if noise > 0.0 {
                        let grain = [random.normal(), random.normal(), random.normal()];
                        colour += Vec3::from_array(grain.map(|g| (g * noise) as f32));
                    }
                    out.copy_from_slice(&colour.to_array().map(|c| c.round().clamp(0.0, 255.0) as u8));
                }
            },
        );
        // The buffer has exactly the image's size.
        let image = RgbImage::from_raw(camera.width, camera.height, pixels).unwrap_or_default();
        (image, depth)
    }

    /// Mean radiance over a pixel, and the depth at its centre. Five samples in a cross of the sampling grid come first; the
    /// others follow where these differ.
    fn pixel(&self, camera: &Camera, x: u32, y: u32) -> (Vec3, f32) {
        let n = self.params().supersample as i32;
        let middle = n / 2;
        // Each pixel shifts the outer samples a little, which breaks up the regular grid's moire.
        let shift = |axis: i32| 0.5 * (cell(x as i32, y as i32, 0x1234 + axis as u32) - 0.5) / f64::from(n);
        let (jx, jy) = (shift(0), shift(1));
        let take = |i: i32, j: i32| {
            let offset = |k: i32, jitter: f64| {
                let centre = (f64::from(k) + 0.5) / f64::from(n);
                if (i, j) == (middle, middle) { 0.5 } else { centre + jitter }
            };
            self.radiance(&pixel_ray(camera, f64::from(x) + offset(i, jx), f64::from(y) + offset(j, jy)))
        };
        let (centre, depth) = take(middle, middle);
        if n == 1 {
            return (centre, depth);
        }
        let cross = [(0, 0), (n - 1, 0), (0, n - 1), (n - 1, n - 1)];
        let (mut sum, mut low, mut high, mut count) = (centre, centre, centre, 1);
        for (i, j) in cross {
            let (c, _) = take(i, j);
            (sum, low, high, count) = (sum + c, low.min(c), high.max(c), count + 1);
        }
        if ((high - low) / (high + low + 0.05)).max_element() > CONTRAST {
            for j in 0..n {
                for i in 0..n {
                    if (i, j) != (middle, middle) && !cross.contains(&(i, j)) {
                        sum += take(i, j).0;
                        count += 1;
                    }
                }
            }
        }
        (sum / count as f32, depth)
    }

    fn radiance(&self, ray: &Ray) -> (Vec3, f32) {
        match self.trace(ray) {
            Some(hit) => (self.shade(ray, &hit), hit.t as f32),
            None => (self.light.sky(ray.direction), 0.0),
        }
    }
}
