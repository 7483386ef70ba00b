//! The gradient-map loss: each pass against its twin, the chain of passes against f64, and the twin's gradient against
//! differences of the definition.

use psrgs_vk::loss::{GradientMapLoss, GradientMapWeights, MapImages, Photograph, TextureMask};
use psrgs_vk::pass::gradient_map::{self as passes, Push};
use psrgs_vk::pass::{loss, part_sum};
use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::gradient_map::Scene;
use psrgs_vk::twin::loss::{counting, unpack};
use psrgs_vk::twin::place;
use psrgs_vk::vk::{Gpu, Memory};

use super::common::guards::Guards;
use super::harness::{self, Words, bytes, garbage};

/// A picture of waves and noise, a photograph like it, and a mask of another size.
struct View {
    push: Push,
    bits: u32,
    variation: bool,
    image: Vec<[f32; 4]>,
    other: Option<Vec<[f32; 4]>>,
    target: Vec<u32>,
    mask: Option<Vec<u8>>,
}

fn view([width, height]: [u32; 2], mask: Option<[u32; 2]>, bits: u32, variation: bool, seed: u64) -> View {
    let mut random = Random::new(seed);
    let (mut image, mut target, mut masked) = (Vec::new(), Vec::new(), 0);
    for k in 0..width * height {
        let (x, y) = ((k % width) as f32, (k / width) as f32);
        let wave = 0.5 + 0.3 * (0.7 * x).sin() * (0.4 * y + 0.02 * x * y).cos();
        let seen: [f32; 3] = std::array::from_fn(|c| wave + 0.05 * c as f32 + random.between(-0.15, 0.15));
        let [r, g, b] = seen.map(|v| (255.0 * v).clamp(0.0, 255.0) as u32);
        image.push([seen[0] * 0.8 + random.between(0.0, 0.2), seen[1] + random.between(-0.1, 0.1), seen[2], 0.3]);
        let counts = !random.word().is_multiple_of(17);
        masked += u32::from(!counts);
        match bits {
            16 => target.extend([(r * 257) | (g * 257 + 3) << 16, (b * 257) | u32::from(counts) << 16]),
            _ => target.push(r | g << 8 | b << 16 | u32::from(counts) << 24),
        }
    }
    let [mask_width, mask_height] = mask.unwrap_or([0, 0]);
    let mask = mask.map(|[w, h]| (0..(w * h).next_multiple_of(4)).map(|_| random.word() as u8).collect());
    let values = loss::values(width, height, masked);
    let push = Push { width, height, mask_width, mask_height, weight: 0.6, tv_weight: 0.4, values };
    View { push, bits, variation, image, other: None, target, mask }
}

impl View {
    /// With another render, whose waves lie elsewhere.
    fn with_other(mut self) -> Self {
        let mut random = Random::new(7);
        let moved = |row: &[f32; 4]| row.map(|v| 0.6 * v + 0.3 * v * v + random.between(0.0, 0.2));
        self.other = Some(self.image.iter().map(moved).collect());
        self
    }

    fn scene(&self) -> Scene<'_, f64> {
        let size = [self.push.mask_width as usize, self.push.mask_height as usize];
        Scene {
            push: self.push,
            variation: self.variation,
            image: self.image.iter().map(|row| row.map(f64::from)).collect(),
            photo: unpack(&self.target, self.bits),
            other: self.other.as_ref().map(|other| other.iter().map(|row| row.map(f64::from)).collect()),
            counts: counting(&self.target, self.bits),
            mask: self.mask.as_ref().map(|bytes| place::ByteMask { bytes, size }),
        }
    }
}

/// Gradient and weighted terms (correlation, variation), by the twin in f64.
fn wanted(scene: &Scene<'_, f64>) -> (Vec<[f64; 3]>, [f64; 2], [f64; 4]) {
    let pixels = scene.image.len();
    let maps: Vec<[f64; 4]> = (0..pixels).map(|k| scene.sobel(k)).collect();
    let count = passes::windows(scene.push.width, scene.push.height) as usize;
    let windows: Vec<_> = (0..count).map(|w| scene.window(&maps, w)).collect();
    let flows = Scene::flows(&maps, &windows);
    let [r, m] = windows.iter().fold([0.0; 2], |[r, m], w| [r + w.row[0], m + w.row[1]]);
    let totals = [r, m, 0.0, 0.0];
    let rows: Vec<_> = (0..pixels).map(|k| scene.grad_row(&flows, &totals, k)).collect();
    let correlation = if m > 0.0 { f64::from(scene.push.weight) * (1.0 - r / m) } else { 0.0 };
    (rows.iter().map(|row| row.1).collect(), [correlation, rows.iter().map(|row| row.0).sum()], totals)
}

