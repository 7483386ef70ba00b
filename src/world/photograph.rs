//! Photographs, and their ground truth.

use super::pixel_ray;
use glam::{DVec3, Vec3};
use image::RgbImage;
use rayon::prelude::*;

use super::light::develop;
use super::noise::cell;
use super::optics::Optics;
use super::{Ray, World, WorldView};
use crate::scene::Camera;
use crate::scene::random::Random;

/// Relative difference of a pixel's first samples above which the pixel gets all its samples.
const CONTRAST: f32 = 0.06;

/// The photograph and the ground truth of a view.
#[derive(Clone, Debug)]
pub struct RenderedView {
    /// The photograph: through the lens, with exposure and noise.
    pub photograph: RgbImage,
    /// The undistorted image with the nominal exposure and without noise.
    pub clean: RgbImage,
    /// Depth and normal of each pixel of the undistorted image.
    pub truth: Truth,
}

/// True depths and normals of an image, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// Depth (z in the camera frame, metres) along the ray through each pixel's centre; 0 where there is only sky.
    pub depth: Vec<f32>,
    /// Unit normal of that surface in the camera frame, towards the camera; 0 for sky.
    pub normals: Vec<[f32; 3]>,
}

/// Mean radiance of each pixel, and the surface that the ray through its centre hits.
struct RadianceImage {
    size: (u32, u32),
    radiance: Vec<Vec3>,
    truth: Truth,
}

/// A camera with its lens, which gives the rays of an image's samples.
#[derive(Clone, Copy)]
struct CameraRays<'a> {
    camera: &'a Camera,
    optics: Option<&'a Optics>,
}

impl CameraRays<'_> {
    fn size(&self) -> (u32, u32) {
        self.optics.map_or((self.camera.width, self.camera.height), |o| (o.lens.size[0], o.lens.size[1]))
    }

    /// The ray through a point of a pixel.
    fn ray(&self, pixel: (u32, u32), x: f64, y: f64) -> Option<Ray> {
        match self.optics {
            None => Some(pixel_ray(self.camera, x, y)),
            Some(optics) => optics.ray(self.camera, pixel, x, y),
        }
    }
}

impl World {
    /// Depth and normals of a pinhole camera's image.
    pub fn truth(&self, camera: &Camera) -> Truth {
        let rotation = camera.rotation.map(DVec3::from_array);
        let pixels: Vec<(f32, [f32; 3])> = (0..camera.width * camera.height)
            .into_par_iter()
            .map(|k| {
                let (x, y) = (f64::from(k % camera.width), f64::from(k / camera.width));
                match self.trace(&pixel_ray(camera, x + 0.5, y + 0.5)) {
                    Some(hit) => (hit.t as f32, rotation.map(|row| row.dot(hit.normal) as f32)),
                    None => (0.0, [0.0; 3]),
                }
            })
            .collect();
        let (depth, normals) = pixels.into_iter().unzip();
        Truth { depth, normals }
    }

    /// Depth (z in the camera frame, metres) along the ray through each pixel's centre, row-major;
    /// 0 where there is only sky.
    pub fn depth(&self, camera: &Camera) -> Vec<f32> {
        self.truth(camera).depth
    }

    /// A photograph of a pinhole camera and its depth. `number` selects the photograph's exposure and noise.
    pub fn photograph(&self, camera: &Camera, number: u32) -> (RgbImage, Vec<f32>) {
        let exposed = self.expose(CameraRays { camera, optics: None });
        (self.developed(&exposed, self.exposure(number), Some(number)), exposed.truth.depth)
    }

    /// The image of a pinhole camera with the nominal exposure and without noise, and its ground truth.
    pub fn clean(&self, camera: &Camera) -> (RgbImage, Truth) {
        let exposed = self.expose(CameraRays { camera, optics: None });
        (self.developed(&exposed, 1.0, None), exposed.truth)
    }

    /// Photograph, clean image and ground truth of a view; `number` selects the photograph's exposure and noise.
    pub fn shot(&self, view: &WorldView, number: u32) -> RenderedView {
        let straight = self.expose(CameraRays { camera: &view.camera, optics: None });
        let clean = self.developed(&straight, 1.0, None);
        let gain = self.exposure(number);
        let photograph = match &self.optics {
            None => self.developed(&straight, gain, Some(number)),
            Some(optics) => {
                let bent = self.expose(CameraRays { camera: &view.camera, optics: Some(optics) });
                self.developed(&bent, gain, Some(number))
            }
        };
        RenderedView { photograph, clean, truth: straight.truth }
    }

