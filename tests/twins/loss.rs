//! The passes of the image loss against their twins, and the chain of passes against the definition with all 121 taps
//! in f64.

use psrgs_vk::pass::Pass;
use psrgs_vk::pass::loss::{self as passes, LossLayout, Push, SumPush};
use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::loss::{Loss, counting, unpack, weighted_loss};
use psrgs_vk::vk::{Gpu, Groups, Memory, Subgroup};

use super::common::guards::Guards;
use super::harness::{self, Words, bytes, garbage};

pub struct Pictures {
    pub name: &'static str,
    pub width: usize,
    pub height: usize,
    pub image: Vec<[f32; 4]>,
    pub target: Vec<u32>,
    /// Bits of a channel of the target.
    pub bits: u32,
}

impl Pictures {
    /// The pictures with 16 bits per channel: 257 times the 8-bit value, which is the same colour, plus `lower`.
    fn deep(&self, mut lower: impl FnMut() -> u32) -> Self {
        let wide = |v: u8, lower: u32| (257 * u32::from(v) + lower).min(0xffff);
        let mut words = |p: [u8; 4]| {
            let [r, g, b] = [p[0], p[1], p[2]].map(|v| wide(v, lower()));
            [r | g << 16, b | (257 * u32::from(p[3])) << 16]
        };
        let target = self.target.iter().map(|t| t.to_le_bytes()).flat_map(&mut words).collect();
        Self { name: self.name, width: self.width, height: self.height, image: self.image.clone(), target, bits: 16 }
    }
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
    Pictures { name, width, height, image, target, bits: 8 }
}

/// Width of the subgroup, and which passes: the hardware's, or the emulated ones, which run everywhere.
#[derive(Clone, Copy, PartialEq)]
pub enum With {
    /// All channels in a subgroup.
    Together(u32),
    /// A channel of a strip per subgroup.
    Apart(u32),
    Emulated(u32),
}

impl With {
    pub fn all(gpu: &Gpu) -> Vec<Self> {
        let mut all = vec![Self::Emulated(64), Self::Emulated(32), Self::Emulated(8)];
        if let Subgroup::Hardware(width) = gpu.caps().subgroup {
            all.extend([Self::Together(width), Self::Apart(width)]);
        }
        all
    }

    /// Whether training uses this width. 16 bits are tested with such widths alone: pipelines take long to make.
    pub fn is_of_training(self) -> bool {
        !matches!(self, Self::Emulated(width) if width != passes::EMULATED_LANES)
    }

    fn lanes(self) -> u32 {
        match self {
            Self::Together(width) | Self::Apart(width) | Self::Emulated(width) => width,
        }
    }

    fn apart(self) -> u32 {
        if matches!(self, Self::Together(_)) { 1 } else { 3 }
    }

    fn layout(self, width: usize, height: usize, segment: u32) -> LossLayout {
        LossLayout { segment, apart: self.apart(), ..LossLayout::new(width as u32, height as u32, self.lanes()) }
    }

    fn passes(self) -> [&'static Pass; 2] {
        match self {
            Self::Together(_) => [&passes::STRIPS_SUBGROUP, &passes::GRAD_SUBGROUP],
            Self::Apart(_) => [&passes::STRIPS_APART, &passes::GRAD_APART],
            Self::Emulated(_) => [&passes::STRIPS_EMULATED, &passes::GRAD_EMULATED],
        }
    }

    fn constant(self) -> (&'static str, u32) {
        match self {
            Self::Together(width) | Self::Apart(width) => ("LOCAL_SIZE", width),
            Self::Emulated(width) => ("EMULATED_WIDTH", width),
        }
    }

    /// Constants of the gradient, but for `bits` and `weighted`.
    fn of_grad(self, segment: u32) -> Vec<(&'static str, u32)> {
        let mut given = vec![self.constant()];
        given.extend((self.apart() > 1).then_some(("SEGMENT", segment)));
        given
    }

    fn local_size(self) -> u32 {
        match self {
            Self::Together(width) | Self::Apart(width) => width,
            Self::Emulated(_) => passes::EMULATED_LOCAL_SIZE,
        }
    }
}

/// Weights of saliency 0 and 1, where pixels have a saliency.
pub type Weights = Option<[f32; 2]>;