fn close(what: &str, got: &[f32], want: &[f32], bound: f32) {
    let largest = want.iter().fold(0.0f32, |m, v| m.max(v.abs()));
    for (k, (g, w)) in got.iter().zip(want).enumerate() {
        let same = g.to_bits() == w.to_bits() || (g - w).abs() <= bound * (w.abs() + 1e-2 * largest);
        assert!(same, "{what}: word {k} is {g}, twin {w}");
    }
}

/// All passes on the device, each against its twin where `bound` is given. Gives the gradient of the image, added to
/// zeros, and the sums of the parts.
fn on_device(gpu: &Gpu, v: &View, what: &str, bound: Option<f32>) -> (Vec<[f32; 4]>, Vec<f32>) {
    let pixels = v.image.len();
    let (width, height) = (v.push.width, v.push.height);
    let (image, target, bits) = (bytes(&v.image), bytes(&v.target), ("PHOTOGRAPH_BITS", v.bits));
    let run = |pass, given: &[(&str, u32)], buffers: &[Vec<u8>], groups: u32, written: &[(usize, usize)]| {
        let outcome = harness::run(gpu, pass, given, buffers, &v.push, groups);
        for &(buffer, words) in written {
            let beyond = outcome.device[buffer][4 * words..] == buffers[buffer][4 * words..];
            assert!(beyond, "{what}: beyond buffer {buffer}");
            if let Some(bound) = bound {
                let (device, twin) = (outcome.device::<f32>(buffer), outcome.twin::<f32>(buffer));
                close(&format!("{what}, buffer {buffer}"), &device[..words], &twin[..words], bound);
            }
        }
        outcome
    };
    let other = v.other.as_ref().map_or_else(|| image.clone(), |other| bytes(other));
    let given = [bits, ("OTHER", u32::from(v.other.is_some()))];
    let buffers = [image.clone(), target.clone(), other, garbage(4 * pixels + 8)];
    let maps = run(&passes::SOBEL, &given, &buffers, (pixels as u32).div_ceil(64), &[(3, 4 * pixels)]);

    let count = passes::windows(width, height);
    let mask = v.mask.clone().unwrap_or(vec![0; 4]);
    let buffers = [mask, maps.device[3].clone(), garbage(4 * count as usize + 8)];
    let given = [("MASK", u32::from(v.mask.is_some()))];
    let written = [(1, 4 * pixels), (2, 4 * count as usize)];
    let windows = run(&passes::WINDOWS, &given, &buffers, count, &written);

    let sum = |parts: &[u8], count: u32| {
        let push = part_sum::Push { count, slot: 0 };
        harness::run(gpu, &part_sum::PASS, &[], &[parts.to_vec(), garbage(4)], &push, 1).device[1].clone()
    };
    let totals = sum(&windows.device[2], count);
    let parts = passes::parts(width, height);
    let before = bytes(&vec![[0.0f32, 0.0, 0.0, 0.75]; pixels]);
    let buffers = [image, target, windows.device[1].clone(), totals, before, garbage(4 * parts as usize + 8)];
    let given = [("VARIATION", u32::from(v.variation)), bits];
    let written = [(4, 4 * pixels), (5, 4 * parts as usize)];
    let grad = run(&passes::GRAD, &given, &buffers, passes::groups(width, height), &written);
    let terms = sum(&grad.device[5], parts);
    (bytemuck::pod_collect_to_vec(&grad.device[4]), bytemuck::pod_collect_to_vec(&terms))
}

