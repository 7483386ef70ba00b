//! The passes of the image loss against their twins, and their chain against the definition with all 121 taps in f64.

use psrgs_vk::pass::loss::{self as passes, Push, SumPush};
use psrgs_vk::twin::loss::{Loss, loss, unpack};
use psrgs_vk::vk::{Gpu, Groups, Memory};

use super::guards::Guards;
use super::harness::{self, Random, bytes, garbage};

struct Pictures {
    name: &'static str,
    width: usize,
    height: usize,
    image: Vec<[f32; 4]>,
    target: Vec<u32>,
}

fn pictures(
    name: &'static str,
    width: usize,
    height: usize,
    mut pixel: impl FnMut(usize, usize) -> ([f32; 3], [u8; 3]),
) -> Pictures {
    let (mut image, mut target) = (Vec::new(), Vec::new());
    for y in 0..height {
        for x in 0..width {
            let ([r, g, b], [p, q, s]) = pixel(x, y);
            image.push([r, g, b, 0.25]);
            target.push(u32::from_le_bytes([p, q, s, 200]));
        }
    }
    Pictures { name, width, height, image, target }
}

/// The whole loss on the device, as training records it.
fn on_device(gpu: &Gpu, p: &Pictures, lambda: f32) -> (Vec<f32>, Vec<f32>) {
    let (width, height) = (p.width as u32, p.height as u32);
    let make = |name: &str, content: &[u8]| {
        let buffer = gpu.buffer(name, content.len() as u64, Memory::Device).unwrap();
        gpu.write(&buffer, content).unwrap();
        buffer
    };
    let pixels = p.image.len();
    let (image, target) = (make("image", &bytes(&p.image)), make("target", &bytes(&p.target)));
    let (planes, grad) = (make("planes", &garbage(4 * pixels)), make("grad_image", &garbage(4 * pixels)));
    let (ssim_count, l1_count) = (passes::ssim_parts(width), passes::l1_parts(width, height));
    let ssim = make("ssim_parts", &garbage(ssim_count as usize));
    let l1 = make("l1_parts", &garbage(l1_count as usize));
    let ring = make("loss", &garbage(12));
    let [rows, columns, gradient, sum] =
        [passes::ROWS, passes::COLUMNS, passes::GRAD, passes::SUM].map(|pass| gpu.pipeline(&pass.kernel, &[]).unwrap());
    let mut rec = gpu.recorder("loss").unwrap();
    let runs = Groups::Items(u64::from(passes::runs(width, height)));
    for channel in 0..3 {
        let push = Push { width, height, channel, lambda };
        rec.dispatch(&rows, &[&image, &target, &planes], &push, runs).unwrap();
        rec.dispatch(&columns, &[&planes, &ssim], &push, Groups::Items(u64::from(width))).unwrap();
        rec.dispatch(&gradient, &[&image, &target, &planes, &grad, &l1], &push, runs).unwrap();
    }
    let push = SumPush { width, height, ssim_count, l1_count, slot: 1, lambda };
    rec.dispatch(&sum, &[&ssim, &l1, &ring], &push, Groups::Workgroups(1)).unwrap();
    rec.submit().unwrap();
    let slots: Vec<f32> = gpu.read(&ring).unwrap();
    let untouched: Vec<f32> = bytemuck::pod_collect_to_vec(&garbage(12));
    for k in [0, 1, 2, 3, 7, 8, 11] {
        assert_eq!(slots[k].to_bits(), untouched[k].to_bits(), "{}: word {k} of the ring was touched", p.name);
    }
    (slots[4..7].to_vec(), gpu.read(&grad).unwrap())
}

fn reference(p: &Pictures, lambda: f32) -> Loss<f64> {
    let image: Vec<[f64; 4]> = p.image.iter().map(|v| v.map(f64::from)).collect();
    loss(&image, &unpack::<f64>(&p.target), p.width, p.height, f64::from(lambda))
}

fn chain(gpu: &Gpu, p: &Pictures, lambda: f32, accuracy: f64) {
    let ([total, l1, ssim], grad) = match on_device(gpu, p, lambda) {
        (values, grad) => ([values[0], values[1], values[2]].map(f64::from), grad),
    };
    let want = reference(p, lambda);
    let near = |what: &str, got: f64, want: f64| {
        assert!((got - want).abs() <= accuracy, "{} {what}: {got} instead of {want}", p.name);
    };
    near("SSIM", ssim, want.ssim);
    near("L1", l1, want.l1);
    near("loss", total, want.total);
    // One row: rounding of one pixel is judged against the picture's largest gradient.
    let flat: Vec<f64> = want.grad.iter().flatten().copied().collect();
    let bound = if flat.iter().all(|g| *g == 0.0) { 0.0 } else { 2e-4 };
    Guards::of(bound).check(&format!("{}: gradient", p.name), flat.len(), &grad, &flat);
}