/// The whole loss on the device, as in training.
pub fn on_device(gpu: &Gpu, with: With, p: &Pictures, lambda: f32, weights: Weights) -> (Vec<f32>, Vec<f32>) {
    let layout = with.layout(p.width, p.height, 16);
    let (width, height) = (layout.width, layout.height);
    let make = |name: &str, content: &[u8]| {
        let buffer = gpu.buffer(name, content.len() as u64, Memory::Device).unwrap();
        gpu.write(&buffer, content).unwrap();
        buffer
    };
    let pixels = p.image.len();
    let (image, target) = (make("image", &bytes(&p.image)), make("target", &bytes(&p.target)));
    let planes = ["red_planes", "green_planes", "blue_planes"].map(|name| make(name, &garbage(3 * pixels)));
    let grad = make("grad_image", &garbage(4 * pixels));
    let saliency = make("saliency", &bytes(&saliency(pixels)));
    let ssim = make("ssim_parts", &garbage(layout.ssim_parts() as usize));
    let l1 = make("l1_parts", &garbage(layout.l1_parts() as usize));
    let ring = make("loss", &garbage(12));
    let [strips, gradient] = with.passes();
    let (bits, weighted) = (("PHOTOGRAPH_BITS", p.bits), ("WEIGHTED", u32::from(weights.is_some())));
    let strips = gpu.pipeline(&strips.kernel, &[with.constant(), ("SEGMENT", layout.segment), bits, weighted]).unwrap();
    let given = [with.of_grad(layout.segment), vec![bits, weighted]].concat();
    let gradient = gpu.pipeline(&gradient.kernel, &given).unwrap();
    let sum = gpu.pipeline(&passes::SUM.kernel, &[]).unwrap();
    let masked = counting(&p.target, p.bits).into_iter().filter(|counts| !counts).count() as u32;
    let values = passes::values(width, height, masked);
    let [low_weight, high_weight] = weights.unwrap_or([f32::NAN; 2]);
    let push = Push { width, height, lambda, values, low_weight, high_weight };
    let [red, green, blue] = &planes;
    let mut rec = gpu.recorder("loss").unwrap();
    let groups = Groups::Items(layout.strip_threads());
    rec.dispatch(&strips, &[&image, &target, red, green, blue, &ssim, &saliency], &push, groups).unwrap();
    let groups = Groups::Items(layout.grad_threads());
    rec.dispatch(&gradient, &[&image, &target, red, green, blue, &grad, &l1, &saliency], &push, groups).unwrap();
    let (ssim_count, l1_count) = (layout.ssim_parts(), layout.l1_parts());
    let push = SumPush { values, ssim_count, l1_count, slot: 1, lambda };
    rec.dispatch(&sum, &[&ssim, &l1, &ring], &push, Groups::Workgroups(1)).unwrap();
    rec.submit().unwrap();
    let slots: Vec<f32> = gpu.read(&ring).unwrap();
    let untouched: Vec<f32> = bytemuck::pod_collect_to_vec(&garbage(12));
    for k in [0, 1, 2, 3, 7, 8, 11] {
        assert_eq!(slots[k].to_bits(), untouched[k].to_bits(), "{}: word {k} of the ring was touched", p.name);
    }
    (slots[4..7].to_vec(), gpu.read(&grad).unwrap())
}

/// Values from 0 to 1, different from one pixel to the next.
fn saliency(pixels: usize) -> Vec<f32> {
    (0..pixels).map(|k| (k * 29 % 101) as f32 / 100.0).collect()
}

fn reference(p: &Pictures, lambda: f32, weights: Weights) -> Loss<f64> {
    let image: Vec<[f64; 4]> = p.image.iter().map(|v| v.map(f64::from)).collect();
    let [low, high] = weights.unwrap_or([1.0; 2]).map(f64::from);
    let of: Vec<f64> = saliency(image.len()).into_iter().map(|s| low + (high - low) * f64::from(s)).collect();
    let (photo, counts) = (unpack::<f64>(&p.target, p.bits), counting(&p.target, p.bits));
    weighted_loss(&image, &photo, &counts, &of, (p.width, p.height), f64::from(lambda))
}

