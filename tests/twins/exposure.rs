//! `exposure_apply`, `exposure_backward`, `exposure_step` against f64, around workgroup edges. Gradients against finite
//! differences. The mean over photographs stays the identity.

use psrgs_vk::pass::adam::AdamSettings;
use psrgs_vk::pass::exposure::{self, NUMBERS, PIXELS, Push, ROW, StepPush};
use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::exposure as twin;
use psrgs_vk::vk::Gpu;

use super::harness::{self, Words, bytes, garbage};

const EPS: f64 = f32::EPSILON as f64;

fn wide<const N: usize>(x: [f32; N]) -> [f64; N] {
    x.map(f64::from)
}

fn rgb(pixel: [f32; 4]) -> [f32; 3] {
    [pixel[0], pixel[1], pixel[2]]
}

fn close(got: f32, want: f64, bound: f64, what: &str) {
    assert!((f64::from(got) - want).abs() <= bound, "{what}: {got} instead of {want}, bound {bound:e}");
}

/// Rows of photographs after some training: deviations with moments, and in the last row the mean.
fn rows(random: &mut Random, views: usize) -> Vec<f32> {
    let mut rows: Vec<f32> = (0..exposure::floats(views)).map(|_| random.between(-0.1, 0.1)).collect();
    for v in 0..views {
        // Second moments are not negative.
        rows[ROW * v + 2 * NUMBERS..ROW * (v + 1)].iter_mut().for_each(|x| *x = x.abs());
    }
    for k in 0..NUMBERS {
        rows[ROW * views + k] = (0..views).map(|v| rows[ROW * v + k]).sum::<f32>() / views as f32;
    }
    rows
}

fn pixels(random: &mut Random, count: usize, low: f32, high: f32) -> Vec<[f32; 4]> {
    (0..count).map(|_| [0; 4].map(|_| random.between(low, high))).collect()
}

/// The passes over pixels. Words behind the image must not change.
fn over_pixels(gpu: &Gpu, random: &mut Random, count: u32) {
    let (views, view, room) = (3, 1, count as usize + 70);
    let rows = rows(random, views);
    let wide_rows: Vec<f64> = rows.iter().map(|x| f64::from(*x)).collect();
    let e = twin::deviation(&wide_rows, view, views);
    let (image, grad) = (pixels(random, room, 0.0, 1.0), pixels(random, room, -1e-4, 1e-4));
    let push = Push { pixels: count, view: view as u32, views: views as u32 };
    let groups = exposure::parts(count);

    let buffers = [bytes(&image), bytes(&rows), garbage(4 * room)];
    let outcome = harness::run(gpu, &exposure::APPLY, &[], &buffers, &push, groups);
    let (device, by_twin) = (outcome.device::<[f32; 4]>(2), outcome.twin::<[f32; 4]>(2));
    for i in 0..room {
        if i >= count as usize {
            assert_eq!(bytes(&device[i..=i]), buffers[2][16 * i..16 * (i + 1)], "pixel {i} is behind the image");
            continue;
        }
        let c = wide(rgb(image[i]));
        let want = twin::apply(&e, c);
        for k in 0..3 {
            // Two roundings of a deviation of at most 0.3, and those of four products and sums of at most 1.5.
            close(device[i][k], want[k], 12.0 * EPS, "exposed");
            close(by_twin[i][k], want[k], 12.0 * EPS, "exposed by the twin");
        }
        assert_eq!(device[i][3], image[i][3], "transmittance");
    }

    let buffers = [bytes(&image), bytes(&rows), bytes(&grad), garbage(NUMBERS * (groups as usize + 1))];
    let outcome = harness::run(gpu, &exposure::BACKWARD, &[], &buffers, &push, groups);
    let (device, parts) = (outcome.device::<[f32; 4]>(2), outcome.device::<f32>(3));
    assert_eq!(bytes(&device[count as usize..]), bytes(&grad[count as usize..]), "gradients behind the image");
    assert_eq!(bytes(&parts[NUMBERS * groups as usize..]), buffers[3][4 * NUMBERS * groups as usize..], "more parts");
    let by_twin = outcome.twin::<f32>(3);
    for group in 0..groups {
        let (mut want, mut size) = ([0.0; NUMBERS], [0.0; NUMBERS]);
        for i in (group * PIXELS..((group + 1) * PIXELS).min(count)).map(|i| i as usize) {
            let (c, g) = (wide(rgb(image[i])), wide(rgb(grad[i])));
            let of_image = twin::backward(&e, c, g, &mut want);
            twin::backward(&e, c, g.map(f64::abs), &mut size);
            for k in 0..3 {
                close(device[i][k], of_image[k], 12.0 * EPS * 1e-4, "gradient of the image");
            }
            assert_eq!(device[i][3], 0.0);
        }
        for k in 0..NUMBERS {
            // 16 terms in a thread and 64 threads, each sum rounded once.
            let (at, bound) = (NUMBERS * group as usize + k, 82.0 * EPS * size[k]);
            close(parts[at], want[k], bound, "sum");
            close(by_twin[at], want[k], bound, "sum by the twin");
        }
    }
}