fn passes_against_twins(gpu: &Gpu, random: &mut Random, width: usize, height: usize) {
    let pixels = width * height;
    let image: Vec<f32> = (0..4 * pixels).map(|_| random.between(0.0, 1.0)).collect();
    let target = random.words(pixels);
    let planes: Vec<f32> = (0..4 * pixels).map(|_| random.between(0.1, 0.6)).collect();
    let (w, h) = (width as u32, height as u32);
    let close = |what: &str, outcome: &harness::Outcome, buffer: usize, bound: f32| {
        let (device, twin) = (outcome.device::<f32>(buffer), outcome.twin::<f32>(buffer));
        for (k, (d, t)) in device.iter().zip(&twin).enumerate() {
            let same = d.to_bits() == t.to_bits() || (d - t).abs() <= bound * t.abs().max(1.0);
            assert!(same, "{what} {width}x{height}: word {k} of buffer {buffer} is {d}, twin {t}");
        }
    };
    for channel in 0..3 {
        let push = Push { width: w, height: h, channel, lambda: 0.2 };
        let groups = passes::runs(w, h).div_ceil(8);
        let run = |pass, buffers: &[Vec<u8>], groups| harness::run(gpu, pass, &[], buffers, &push, groups);
        let rows = run(&passes::ROWS, &[bytes(&image), bytes(&target), garbage(4 * pixels)], groups);
        close("rows", &rows, 2, 2e-6);
        let moments = rows.device[2].clone();
        let columns = run(&passes::COLUMNS, &[moments, garbage(3 * width)], w.div_ceil(8));
        // Derivatives go up to 2 / C2.
        close("columns", &columns, 0, 2e-4);
        close("columns", &columns, 1, 1e-4);
        let buffers = [
            bytes(&image),
            bytes(&target),
            bytes(&planes),
            garbage(4 * pixels),
            garbage(3 * passes::runs(w, h) as usize),
        ];
        let grad = run(&passes::GRAD, &buffers, groups);
        close("grad", &grad, 3, 1e-6);
        close("grad", &grad, 4, 1e-5);
    }
}

pub fn run(gpu: &Gpu) {
    let mut random = Random(3);
    for (width, height) in [(1, 1), (8, 8), (63, 9), (64, 11), (65, 3), (130, 17)] {
        passes_against_twins(gpu, &mut random, width, height);
    }
    let mut sum_random = Random(4);
    let parts: Vec<f32> = (0..1000).map(|_| sum_random.between(0.0, 60.0)).collect();
    let push = SumPush { width: 100, height: 50, ssim_count: 300, l1_count: 1000, slot: 2, lambda: 0.3 };
    let outcome = harness::run(gpu, &passes::SUM, &[], &[bytes(&parts), bytes(&parts), garbage(16)], &push, 1);
    for (d, t) in outcome.device::<f32>(2).iter().zip(outcome.twin::<f32>(2)) {
        assert!(d.to_bits() == t.to_bits() || (d - t).abs() <= 2e-6 * t.abs(), "sum: {d} instead of {t}");
    }

    for (width, height) in [(1, 1), (5, 3), (11, 11), (64, 7), (75, 30)] {
        let noise = pictures("noise", width, height, |_, _| {
            let w = random.word().to_le_bytes();
            ([random.between(0.0, 1.0), random.between(0.0, 1.2), random.between(-0.1, 1.0)], [w[0], w[1], w[2]])
        });
        for lambda in [0.0, 0.2, 1.0] {
            chain(gpu, &noise, lambda, 2e-6);
        }
        let alike = pictures("alike", width, height, |x, y| {
            let v = ((x * 37 + y * 11) % 256) as u8;
            let near = (f32::from(v) / 255.0 + random.between(-0.02, 0.02)).clamp(0.0, 1.0);
            ([near; 3], [v; 3])
        });
        chain(gpu, &alike, 0.2, 2e-6);
    }
    let bright = pictures("near-flat bright", 70, 40, |_, _| {
        let v = 229 + (random.word() % 2) as u8;
        ([0.9 + random.between(-0.5, 0.5) / 255.0; 3], [v; 3])
    });
    chain(gpu, &bright, 0.2, 1e-6);
    chain(gpu, &bright, 1.0, 1e-5);
    for value in [0u8, 1, 128, 230, 255] {
        let equal = pictures("equal and flat", 33, 20, |_, _| ([f32::from(value) / 255.0; 3], [value; 3]));
        let (values, grad) = on_device(gpu, &equal, 0.2);
        assert_eq!(values[2], 1.0, "SSIM of equal pictures of {value}");
        assert_eq!(values[0], 0.0);
        assert!(grad.iter().all(|g| *g == 0.0), "gradient of equal pictures of {value}");
    }
    let textured = pictures("equal and textured", 40, 33, |x, y| {
        let v = ((x * 97 + y * 31) % 256) as u8;
        ([f32::from(v) / 255.0; 3], [v; 3])
    });
    let (values, grad) = on_device(gpu, &textured, 0.2);
    assert_eq!(values[2], 1.0);
    assert!(grad.iter().all(|g| *g == 0.0), "gradient of equal textured pictures");
    let (first, second) = (on_device(gpu, &bright, 0.2), on_device(gpu, &bright, 0.2));
    assert!(first == second, "two runs differ");
}

/// The gradient of the definition against central differences.
#[test]
fn loss_twin_gradient_is_its_derivative() {
    let mut random = Random(8);
    let (width, height) = (9, 7);
    let mut draw = || f64::from(random.between(0.0, 1.0));
    let image: Vec<[f64; 4]> = (0..width * height).map(|_| [draw(), draw(), draw(), 0.0]).collect();
    let photo: Vec<[f64; 3]> = (0..width * height).map(|_| [draw(), draw(), draw()]).collect();
    let value = |image: &[[f64; 4]]| loss(image, &photo, width, height, 0.4).total;
    let grad = loss(&image, &photo, width, height, 0.4).grad;
    let h = 1e-6;
    for k in 0..width * height {
        for c in 0..3 {
            let at = |h: f64| {
                let mut moved = image.clone();
                moved[k][c] += h;
                value(&moved)
            };
            let want = (at(h) - at(-h)) / (2.0 * h);
            assert!((grad[k][c] - want).abs() < 1e-8, "pixel {k} channel {c}: {} instead of {want}", grad[k][c]);
        }
    }
}