fn chain(gpu: &Gpu, with: With, p: &Pictures, lambda: f32, accuracy: f64) {
    weighted_chain(gpu, with, p, lambda, accuracy, None);
}

fn weighted_chain(gpu: &Gpu, with: With, p: &Pictures, lambda: f32, accuracy: f64, weights: Weights) {
    let (values, grad) = on_device(gpu, with, p, lambda, weights);
    let [total, l1, ssim] = [values[0], values[1], values[2]].map(f64::from);
    let want = reference(p, lambda, weights);
    let near = |what: &str, got: f64, want: f64| {
        assert!((got - want).abs() <= accuracy, "{} {what}: {got} instead of {want}", p.name);
    };
    near("SSIM", ssim, want.ssim);
    near("L1", l1, want.l1);
    near("loss", total, want.total);
    // As one row: rounding of a pixel is judged against the picture's largest gradient.
    let flat: Vec<f64> = want.grad.iter().flatten().copied().collect();
    let bound = if flat.iter().all(|g| *g == 0.0) { 0.0 } else { 2e-4 };
    Guards::of(bound).check(&format!("{}: gradient", p.name), flat.len(), &grad, &flat);
}

fn passes_against_twins(gpu: &Gpu, with: With, random: &mut Random, (width, height): (usize, usize), bits: u32) {
    let pixels = width * height;
    let image: Vec<f32> = (0..4 * pixels).map(|_| random.between(0.0, 1.0)).collect();
    let target = random.words(pixels * bits as usize / 8);
    let planes: Vec<f32> = (0..3 * pixels).map(|_| random.between(0.1, 0.6)).collect();
    let close = |what: &str, outcome: &harness::Outcome, buffer: usize, bound: f32| {
        let (device, twin) = (outcome.device::<f32>(buffer), outcome.twin::<f32>(buffer));
        for (k, (d, t)) in device.iter().zip(&twin).enumerate() {
            let same = d.to_bits() == t.to_bits() || (d - t).abs() <= bound * t.abs().max(1.0);
            assert!(same, "{what} {width}x{height}: word {k} of buffer {buffer} is {d}, twin {t}");
        }
    };
    let layout = with.layout(width, height, 7);
    let values = 2.5 * pixels as f32;
    let push =
        Push { width: layout.width, height: layout.height, lambda: 0.2, values, low_weight: 0.25, high_weight: 1.5 };
    let saliency = || bytes(&saliency(pixels));
    let groups = |threads: u64| threads.div_ceil(u64::from(with.local_size())) as u32;
    let [strips, grad] = with.passes();
    let empty = || garbage(3 * pixels);
    let parts = garbage(layout.ssim_parts() as usize);
    let buffers = [bytes(&image), bytes(&target), empty(), empty(), empty(), parts, saliency()];
    let weighted = ("WEIGHTED", u32::from(with.is_of_training()));
    let bits = ("PHOTOGRAPH_BITS", bits);
    let given = [with.constant(), ("SEGMENT", 7), bits, weighted];
    let outcome = harness::run(gpu, strips, &given, &buffers, &push, groups(layout.strip_threads()));
    for plane in 2..5 {
        // Derivatives go up to 2 / C2, and B carries the rounding of about 1 in E[x^2 + y^2] over C2.
        close("strips", &outcome, plane, 2e-4);
    }
    close("strips", &outcome, 5, 1e-4);
    let parts = garbage(layout.l1_parts() as usize);
    let plane = || bytes(&planes);
    let grads = garbage(4 * pixels);
    let buffers = [bytes(&image), bytes(&target), plane(), plane(), plane(), grads, parts, saliency()];
    let given = [with.of_grad(7), vec![bits, weighted]].concat();
    let outcome = harness::run(gpu, grad, &given, &buffers, &push, groups(layout.grad_threads()));
    close("grad", &outcome, 5, 1e-6);
    close("grad", &outcome, 6, 1e-5);
}