/// Gradient and terms, as training records the loss.
fn composed(gpu: &Gpu, v: &View) -> (Vec<[f32; 4]>, Vec<f32>) {
    let upload = |name: &str, bytes: &[u8]| {
        let buffer = gpu.buffer(name, bytes.len() as u64, Memory::Device).unwrap();
        gpu.write(&buffer, bytes).unwrap();
        buffer
    };
    let before = bytes(&vec![[0.0f32, 0.0, 0.0, 0.75]; v.image.len()]);
    let (image, target, grad) =
        (upload("image", &bytes(&v.image)), upload("target", &bytes(&v.target)), upload("grad_image", &before));
    let mask = v.mask.as_ref().map(|mask| upload("mask", mask));
    let other = v.other.as_ref().map(|other| upload("other", &bytes(other)));
    let size = (v.push.width, v.push.height);
    let maps = GradientMapLoss::new(gpu, &[(7, 90), size]).unwrap();
    let photograph = Photograph {
        buffer: &target,
        bits: v.bits,
        size,
        values: v.push.values,
        part_values: v.push.values,
        mask: mask.as_ref().map(|buffer| TextureMask { buffer, size: (v.push.mask_width, v.push.mask_height) }),
    };
    let variation = if v.variation { v.push.tv_weight } else { 0.0 };
    let weights = GradientMapWeights { correlation: v.push.weight, variation };
    let mut rec = gpu.recorder("gradient maps").unwrap();
    let images = MapImages { image: &image, other: other.as_ref() };
    maps.record(&mut rec, images, &photograph, &weights, &grad).unwrap();
    rec.submit().unwrap();
    (gpu.read(&grad).unwrap(), gpu.read(maps.result()).unwrap())
}

fn check(gpu: &Gpu, v: &View, what: &str) {
    let (got, terms) = on_device(gpu, v, what, Some(2e-3));
    let (want, [correlation, variation], totals) = wanted(&v.scene());
    assert!(got.iter().all(|row| row[3] == 0.75), "{what}: the transmittance's gradient was touched");
    let flat: Vec<f32> = got.iter().flat_map(|row| row[..3].to_vec()).collect();
    Guards::of(1e-3).check(&format!("{what}: gradient"), flat.len(), &flat, want.as_flattened());
    let mean = if totals[1] > 0.0 { totals[0] / totals[1] } else { 0.0 };
    for (got, want) in terms.iter().zip([correlation, variation, mean, correlation + variation]) {
        assert!((f64::from(*got) - want).abs() < 1e-5, "{what}: {got} instead of {want}");
    }
    // Added to the earlier gradient, and equal in every run.
    assert!(composed(gpu, v) == (got, terms), "{what}: the recorded loss differs");
}

pub fn run(gpu: &Gpu) {
    let cases = [
        ([75, 70], Some([16, 9]), 8, true),
        ([64, 32], None, 8, true),
        ([97, 33], Some([7, 40]), 16, true),
        ([40, 50], None, 8, false),
        ([1, 1], None, 8, true),
        ([2, 9], Some([1, 1]), 8, true),
        ([3, 3], None, 16, true),
    ];
    for (k, (size, mask, bits, variation)) in cases.into_iter().enumerate() {
        let v = view(size, mask, bits, variation, 20 + k as u64);
        check(gpu, &v, &format!("{size:?}, mask {mask:?}, {bits} bits, variation {variation}"));
    }
    for (k, (size, mask, bits)) in [([75, 70], Some([16, 9]), 8), ([64, 33], None, 16)].into_iter().enumerate() {
        let v = view(size, mask, bits, false, 40 + k as u64).with_other();
        check(gpu, &v, &format!("two renders, {size:?}, mask {mask:?}, {bits} bits"));
    }
    // A zero mask, a flat photograph and a flat render: finite numbers, and no gradient of the correlation where the
    // photograph is flat.
    let mut v = view([70, 40], Some([4, 4]), 8, true, 60);
    v.mask = Some(vec![0; 16]);
    check(gpu, &v, "a mask of nothing");
    let mut v = view([70, 40], None, 8, false, 61);
    v.target.fill(0xff80_8080);
    let (grad, terms) = on_device(gpu, &v, "flat photograph", None);
    assert!(grad.iter().all(|row| row[..3].iter().all(|g| g.is_finite() && g.abs() < 1e-6)), "{:?}", grad[999]);
    assert!((terms[2]).abs() < 1e-6, "a correlation with nothing of {}", terms[2]);
    v.image.fill([0.25, 0.5, 0.75, 0.1]);
    let (grad, _) = on_device(gpu, &v, "both flat", None);
    assert!(grad.iter().all(|row| row[..3] == [0.0; 3]));
    let mut v = view([70, 40], None, 8, true, 62);
    v.image.fill([0.25, 0.5, 0.75, 0.1]);
    let (grad, terms) = on_device(gpu, &v, "flat render", None);
    assert!(grad.iter().flatten().chain(&terms).all(|g| g.is_finite()));
    // A render that equals the photograph has full correlation.
    let mut v = view([70, 40], None, 8, true, 63);
    for (p, c) in v.image.iter_mut().zip(unpack::<f32>(&v.target, 8)) {
        p[..3].copy_from_slice(&c);
    }
    let (grad, terms) = on_device(gpu, &v, "alike", None);
    assert!((terms[2] - 1.0).abs() < 1e-5 && terms[0].abs() < 1e-5, "{terms:?}");
    assert!(grad.iter().all(|row| row[..3].iter().all(|g| g.abs() < 1e-5)));
}

