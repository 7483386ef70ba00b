//! The gradient with respect to the image against finite differences of the reference in double precision.

use psrgs_vk::perceptual::{Distance, GradientOf, ImagePair};
use psrgs_vk::scene::random::Random;
use psrgs_vk::vk::{Gpu, Memory};

use super::common;
use super::reference::Reference;
use super::values::made_up;
use super::weights;

/// An image and a photograph, and a window in them.
struct Scene {
    size: (u32, u32),
    at: (u32, u32),
    window: (u32, u32),
    image: Vec<[f32; 4]>,
    rgba: Vec<u8>,
}

impl Scene {
    fn new() -> Self {
        let size = (40, 31);
        let mut random = Random::new(3);
        let rgb = made_up(size.0, size.1, 7);
        let image = rgb.chunks_exact(3).map(|p| {
            let c: [f64; 3] = [p[0], p[1], p[2]].map(|v| f64::from(v) / 255.0 + 0.2 * (random.unit() - 0.5));
            [c[0] as f32, c[1] as f32, c[2] as f32, 0.5]
        });
        let image = image.collect();
        let photograph = made_up(size.0, size.1, 8);
        // Every 17th pixel is masked.
        let alpha = |k: usize| if k.is_multiple_of(17) { 0 } else { 255 };
        let rgba = photograph.chunks_exact(3).enumerate().flat_map(|(k, p)| [p[0], p[1], p[2], alpha(k)]).collect();
        Self { size, at: (5, 3), window: (30, 25), image, rgba }
    }

    /// Indices of the window's pixels in the whole image.
    fn places(&self) -> Vec<usize> {
        let row = |y| (0..self.window.0).map(move |x| ((self.at.1 + y) * self.size.0 + self.at.0 + x) as usize);
        (0..self.window.1).flat_map(row).collect()
    }

    fn photograph(&self, k: usize) -> [f64; 3] {
        std::array::from_fn(|c| f64::from(self.rgba[4 * k + c]) / 255.0)
    }

    /// The compared window, with `step` times `direction` (three numbers per pixel) added to the image.
    fn shown(&self, direction: &[f64], step: f64) -> Vec<[f64; 3]> {
        let one = |(i, k): (usize, usize)| match self.rgba[4 * k + 3] {
            0 => self.photograph(k),
            _ => std::array::from_fn(|c| f64::from(self.image[k][c]) + step * direction[3 * i + c]),
        };
        self.places().into_iter().enumerate().map(one).collect()
    }
}

/// Value, and `weight` times the gradient added to `before`.
fn on_device(gpu: &Gpu, distance: &Distance, scene: &Scene, weight: f32, before: &[[f32; 4]]) -> (f32, Vec<[f32; 4]>) {
    let buffer = |name: &str, bytes: usize| gpu.buffer(name, bytes as u64, Memory::Device).unwrap();
    let (image, photograph) = (buffer("image", 16 * scene.image.len()), buffer("photograph", scene.rgba.len()));
    let grad = buffer("grad", 16 * scene.image.len());
    gpu.write(&image, &scene.image).unwrap();
    gpu.write(&photograph, &scene.rgba).unwrap();
    gpu.write(&grad, before).unwrap();
    let windows = distance.windows(scene.window.0, scene.window.1, true).unwrap();
    let pair = ImagePair { image: &image, photograph: &photograph, size: scene.size, at: scene.at, cropped: false };
    let (waits, memory) = (gpu.stats().host_waits, gpu.memory_use().current);
    let mut recorder = gpu.recorder("test").unwrap();
    windows.record(&mut recorder, &pair, Some(&GradientOf { image: &grad, weight })).unwrap();
    recorder.submit().unwrap();
    assert_eq!(
        (gpu.stats().host_waits, gpu.memory_use().current),
        (waits, memory),
        "recording waits and allocates nothing"
    );
    let value: Vec<f32> = gpu.read(windows.result()).unwrap();
    (*value.last().unwrap(), gpu.read(&grad).unwrap())
}

#[test]
fn gradient_is_that_of_finite_differences() {
    let Some(gpu) = common::gpu() else { return };
    let (weights, trunk, linear) = weights::random();
    let distance = Distance::lpips(&gpu, &weights).unwrap();
    let scene = Scene::new();
    let places = scene.places();
    let photograph: Vec<[f64; 3]> = places.iter().map(|k| scene.photograph(*k)).collect();
    let reference = Reference::new(&trunk, &linear, &photograph, scene.window.0 as usize);
    let mut random = Random::new(4);
    let before: Vec<[f32; 4]> = scene.image.iter().map(|_| [0.25, -0.5, 1.0, 7.0]).collect();
    let weight = 512.0;
    let (value, after) = on_device(&gpu, &distance, &scene, weight, &before);
    let want = reference.distance(&scene.shown(&vec![0.0; 3 * places.len()], 0.0));
    assert!((f64::from(value) - want).abs() < 2e-5 * want, "{value} instead of {want}");

    // The added gradient in the window. Outside the window and at masked pixels there must be none.
    let mut grad = Vec::new();
    for (k, (after, before)) in after.iter().zip(&before).enumerate() {
        assert_eq!(after[3], before[3]);
        if !places.contains(&k) || scene.rgba[4 * k + 3] == 0 {
            assert_eq!(after, before, "pixel {k} has no gradient");
        }
    }
    for k in &places {
        grad.extend((0..3).map(|c| f64::from(after[*k][c] - before[*k][c]) / f64::from(weight)));
    }
    let largest = grad.iter().fold(0.0f64, |m, g| m.max(g.abs()));
    assert!(largest > 1e-4, "the gradient is next to nothing: {largest}");

    let slope = |direction: &[f64]| {
        let h = 1e-6;
        let at = |step| reference.distance(&scene.shown(direction, step));
        (at(h) - at(-h)) / (2.0 * h)
    };
    let unmasked = |i: usize| scene.rgba[4 * places[i / 3] + 3] != 0;
    for trial in 0..6 {
        let direction: Vec<f64> =
            (0..grad.len()).map(|i| if unmasked(i) { random.range(-1.0, 1.0) } else { 0.0 }).collect();
        let got: f64 = grad.iter().zip(&direction).map(|(g, d)| g * d).sum();
        let scale: f64 = grad.iter().zip(&direction).map(|(g, d)| (g * d).powi(2)).sum::<f64>().sqrt();
        let want = slope(&direction);
        assert!((got - want).abs() < 1e-3 * scale, "direction {trial}: {got} instead of {want}, scale {scale}");
    }
    for trial in 0..24 {
        // Corners and edges too, where windows of filters end.
        let i = if trial < 4 {
            [0, 89, 3 * 24 * 30, 3 * 25 * 30 - 1][trial]
        } else {
            (random.unit() * grad.len() as f64) as usize
        };
        let mut direction = vec![0.0; grad.len()];
        direction[i] = 1.0;
        let want = slope(&direction);
        assert!((grad[i] - want).abs() < 1e-3 * largest, "value {i}: {} instead of {want}", grad[i]);
    }
    common::assert_no_messages(&gpu);
}
