//! Distances against published numbers and against the reference.

use psrgs_vk::perceptual::{Distance, Error, GradientOf, ImagePair, LpipsWeights, Metric, read_tensors};
use psrgs_vk::scene::random::Random;
use psrgs_vk::vk::{Gpu, Memory};

use super::common;
use super::reference::Reference;
use super::weights;

/// RGB8 of a file.
fn picture(path: &std::path::Path) -> (Vec<u8>, u32, u32) {
    let image = image::open(path).unwrap().to_rgb8();
    let (width, height) = image.dimensions();
    (image.into_raw(), width, height)
}

fn opaque(rgb: &[u8]) -> Vec<u8> {
    rgb.chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect()
}

fn unit(rgb: &[u8]) -> Vec<[f64; 3]> {
    rgb.chunks_exact(3).map(|p| [p[0], p[1], p[2]].map(|v| f64::from(v) / 255.0)).collect()
}

/// A smooth picture with noise on it.
pub fn made_up(width: u32, height: u32, seed: u64) -> Vec<u8> {
    let mut random = Random::new(seed);
    let phase: Vec<f64> = (0..6).map(|_| random.range(0.1, 0.9)).collect();
    (0..width * height * 3)
        .map(|i| {
            let (x, y, c) = (f64::from(i / 3 % width), f64::from(i / 3 / width), (i % 3) as usize);
            let wave = (phase[c] * x + 0.7 * y * phase[3 + c]).sin();
            (127.0 + 90.0 * wave + random.range(-30.0, 30.0)).clamp(0.0, 255.0) as u8
        })
        .collect()
}

/// Distances per layer and their sum, with buffers with or without room for gradients.
fn layers(
    gpu: &Gpu,
    distance: &Distance,
    rgb: &[u8],
    rgba: &[u8],
    (width, height): (u32, u32),
    gradient: bool,
) -> Vec<f32> {
    let colours: Vec<[f32; 4]> =
        rgb.chunks_exact(3).map(|p| [p[0], p[1], p[2], 9].map(|v| f32::from(v) / 255.0)).collect();
    let buffer = |name: &str, bytes: usize| gpu.buffer(name, bytes as u64, Memory::Device).unwrap();
    let (image, photograph) = (buffer("image", 16 * colours.len()), buffer("photograph", rgba.len()));
    gpu.write(&image, &colours).unwrap();
    gpu.write(&photograph, rgba).unwrap();
    let windows = distance.windows(width, height, gradient).unwrap();
    let grad = buffer("grad", 16 * colours.len());
    let mut recorder = gpu.recorder("test").unwrap();
    let pair = ImagePair { image: &image, photograph: &photograph, size: (width, height), at: (0, 0), cropped: false };
    let of = GradientOf { image: &grad, weight: 1.0 };
    windows.record(&mut recorder, &pair, gradient.then_some(&of)).unwrap();
    recorder.submit().unwrap();
    gpu.read(windows.result()).unwrap()
}

/// The example of the PerceptualSimilarity project, with the numbers of a separate program in plain C.
#[test]
fn known_distances_of_the_published_weights() {
    let (Some(trunk), Some(linear)) =
        (common::weights("squeezenet_v1.1.ncnn.param"), common::weights("lpips_squeeze_v0.1.pth"))
    else {
        return;
    };
    let (Some(reference), Some(gpu)) = (common::weights("lpips_ex_ref.png"), common::gpu()) else { return };
    let weights = LpipsWeights::read(&trunk, &linear).unwrap();
    let distance = Distance::lpips(&gpu, &weights).unwrap();
    let (reference, width, height) = picture(&reference);
    let known = [
        ("lpips_ex_p0.png", 0.711_211, [0.00989, 0.00690, 0.12880, 0.26106, 0.15072, 0.08816, 0.06567]),
        ("lpips_ex_p1.png", 0.147_935, [0.01671, 0.00360, 0.01452, 0.03692, 0.02952, 0.02236, 0.02430]),
    ];
    let mut metric = Metric::new(&gpu, distance.clone());
    let (numbers, channels) = (read_tensors(&trunk).unwrap(), read_tensors(&linear).unwrap());
    let independent = Reference::new(&numbers, &channels, &unit(&reference), width as usize);
    for (name, total, of_layers) in known {
        let (rgb, ..) = picture(&common::weights(name).unwrap());
        let got = metric.distance(&rgb, &opaque(&reference), width, height).unwrap();
        println!("{name}: {got}");
        assert!((f64::from(got) - total).abs() < 2e-3, "{name}: {got} instead of {total}");
        let got = layers(&gpu, &distance, &rgb, &opaque(&reference), (width, height), true);
        let want = independent.layers(&unit(&rgb));
        for layer in 0..7 {
            let value = f64::from(got[layer]);
            assert!((value - of_layers[layer]).abs() < 2e-3, "{name}: layer {layer} is {value}");
            assert!(
                (value - want[layer]).abs() < 1e-5 * want[layer],
                "{name}: layer {layer} is {value}, not {}",
                want[layer]
            );
        }
    }
    let same = metric.distance(&reference, &opaque(&reference), width, height).unwrap();
    assert_eq!(same, 0.0, "equal pictures are at no distance");
    common::assert_no_messages(&gpu);
}