pub fn run(gpu: &Gpu) {
    let mut sum_random = Random::new(4);
    let parts: Vec<f32> = (0..1000).map(|_| sum_random.between(0.0, 60.0)).collect();
    let push = SumPush { values: 12_345.0, ssim_count: 300, l1_count: 1000, slot: 2, lambda: 0.3 };
    for threads in [passes::SUM_THREADS, 4 * passes::SUM_THREADS] {
        let given = [("LOCAL_SIZE", threads)];
        let buffers = [bytes(&parts), bytes(&parts), garbage(16)];
        let outcome = harness::run(gpu, &passes::SUM, &given, &buffers, &push, 1);
        for (d, t) in outcome.device::<f32>(2).iter().zip(outcome.twin::<f32>(2)) {
            assert!(d.to_bits() == t.to_bits() || (d - t).abs() <= 2e-6 * t.abs(), "sum: {d} instead of {t}");
        }
    }
    for with in With::all(gpu) {
        run_with(gpu, with);
    }
}

fn run_with(gpu: &Gpu, with: With) {
    let mut random = Random::new(3);
    for size in [(1, 1), (8, 8), (31, 9), (32, 7), (33, 15), (65, 3)] {
        passes_against_twins(gpu, with, &mut random, size, 8);
    }
    if with.is_of_training() {
        for size in [(1, 1), (33, 15), (65, 3)] {
            passes_against_twins(gpu, with, &mut random, size, 16);
        }
    }
    for (width, height) in [(1, 1), (5, 3), (11, 11), (64, 7), (75, 37)] {
        let noise = pictures("noise", width, height, |_, _| {
            let w = random.word().to_le_bytes();
            ([random.between(0.0, 1.0), random.between(0.0, 1.2), random.between(-0.1, 1.0)], [w[0], w[1], w[2]])
        });
        for lambda in [0.0, 0.2, 1.0] {
            chain(gpu, with, &noise, lambda, 2e-6);
            if with.is_of_training() {
                weighted_chain(gpu, with, &noise, lambda, 2e-6, Some([0.3, 1.0]));
            }
        }
        let alike = pictures("alike", width, height, |x, y| {
            let v = ((x * 37 + y * 11) % 256) as u8;
            let near = (f32::from(v) / 255.0 + random.between(-0.02, 0.02)).clamp(0.0, 1.0);
            ([near; 3], [v; 3])
        });
        chain(gpu, with, &alike, 0.2, 2e-6);
    }
    let bright = pictures("near-flat bright", 70, 40, |_, _| {
        let v = 229 + (random.word() % 2) as u8;
        ([0.9 + random.between(-0.5, 0.5) / 255.0; 3], [v; 3])
    });
    chain(gpu, with, &bright, 0.2, 1e-6);
    chain(gpu, with, &bright, 1.0, 1e-5);
    for value in [0u8, 1, 128, 230, 255] {
        let equal = pictures("equal and flat", 33, 20, |_, _| ([f32::from(value) / 255.0; 3], [value; 3]));
        let (values, grad) = on_device(gpu, with, &equal, 0.2, None);
        assert_no_loss(gpu, &values, &format!("equal pictures of {value}"));
        assert!(grad.iter().all(|g| *g == 0.0), "gradient of equal pictures of {value}");
    }
    let textured = pictures("equal and textured", 40, 33, |x, y| {
        let v = ((x * 97 + y * 31) % 256) as u8;
        ([f32::from(v) / 255.0; 3], [v; 3])
    });
    let (values, grad) = on_device(gpu, with, &textured, 0.2, None);
    assert_no_loss(gpu, &values, "equal textured pictures");
    assert!(grad.iter().all(|g| *g == 0.0), "gradient of equal textured pictures");
    masked_pixels_have_no_part(gpu, with, &mut random);
    let (first, second) = (on_device(gpu, with, &bright, 0.2, None), on_device(gpu, with, &bright, 0.2, None));
    assert!(first == second, "two runs differ");
}

/// Checks the values (total, L1, SSIM) of equal pictures. SSIM is exactly 1 at each pixel. The mean is exactly 1 where
/// the device rounds quotients correctly; Vulkan promises 2.5 ulp.
fn assert_no_loss(gpu: &Gpu, values: &[f32], what: &str) {
    let off = if harness::rounds_alike(gpu) { 0.0 } else { 2.5 * f32::EPSILON };
    assert!((values[2] - 1.0).abs() <= off && values[0].abs() <= off, "{what}: {values:?}");
    assert_eq!(values[1], 0.0, "{what}: L1");
}