/// The gradient of the twin against central differences of the definition.
#[test]
fn gradient_map_twin_gradient_is_its_derivative() {
    for (mask, variation) in [(Some([4, 3]), true), (None, true), (Some([2, 2]), false)] {
        let v = view([37, 35], mask, 8, variation, 91);
        let scene = v.scene();
        let (grad, terms, _) = wanted(&scene);
        let value = scene.value();
        assert!(value[0] > 1e-3 && (value[1] > 1e-3) == variation, "{value:?}");
        for (got, want) in terms.iter().zip(value) {
            assert!((got - want).abs() < 1e-12, "{got} instead of {want}");
        }
        let (h, mut moved, mut compared) = (1e-6, scene.clone(), 0);
        for k in (0..scene.image.len()).step_by(7) {
            for (c, got) in grad[k].iter().enumerate() {
                let mut at = |h: f64| {
                    moved.image[k][c] = scene.image[k][c] + h;
                    let value: f64 = moved.value().iter().sum();
                    moved.image[k][c] = scene.image[k][c];
                    value
                };
                let want = (at(h) - at(-h)) / (2.0 * h);
                compared += usize::from(want != 0.0);
                assert!((got - want).abs() < 1e-8, "pixel {k} channel {c}: {got} is {want}");
            }
        }
        assert!(compared > 300, "{compared} compared");
    }
}

/// The correlation of two renders is the same with both exchanged, and its gradients with respect to each are its
/// derivatives.
#[test]
fn two_renders_have_the_derivatives_of_one_correlation() {
    let v = view([37, 35], None, 8, false, 92).with_other();
    let View { push, image, other, target, .. } = &v;
    let wide = |rows: &[[f32; 4]]| rows.iter().map(|row| row.map(f64::from)).collect();
    let scene: Scene<'static, f64> = Scene {
        push: *push,
        variation: false,
        image: wide(image),
        photo: unpack(target, 8),
        other: other.as_ref().map(|other| wide(other)),
        counts: counting(target, 8),
        mask: None,
    };
    let exchanged = |of: &Scene<'static, f64>| {
        let mut of = of.clone();
        of.other = Some(std::mem::replace(&mut of.image, of.other.take().expect("another render")));
        of
    };
    assert!(scene.counts.iter().any(|counts| !counts));
    let value = scene.value()[0];
    assert!(value > 1e-2 && (value - exchanged(&scene).value()[0]).abs() < 1e-12, "{value}");
    let mut photo = scene.clone();
    photo.other = None;
    assert!((photo.value()[0] - value).abs() > 1e-3, "the photograph is compared in place of the other render");
    let (of_image, of_other) = (wanted(&scene).0, wanted(&exchanged(&scene)).0);
    let mut compared = 0;
    for k in (0..scene.image.len()).step_by(7) {
        for c in 0..3 {
            let slope = |moved: &dyn Fn(&mut Scene<'static, f64>, f64)| {
                let at = |h: f64| {
                    let mut scene = scene.clone();
                    moved(&mut scene, h);
                    scene.value()[0]
                };
                (at(1e-6) - at(-1e-6)) / 2e-6
            };
            let by_image = slope(&|scene, h| scene.image[k][c] += h);
            let by_other = slope(&|scene, h| scene.other.as_mut().expect("another render")[k][c] += h);
            assert!(
                (of_image[k][c] - by_image).abs() < 1e-8,
                "pixel {k} channel {c}: {} is {by_image}",
                of_image[k][c]
            );
            assert!(
                (of_other[k][c] - by_other).abs() < 1e-8,
                "other {k} channel {c}: {} is {by_other}",
                of_other[k][c]
            );
            compared += usize::from(by_image != 0.0 && by_other != 0.0);
        }
    }
    assert!(compared > 300, "{compared} compared");
}