    /// The ray through a point of a view's photograph.
    pub(super) fn photograph_ray(&self, view: &WorldView, x: f64, y: f64) -> Option<Ray> {
        CameraRays { camera: &view.camera, optics: self.optics.as_ref() }.ray((x as u32, y as u32), x, y)
    }

    fn expose(&self, taking: CameraRays<'_>) -> RadianceImage {
        let (width, height) = taking.size();
        let rotation = taking.camera.rotation.map(DVec3::from_array);
        let mut radiance = vec![Vec3::ZERO; (width * height) as usize];
        let mut pixels = vec![(0.0f32, [0.0f32; 3]); (width * height) as usize];
        let rows = radiance.par_chunks_mut(width as usize).zip(pixels.par_chunks_mut(width as usize));
        rows.enumerate().for_each(|(y, (radiance, pixels))| {
            for (x, (radiance, pixel)) in radiance.iter_mut().zip(pixels).enumerate() {
                let (mean, depth, normal) = self.pixel(taking, x as u32, y as u32);
                *radiance = mean;
                *pixel = (depth, rotation.map(|row| row.dot(normal) as f32));
            }
        });
        let (depth, normals) = pixels.into_iter().unzip();
        RadianceImage { size: (width, height), radiance, truth: Truth { depth, normals } }
    }

    /// Converts radiance to an 8-bit image, with a gain and, where `number` is given, with the noise of that
    /// photograph.
    fn developed(&self, exposed: &RadianceImage, gain: f64, number: Option<u32>) -> RgbImage {
        let noise = if number.is_some() { self.params().effects.sensor_noise } else { 0.0 };
        let seed = self.params().seed ^ (u64::from(number.unwrap_or(0)) << 20);
        let (width, height) = exposed.size;
        let mut pixels = vec![0u8; 3 * exposed.radiance.len()];
        let rows = pixels.par_chunks_mut(3 * width as usize).zip(exposed.radiance.par_chunks(width as usize));
        rows.enumerate().for_each(|(y, (row, radiance))| {
            let mut random = Random::stream(seed ^ y as u64, 12);
            for (out, radiance) in row.chunks_exact_mut(3).zip(radiance) {
                let mut colour = develop(*radiance * gain as f32);
                if noise > 0.0 {
                    let grain = [random.normal(), random.normal(), random.normal()];
                    colour += Vec3::from_array(grain.map(|g| (g * noise) as f32));
                }
                out.copy_from_slice(&colour.to_array().map(|c| c.round().clamp(0.0, 255.0) as u8));
            }
        });
        // The buffer has exactly the image's size.
        RgbImage::from_raw(width, height, pixels).unwrap_or_default()
    }

    /// Mean radiance over a pixel, and the depth and the world normal at its centre. The centre and the corners of the
    /// sampling grid come first; the other samples follow where the first five differ.
    fn pixel(&self, taking: CameraRays<'_>, x: u32, y: u32) -> (Vec3, f32, DVec3) {
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
            match taking.ray((x, y), f64::from(x) + offset(i, jx), f64::from(y) + offset(j, jy)) {
                Some(ray) => self.radiance(&ray),
                None => (Vec3::ZERO, 0.0, DVec3::ZERO),
            }
        };
        let (centre, depth, normal) = take(middle, middle);
        if n == 1 {
            return (centre, depth, normal);
        }
        let cross = [(0, 0), (n - 1, 0), (0, n - 1), (n - 1, n - 1)];
        let (mut sum, mut low, mut high, mut count) = (centre, centre, centre, 1);
        for (i, j) in cross {
            let (c, ..) = take(i, j);
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
        (sum / count as f32, depth, normal)
    }

    fn radiance(&self, ray: &Ray) -> (Vec3, f32, DVec3) {
        match self.trace(ray) {
            Some(hit) => (self.shade(ray, &hit), hit.t as f32, hit.normal),
            None => (self.light.sky(ray.direction), 0.0, DVec3::ZERO),
        }
    }
}