/// Masked pixels against the definition, whatever the render shows there. Alphas other than 0 make no difference.
fn masked_pixels_have_no_part(gpu: &Gpu, with: With, random: &mut Random) {
    for (width, height) in [(9, 5), (33, 20), (75, 37)] {
        let mut noise = pictures("masked", width, height, |_, _| {
            let w = random.word().to_le_bytes();
            ([random.between(0.0, 1.0), random.between(0.0, 1.0), random.between(0.0, 1.0)], [w[0], w[1], w[2]])
        });
        let before = on_device(gpu, with, &noise, 0.2, None);
        noise.target.iter_mut().enumerate().for_each(|(k, t)| *t = *t & 0xff_ffff | (1 + k as u32 % 255) << 24);
        assert!(before == on_device(gpu, with, &noise, 0.2, None), "an alpha that is not 0 changed the loss");
        // A border, a block and single pixels.
        let outside = |x: usize, y: usize| x < 2 || y + 3 > height || (width / 2..width / 2 + 6).contains(&x) && y > 1;
        for k in 0..width * height {
            if outside(k % width, k / width) || k % 11 == 3 {
                noise.target[k] &= 0xff_ffff;
                noise.image[k] = [f32::NAN, 1e30, -7.0, 0.0];
            }
        }
        let (_, grad) = on_device(gpu, with, &noise, 0.2, None);
        for (k, t) in noise.target.iter().enumerate().filter(|(_, t)| **t >> 24 == 0) {
            assert_eq!(grad[4 * k..4 * k + 4], [0.0; 4], "gradient at masked pixel {k}, {t:x}");
        }
        for lambda in [0.0, 0.2, 1.0] {
            chain(gpu, with, &noise, lambda, 2e-6);
        }
        if with.is_of_training() && (with != With::Emulated(passes::EMULATED_LANES) || !has_hardware(gpu)) {
            sixteen_bits_are_eight_where_they_say_the_same(gpu, with, &noise, random);
        }
    }
}

fn has_hardware(gpu: &Gpu) -> bool {
    matches!(gpu.caps().subgroup, Subgroup::Hardware(_))
}

/// 65535 = 255 * 257, so correctly rounded quotients give equal colours and equal bits of the loss. With other low bits
/// the pictures differ, and the loss follows the definition.
fn sixteen_bits_are_eight_where_they_say_the_same(gpu: &Gpu, with: With, eight: &Pictures, random: &mut Random) {
    let (values, grad) = on_device(gpu, with, eight, 0.2, None);
    let (wide_values, wide_grad) = on_device(gpu, with, &eight.deep(|| 0), 0.2, None);
    for (got, want) in wide_values.iter().zip(&values) {
        assert!((got - want).abs() <= 2e-6, "{}: {got} with 16 bits, {want} with 8", eight.name);
    }
    let flat: Vec<f64> = grad.iter().map(|g| f64::from(*g)).collect();
    Guards::of(2e-4).check("gradient with 16 bits", flat.len(), &wide_grad, &flat);
    let deep = eight.deep(|| random.word() % 200);
    assert_ne!(on_device(gpu, with, &deep, 0.2, None).0, wide_values, "the low bits have no effect");
    for lambda in [0.0, 0.2, 1.0] {
        chain(gpu, with, &deep, lambda, 2e-6);
    }
}

/// The gradient of the definition against central differences.
#[test]
fn loss_twin_gradient_is_its_derivative() {
    let mut random = Random::new(8);
    let (width, height) = (9, 7);
    let mut draw = || f64::from(random.between(0.0, 1.0));
    let image: Vec<[f64; 4]> = (0..width * height).map(|_| [draw(), draw(), draw(), 0.0]).collect();
    let photo: Vec<[f64; 3]> = (0..width * height).map(|_| [draw(), draw(), draw()]).collect();
    // Every seventh pixel is masked and must not affect value and gradient.
    let counts: Vec<bool> = (0..width * height).map(|k| k % 7 != 3).collect();
    let weights: Vec<f64> = saliency(image.len()).into_iter().map(|s| 0.3 + 0.7 * f64::from(s)).collect();
    let of = |image: &[[f64; 4]]| weighted_loss(image, &photo, &counts, &weights, (width, height), 0.4);
    let (value, grad) = (|image: &[[f64; 4]]| of(image).weighted, of(&image).grad);
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