#[test]
fn any_size_has_the_distance_of_the_reference() {
    let Some(gpu) = common::gpu() else { return };
    let (weights, trunk, linear) = weights::random();
    let distance = Distance::lpips(&gpu, &weights).unwrap();
    assert_eq!((distance.layers(), distance.least_side()), (7, 17));
    let mut metric = Metric::new(&gpu, distance.clone());
    for (width, height) in [(17, 17), (34, 21), (23, 46)] {
        let (rgb, reference) = (made_up(width, height, 1), made_up(width, height, 2));
        let independent = Reference::new(&trunk, &linear, &unit(&reference), width as usize);
        let want = independent.layers(&unit(&rgb));
        for gradient in [false, true] {
            let got = layers(&gpu, &distance, &rgb, &opaque(&reference), (width, height), gradient);
            for (layer, (got, want)) in got.iter().zip(&want).enumerate() {
                let error = (f64::from(*got) - want).abs();
                assert!(error < 2e-5 * want, "{width}x{height}, layer {layer}: {got} instead of {want}");
            }
            let sum: f64 = want.iter().sum();
            assert!((f64::from(got[7]) - sum).abs() < 2e-5 * sum);
        }
        let got = f64::from(metric.distance(&rgb, &opaque(&reference), width, height).unwrap());
        assert!((got - want.iter().sum::<f64>()).abs() < 1e-4);
    }
    // Pixels outside the comparison have no effect.
    let (rgb, reference) = (made_up(34, 21, 1), made_up(34, 21, 2));
    let masked: Vec<u8> = reference.chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 0]).collect();
    assert_eq!(metric.distance(&rgb, &masked, 34, 21).unwrap(), 0.0);
    common::assert_no_messages(&gpu);
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let Some(gpu) = common::gpu() else { return };
    let (weights, ..) = weights::random();
    let distance = Distance::lpips(&gpu, &weights).unwrap();
    let mut metric = Metric::new(&gpu, distance.clone());
    let error = metric.distance(&made_up(16, 40, 1), &opaque(&made_up(16, 40, 2)), 16, 40).unwrap_err();
    assert!(matches!(error, Error::TooSmall { width: 16, height: 40, least: 17 }), "{error}");
    let error = metric.distance(&[0; 30], &[0; 40], 20, 20).unwrap_err();
    assert!(matches!(error, Error::Pixels { found: 30, expected: 1200 }), "{error}");

    let windows = distance.windows(20, 20, false).unwrap();
    let buffer = gpu.buffer("image", 16 * 900, Memory::Device).unwrap();
    let mut recorder = gpu.recorder("test").unwrap();
    let at = |at| ImagePair { image: &buffer, photograph: &buffer, size: (30, 30), at, cropped: false };
    for place in [(11, 0), (0, 11), (u32::MAX, 0)] {
        let error = windows.record(&mut recorder, &at(place), None).unwrap_err();
        assert!(matches!(error, Error::Outside { .. }), "{error}");
    }
    let of = GradientOf { image: &buffer, weight: 1.0 };
    let error = windows.record(&mut recorder, &at((0, 0)), Some(&of)).unwrap_err();
    assert!(matches!(error, Error::ValueOnly), "{error}");
}

#[test]
fn values_alone_take_much_less_memory() {
    let Some(gpu) = common::gpu() else { return };
    let (weights, ..) = weights::random();
    let distance = Distance::lpips(&gpu, &weights).unwrap();
    let [value, both] = [false, true].map(|gradient| distance.windows(96, 64, gradient).unwrap().bytes());
    assert!(2 * value < both, "{value} bytes, with gradients {both}");
}
