//! The distance without learned weights.

use psrgs_vk::perceptual::{Distance, GradientOf, ImagePair};
use psrgs_vk::scene::random::Random;
use psrgs_vk::vk::{Gpu, Memory};

use super::common;
use super::values::made_up;

const SIZE: (u32, u32) = (41, 36);

fn measure(gpu: &Gpu, distance: &Distance, image: &[[f32; 4]], rgba: &[u8]) -> (f64, Vec<[f32; 4]>) {
    let buffer = |name: &str, bytes: usize| gpu.buffer(name, bytes as u64, Memory::Device).unwrap();
    let (on_device, photograph) = (buffer("image", 16 * image.len()), buffer("photograph", rgba.len()));
    let grad = buffer("grad", 16 * image.len());
    gpu.write(&on_device, image).unwrap();
    gpu.write(&photograph, rgba).unwrap();
    gpu.write(&grad, &vec![[0.0f32; 4]; image.len()]).unwrap();
    let windows = distance.windows(SIZE.0, SIZE.1, true).unwrap();
    let mut recorder = gpu.recorder("test").unwrap();
    let pair = ImagePair { image: &on_device, photograph: &photograph, size: SIZE, at: (0, 0), cropped: false };
    windows.record(&mut recorder, &pair, Some(&GradientOf { image: &grad, weight: 1.0 })).unwrap();
    recorder.submit().unwrap();
    let value: Vec<f32> = gpu.read(windows.result()).unwrap();
    (f64::from(*value.last().unwrap()), gpu.read(&grad).unwrap())
}

#[test]
fn filter_bank_grows_with_blur_and_its_gradient_is_right() {
    let Some(gpu) = common::gpu() else { return };
    let distance = Distance::filter_bank(&gpu).unwrap();
    assert_eq!((distance.layers(), distance.least_side()), (2, 13));
    let rgb = made_up(SIZE.0, SIZE.1, 5);
    let rgba: Vec<u8> = rgb.chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect();
    let sharp = image::RgbImage::from_raw(SIZE.0, SIZE.1, rgb).unwrap();
    let colours = |picture: &image::RgbImage| -> Vec<[f32; 4]> {
        picture.pixels().map(|p| [p.0[0], p.0[1], p.0[2], 255].map(|v| f32::from(v) / 255.0)).collect()
    };
    let (same, none) = measure(&gpu, &distance, &colours(&sharp), &rgba);
    assert!(same < 1e-9, "equal pictures are {same} apart");
    assert!(none.iter().flatten().all(|g| g.abs() < 1e-6));
    let blurred =
        [0.7, 1.2, 2.5].map(|sigma| measure(&gpu, &distance, &colours(&image::imageops::blur(&sharp, sigma)), &rgba).0);
    assert!(same < blurred[0] && blurred[0] < blurred[1] && blurred[1] < blurred[2] && blurred[2] < 1.0, "{blurred:?}");

    // The distance is smooth, unlike that of a network: large steps are accurate enough, and rounding does not matter.
    let start = colours(&image::imageops::blur(&sharp, 1.2));
    let (_, grad) = measure(&gpu, &distance, &start, &rgba);
    let mut random = Random::new(6);
    let length = grad.iter().flatten().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt();
    for trial in 0..3 {
        let direction: Vec<[f32; 4]> = grad
            .iter()
            .map(|g| {
                // Partly along the gradient, so that the slope is far from 0.
                let noise = |v: f32| (f64::from(v) / length + 0.5 * random.range(-1.0, 1.0) / 38.0) as f32;
                let [r, g, b] = [g[0], g[1], g[2]].map(noise);
                [r, g, b, 0.0]
            })
            .collect();
        let moved = |step: f32| -> Vec<[f32; 4]> {
            start.iter().zip(&direction).map(|(p, d)| std::array::from_fn(|c| p[c] + step * d[c])).collect()
        };
        let h = 0.02;
        let at = |step| measure(&gpu, &distance, &moved(step), &rgba).0;
        let want = (at(h) - at(-h)) / (2.0 * f64::from(h));
        let got: f64 = grad.iter().flatten().zip(direction.iter().flatten()).map(|(g, d)| f64::from(g * d)).sum();
        assert!((got - want).abs() < 2e-3 * length, "direction {trial}: {got} instead of {want}, length {length}");
        assert!(got > 0.2 * length, "direction {trial}: the slope is too small");
    }
    common::assert_no_messages(&gpu);
}
