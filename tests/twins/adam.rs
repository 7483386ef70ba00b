//! `adam`: many steps against the f64 twin, rates of head and rest, gradients of all magnitudes, non-finite gradients.

use psrgs_vk::pass::adam::{AdamSettings, PASS, Push};
use psrgs_vk::twin::adam::{Element, adam};
use psrgs_vk::vk::Gpu;

use super::common::splats::seeded;
use super::harness::{self, bytes, garbage};
use super::projection_scene::{BEYOND, counts};

/// One plane with its moments, in f32.
struct Plane {
    param: Vec<f32>,
    first: Vec<f32>,
    second: Vec<f32>,
}

/// One step on the device. Checks that buffers beyond the plane keep their bits.
fn step(gpu: &Gpu, n: usize, push: &Push, grad: &[f32], plane: &mut Plane) {
    let tail = garbage(BEYOND);
    let padded = |values: &[f32]| [bytes(values), tail.clone()].concat();
    let buffers = [counts(n), padded(grad), padded(&plane.param), padded(&plane.first), padded(&plane.second)];
    let elements = n * push.row as usize;
    let outcome = harness::run(gpu, &PASS, &[], &buffers, push, elements.div_ceil(64).max(1) as u32);
    for (k, values) in [(2, &mut plane.param), (3, &mut plane.first), (4, &mut plane.second)] {
        assert_eq!(outcome.device[k][4 * elements..], tail[..], "beyond buffer {k}");
        values.copy_from_slice(&outcome.device::<f32>(k)[..elements]);
    }
}

/// Steps with new gradients; each is compared with a twin step from the device's state.
fn steps(gpu: &Gpu, n: usize, row: u32, head: u32) {
    let mut random = seeded(u64::from(row) * 100 + n as u64);
    let elements = n * row as usize;
    let mut plane = Plane {
        param: (0..elements).map(|_| random.symmetric() as f32).collect(),
        first: vec![0.0; elements],
        second: vec![0.0; elements],
    };
    let scale: Vec<f64> = (0..elements).map(|_| 10f64.powf(random.range(-9.0, 3.0))).collect();
    for t in 1..=12 {
        let push = Push::new(&AdamSettings::default(), t, row, head, 2.5e-3, 1.25e-4);
        let grad: Vec<f32> = scale.iter().map(|s| (s * random.symmetric()) as f32).collect();
        let before = (plane.param.clone(), plane.first.clone(), plane.second.clone());
        step(gpu, n, &push, &grad, &mut plane);
        for (i, &g) in grad.iter().enumerate() {
            let in_head = (i as u32) % row < head;
            let lr = f64::from(if in_head { push.lr_head } else { push.lr_rest });
            let mut want = (f64::from(before.0[i]), f64::from(before.1[i]), f64::from(before.2[i]));
            let element = Element { param: &mut want.0, first: &mut want.1, second: &mut want.2 };
            adam(&push, lr, f64::from(g), element);
            let close = |got: f32, want: f64, bound: f64| (f64::from(got) - want).abs() <= bound;
            let eps = f64::from(f32::EPSILON);
            // Sums may cancel: the bound is relative to the size of the terms.
            let terms = f64::from(before.1[i]).abs() + f64::from(g).abs();
            assert!(close(plane.first[i], want.1, eps * terms), "first {i} at {t}");
            assert!(close(plane.second[i], want.2, 2.0 * eps * want.2 + 1e-37), "second {i} at {t}");
            let (moved, here) = ((want.0 - f64::from(before.0[i])).abs(), want.0.abs());
            let bound = eps * here + 16.0 * eps * (moved + lr * terms / want.2.sqrt().max(1e-19));
            assert!(close(plane.param[i], want.0, bound), "param {i} at {t}: {} against {}", plane.param[i], want.0);
            // An element's first step is its rate times the gradient's sign.
            if t == 1 && g.abs() > 1e-9 {
                assert!((moved / lr - 1.0).abs() < 1e-4, "element {i} of rows of {row} moved by {moved}, rate {lr}");
            }
        }
    }
}

/// Constant gradients from 1e-25 to 1e+5, and non-finite ones: no step exceeds Adam's bound, and non-finite gradients
/// move nothing.
fn magnitudes(gpu: &Gpu) {
    let settings = AdamSettings::default();
    let grad: Vec<f32> = (-25..=18)
        .map(|e| 10f64.powi(e) as f32)
        .chain((-25..=18).map(|e| -10f64.powi(e) as f32))
        .chain([0.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -1e30])
        .collect();
    let n = grad.len();
    let mut plane = Plane { param: vec![0.0; n], first: vec![0.0; n], second: vec![0.0; n] };
    // Rows born late start with zero moments at a high step count: the first step is 0.1 / sqrt(0.001) = 3.2 rates, and
    // later steps are at most (1 - 0.9^k) / sqrt(1 - 0.999^k) <= 6.6 rates.
    for start in [1, 30_000] {
        let mut last = plane.param.clone();
        for t in start..start + 10 {
            step(gpu, n, &Push::new(&settings, t, 1, 0, 1.0, 1e-3), &grad, &mut plane);
            for (i, g) in grad.iter().enumerate() {
                let moved = plane.param[i] - last[i];
                let longest = match (start, t - start) {
                    (1, _) => 1.01e-3,
                    (_, 0) => 3.2e-3,
                    _ => 6.6e-3,
                };
                assert!(moved.is_finite() && moved.abs() <= longest, "gradient {g:e} moved by {moved:e} at step {t}");
                if *g == 0.0 || !g.is_finite() || g.abs() > 4e18 {
                    assert_eq!((moved, plane.first[i], plane.second[i]), (0.0, 0.0, 0.0), "gradient {g:e}");
                } else if g.abs() > 1e-12 {
                    assert!(moved * g < 0.0 && moved.abs() > 0.9e-3, "gradient {g:e} moved by {moved:e} at step {t}");
                }
            }
            last.clone_from(&plane.param);
        }
        plane = Plane { param: vec![0.0; n], first: vec![0.0; n], second: vec![0.0; n] };
    }
    // Nonzero moments, then a non-finite gradient: parameter and moments keep their bits.
    let mut busy = Plane { param: vec![0.5; n], first: vec![0.25; n], second: vec![0.125; n] };
    step(gpu, n, &Push::new(&settings, 9, 1, 0, 1.0, 1e-3), &grad, &mut busy);
    for (i, g) in grad.iter().enumerate().filter(|(_, g)| !g.is_finite() || g.abs() > 4e18) {
        assert_eq!((busy.param[i], busy.first[i], busy.second[i]), (0.5, 0.25, 0.125), "gradient {g:e}");
    }
}

pub fn run(gpu: &Gpu) {
    for n in [0, 1, 21, 22, 64, 65, 200] {
        steps(gpu, n, 3, 0);
    }
    steps(gpu, 130, 12, 3);
    steps(gpu, 130, 4, 4);
    steps(gpu, 64, 1, 0);
    magnitudes(gpu);
}