/// Steps of several photographs in turn.
fn steps(gpu: &Gpu, random: &mut Random, views: usize, parts: usize) {
    let mut rows = vec![0.0_f32; exposure::floats(views)];
    let pixels = parts as u32 * PIXELS - 5;
    for turn in 0..3 * views as u32 {
        let view = (turn * 7 + 3) % views as u32;
        let counts = [(turn + 1).min(views as u32), turn / views as u32 + 1];
        let push = StepPush::new(&AdamSettings::default(), pixels, [view, views as u32], counts, 0.01);
        assert_eq!(push.parts as usize, parts);
        let grad: Vec<f32> = (0..NUMBERS * parts).map(|_| random.between(-1e-3, 1e-3)).collect();
        let outcome = harness::run(gpu, &exposure::STEP, &[], &[bytes(&grad), bytes(&rows)], &push, 1);
        let mut want: Vec<f64> = rows.iter().map(|x| f64::from(*x)).collect();
        let sums: [f64; NUMBERS] = std::array::from_fn(|k| (0..parts).map(|i| f64::from(grad[NUMBERS * i + k])).sum());
        twin::step(&push, &sums, &mut want);
        let got = outcome.device::<f32>(1);
        for (i, (got, want)) in got.iter().zip(&want).enumerate() {
            let touched = i / ROW == view as usize || i >= ROW * views;
            if !touched {
                assert_eq!(got.to_bits(), rows[i].to_bits(), "float {i} is of another photograph");
            } else if i < ROW * views + NUMBERS {
                // Rounding may flip the sign of a sum near 0, and with the sign the step of Adam.
                let k = i % NUMBERS;
                let others = (0..views).filter(|v| *v != view as usize);
                let last = |v: usize| f64::from(rows[ROW * v + 3 * NUMBERS + k]);
                let common = (others.map(last).sum::<f64>() + sums[k]) / f64::from(counts[0]);
                let uncertain = (sums[k] - common).abs() < 1e-5;
                let bound = if uncertain { 0.08 } else { 1e-5 * want.abs() + 2e-7 };
                close(*got, *want, bound, "row");
            }
        }
        for k in 0..NUMBERS {
            let mean = (0..views).map(|v| f64::from(got[ROW * v + k]) - f64::from(got[ROW * views + k])).sum::<f64>();
            assert!(mean.abs() <= 2.0 * views as f64 * EPS, "the mean over photographs is {mean:e} off the identity");
        }
        rows = got;
    }
    // A zero gradient moves nothing, and a dispatch without workgroups does nothing.
    let push = StepPush::new(&AdamSettings::default(), pixels, [0, views as u32], [views as u32, 9], 0.01);
    let poison = vec![f32::NAN; NUMBERS * parts];
    for (grad, groups) in [(poison, 1), (vec![1.0; NUMBERS * parts], 0)] {
        let outcome = harness::run(gpu, &exposure::STEP, &[], &[bytes(&grad), bytes(&rows)], &push, groups);
        assert_eq!(bytes(&outcome.device::<f32>(1)), bytes(&rows));
        if harness::rounds_alike(gpu) {
            outcome.assert_same_bits("no step");
        }
        let (device, by_twin) = (outcome.device::<f32>(1), outcome.twin::<f32>(1));
        let mean = ROW * views;
        assert_eq!(bytes(&device[..mean]), bytes(&by_twin[..mean]), "no step");
        for (got, want) in device[mean..].iter().zip(&by_twin[mean..]) {
            // The mean is a sum in a fixed order, divided by a number, a quotient within 2.5 ulp by Vulkan.
            close(*got, f64::from(*want), 3.0 * EPS * f64::from(want.abs()), "the mean without a step");
        }
    }
}

/// Gradients in f64 against central differences of a loss that is quadratic in the exposed colours.
fn finite_differences(random: &mut Random) {
    let mut value = || f64::from(random.between(-1.0, 1.0));
    let weights: [f64; 3] = std::array::from_fn(|_| value());
    let loss = |e: &[f64; NUMBERS], c: [f64; 3]| -> f64 {
        twin::apply(e, c).iter().zip(weights).map(|(x, w)| w * x * x).sum()
    };
    for _ in 0..20 {
        let e: [f64; NUMBERS] = std::array::from_fn(|_| 0.2 * value());
        let c: [f64; 3] = std::array::from_fn(|_| value());
        let exposed = twin::apply(&e, c);
        let g = std::array::from_fn(|k| 2.0 * weights[k] * exposed[k]);
        let mut of_matrix = [0.0; NUMBERS];
        let of_colour = twin::backward(&e, c, g, &mut of_matrix);
        let h = 1e-4;
        for (k, of_matrix) in of_matrix.into_iter().enumerate() {
            let moved = |by: f64| std::array::from_fn(|i| e[i] + if i == k { by } else { 0.0 });
            let slope = (loss(&moved(h), c) - loss(&moved(-h), c)) / (2.0 * h);
            assert!((slope - of_matrix).abs() < 1e-9, "number {k}: {of_matrix} instead of {slope}");
        }
        for (k, of_colour) in of_colour.into_iter().enumerate() {
            let moved = |by: f64| std::array::from_fn(|i| c[i] + if i == k { by } else { 0.0 });
            let slope = (loss(&e, moved(h)) - loss(&e, moved(-h))) / (2.0 * h);
            assert!((slope - of_colour).abs() < 1e-9, "colour {k}: {of_colour} instead of {slope}");
        }
    }
}

pub fn run(gpu: &Gpu) {
    let mut random = Random::new(31);
    finite_differences(&mut random);
    for count in [1, 63, 64, 65, 1023, 1024, 1025, 5000] {
        over_pixels(gpu, &mut random, count);
    }
    for (views, parts) in [(1, 1), (2, 4), (5, 5), (7, 6), (23, 31)] {
        steps(gpu, &mut random, views, parts);
    }
}
