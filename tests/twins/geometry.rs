//! The geometry loss: each pass against its twin, the chain of passes against the definition in f64, and the twin's
//! gradient against differences of the definition.

use psrgs_vk::pass::geometry::{self as passes, Push, pack_prior};
use psrgs_vk::pass::part_sum;
use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::geometry::{Scene, prior_normal};
use psrgs_vk::twin::loss::{counting, unpack};
use psrgs_vk::twin::place::ByteMask;
use psrgs_vk::twin::slot_sum::sum_of_parts as added;
use psrgs_vk::vk::Gpu;

use super::common::guards::Guards;
use super::harness::{self, Words, bytes, garbage};

/// A view of a wavy surface with holes, its photograph, and a prior of another size with holes of its own.
struct View {
    push: Push,
    edges: u32,
    bits: u32,
    image: Vec<[f32; 4]>,
    aux: Vec<[f32; 4]>,
    target: Vec<u32>,
    prior: Vec<[u32; 2]>,
    mask: Option<Vec<u8>>,
}

fn unit(v: [f32; 3]) -> [f32; 3] {
    let size = v.iter().map(|x| x * x).sum::<f32>().sqrt();
    v.map(|x| x / size)
}

/// Surface depth at a position in the view, both coordinates from 0 to 1.
fn surface(x: f32, y: f32) -> f32 {
    if x > 0.7 { 9.0 + y } else { 4.0 + 0.3 * (7.0 * x).sin() + 0.5 * y }
}

fn view(size: [u32; 2], prior: [u32; 2], mask: Option<[u32; 2]>, edges: u32, bits: u32, seed: u64) -> View {
    let mut random = Random::new(seed);
    let [width, height] = size;
    let (mut image, mut aux, mut target) = (Vec::new(), Vec::new(), Vec::new());
    let mut masked = 0;
    for k in 0..width * height {
        let (x, y) = ((k % width) as f32 / width as f32, (k / width) as f32 / height as f32);
        // Away from the decision at 0.9, and some pixels without any splat.
        let transmittance = match random.word() % 8 {
            0 => random.between(0.15, 0.9),
            1 => [1.0, 0.0][(random.word() % 2) as usize],
            _ => random.between(0.001, 0.08),
        };
        let opacity = 1.0 - transmittance;
        image.push([0.5, 0.5, 0.5, transmittance]);
        let depth = surface(x, y) * random.between(0.97, 1.03);
        let normal = unit([random.between(-0.6, 0.6), random.between(-0.6, 0.6), -1.0]);
        let size = opacity * if random.word().is_multiple_of(9) { 0.05 } else { random.between(0.5, 1.0) };
        aux.push([depth * opacity, normal[0] * size, normal[1] * size, normal[2] * size]);
        let counts = !random.word().is_multiple_of(13);
        masked += u32::from(!counts);
        let shade = 60.0 + 50.0 * (20.0 * x).sin() + if y > 0.5 { 80.0 } else { 0.0 };
        let level = |random: &mut Random| (shade + random.between(0.0, 9.0)) as u32;
        let [r, g, b] = std::array::from_fn(|_| level(&mut random));
        match bits {
            16 => target.extend([(r * 257) | (g * 257 + 3) << 16, (b * 257) | u32::from(counts) << 16]),
            _ => target.push(r | g << 8 | b << 16 | u32::from(counts) << 24),
        }
    }
    let prior_words = (0..prior[0] * prior[1]).map(|k| {
        let x = ((k % prior[0]) as f32 + 0.5) / prior[0] as f32;
        let y = ((k / prior[0]) as f32 + 0.5) / prior[1] as f32;
        let depth = match random.word() % 12 {
            0 => 0.0,
            1 => [f32::NAN, f32::INFINITY, -3.0, 1e-30][(random.word() % 4) as usize],
            2 => surface(x, y) * 1.2,
            _ => surface(x, y),
        };
        let normal = unit([random.between(-0.6, 0.6), random.between(-0.6, 0.6), -1.0]);
        let confidence = if random.word().is_multiple_of(7) { 0.0 } else { random.between(0.1, 1.0) };
        pack_prior(depth, (!random.word().is_multiple_of(6)).then_some(normal), confidence)
    });
    let prior_words = prior_words.collect();
    let mask_size = mask.unwrap_or([0, 0]);
    let mask = mask.map(|[w, h]| (0..(w * h).next_multiple_of(4)).map(|_| random.word() as u8).collect());
    let push = Push {
        width,
        height,
        prior_width: prior[0],
        prior_height: prior[1],
        mask_width: mask_size[0],
        mask_height: mask_size[1],
        pixels: (width * height - masked) as f32,
        median: 4.5,
        depth_weight: 0.7,
        huber: 0.015,
        edge: if edges == 0 { 1.0 } else { 6.0 },
        smooth_weight: 0.9,
        edge_stop: 4.0,
        cosine_weight: 0.4,
        l1_weight: 0.3,
    };
    View { push, edges, bits, image, aux, target, prior: prior_words, mask }
}

impl View {
    /// The view in double precision.
    fn scene(&self) -> Scene<'_, f64> {
        let size = [self.push.mask_width as usize, self.push.mask_height as usize];
        let wide = |rows: &[[f32; 4]]| rows.iter().map(|row| row.map(f64::from)).collect();
        Scene {
            push: self.push,
            edges: self.edges,
            image: wide(&self.image),
            aux: wide(&self.aux),
            photo: unpack(&self.target, self.bits),
            counts: counting(&self.target, self.bits),
            prior: &self.prior,
            mask: self.mask.as_ref().map(|bytes| ByteMask { bytes, size }),
        }
    }

    fn groups(&self) -> u32 {
        passes::groups(self.push.width, self.push.height)
    }

    fn parts(&self) -> usize {
        passes::parts(self.push.width, self.push.height) as usize
    }
}

/// Totals, dL/dT, dL/d(auxiliary image), and the three terms with their sum, by the twin in f64.
struct Wanted {
    of_transmittance: Vec<f64>,
    of_aux: Vec<[f64; 4]>,
    terms: [f64; 4],
    totals: [f64; 4],
}

fn wanted(scene: &Scene<'_, f64>) -> Wanted {
    let pixels = scene.image.len();
    let rows: Vec<_> = (0..pixels).map(|k| scene.depth_row(k)).collect();
    let map: Vec<[f64; 4]> = rows.iter().map(|row| row.0).collect();
    let totals = added(&rows.iter().map(|row| row.1).collect::<Vec<_>>());
    let grads: Vec<_> = (0..pixels).map(|k| scene.grad_row(&map, &totals, k)).collect();
    Wanted {
        of_transmittance: grads.iter().map(|g| g.1).collect(),
        of_aux: grads.iter().map(|g| g.2).collect(),
        terms: added(&grads.iter().map(|g| g.0).collect::<Vec<_>>()),
        totals,
    }
}

fn close(what: &str, got: &[f32], want: &[f32], bound: f32) {
    let largest = want.iter().fold(0.0f32, |m, v| m.max(v.abs()));
    for (k, (g, w)) in got.iter().zip(want).enumerate() {
        let same = g.to_bits() == w.to_bits() || (g - w).abs() <= bound * (w.abs() + 1e-2 * largest);
        assert!(same, "{what}: word {k} is {g}, twin {w}");
    }
}

/// Every pass on the device's results of the pass before, against its twin; the final gradient against f64.
fn check(gpu: &Gpu, v: &View, what: &str) {
    let pixels = v.image.len();
    let given = [("MASK", u32::from(v.mask.is_some())), ("PHOTOGRAPH_BITS", v.bits)];
    let mask = v.mask.clone().unwrap_or(vec![0; 4]);
    let (image, aux, prior) = (bytes(&v.image), bytes(&v.aux), bytes(v.prior.as_flattened()));
    let parts = garbage(4 * v.parts());
    let buffers = [
        image.clone(),
        aux.clone(),
        bytes(&v.target),
        prior.clone(),
        mask,
        garbage(4 * pixels + 8),
        [&parts[..], &garbage(8)].concat(),
    ];
    let first = harness::run(gpu, &passes::DEPTH, &given, &buffers, &v.push, v.groups());
    assert_eq!(first.device[..5], buffers[..5], "{what}: inputs changed");
    for (buffer, rows) in [(5, pixels), (6, v.parts())] {
        assert_eq!(first.device[buffer][16 * rows..], buffers[buffer][16 * rows..], "{what}: beyond buffer {buffer}");
        close(what, &first.device::<f32>(buffer)[..4 * rows], &first.twin::<f32>(buffer)[..4 * rows], 2e-5);
    }

    let push = part_sum::Push { count: v.parts() as u32, slot: 1 };
    let counted = harness::run(gpu, &part_sum::PASS, &[], &[first.device[6].clone(), garbage(12)], &push, 1);
    close(what, &counted.device::<f32>(1), &counted.twin::<f32>(1), 1e-6);
    let totals = counted.device::<f32>(1)[4..8].to_vec();

    let before: Vec<f32> = (0..4 * pixels).map(|k| k as f32 * 1e-3).collect();
    let map = first.device[5].clone();
    let buffers =
        [image, aux, prior, map, bytes(&totals), bytes(&before), garbage(4 * pixels + 8), garbage(4 * v.parts())];
    let given = [("EDGES", v.edges)];
    let second = harness::run(gpu, &passes::GRAD, &given, &buffers, &v.push, v.groups());
    assert_eq!(second.device[..5], buffers[..5], "{what}: inputs changed");
    assert_eq!(second.device[6][16 * pixels..], buffers[6][16 * pixels..], "{what}: beyond the gradient");
    for (buffer, words) in [(5, 4 * pixels), (6, 4 * pixels), (7, 4 * v.parts())] {
        close(what, &second.device::<f32>(buffer)[..words], &second.twin::<f32>(buffer)[..words], 1e-3);
    }

    // Added to zeros, so that no digits are lost to earlier values.
    let zeros = [&buffers[..5], &[bytes(&vec![0.0f32; 4 * pixels])], &buffers[6..]].concat();
    let second = harness::run(gpu, &passes::GRAD, &given, &zeros, &v.push, v.groups());
    let want = wanted(&v.scene());
    let counts: Vec<f64> = totals[..3].iter().map(|n| f64::from(*n)).collect();
    assert_eq!(counts, want.totals[..3], "{what}: counts");
    let got = second.device::<f32>(5);
    assert!(got.chunks(4).all(|row| row[..3] == [0.0; 3]), "{what}: the colour's gradient was touched");
    let of_transmittance: Vec<f32> = got.chunks(4).map(|row| row[3]).collect();
    // Second differences of depths lose digits: rounding is judged against the largest.
    Guards::of(1e-3).check(&format!("{what}: dL/dT"), pixels, &of_transmittance, &want.of_transmittance);
    let aux = &second.device::<f32>(6)[..4 * pixels];
    for (name, part) in [("depth", 0..1), ("normal", 1..4)] {
        let got: Vec<f32> = aux.chunks(4).flat_map(|row| row[part.clone()].to_vec()).collect();
        let want: Vec<f64> = want.of_aux.iter().flat_map(|row| row[part.clone()].to_vec()).collect();
        Guards::of(1e-3).check(&format!("{what}: gradient of {name}"), want.len(), &got, &want);
    }
    let push = part_sum::Push { count: v.parts() as u32, slot: 0 };
    let sum = harness::run(gpu, &part_sum::PASS, &[], &[second.device[7].clone(), garbage(4)], &push, 1);
    for (got, want) in sum.device::<f32>(1).iter().zip(want.terms) {
        assert!((f64::from(*got) - want).abs() < 2e-5 * want.abs() + 1e-9, "{what}: {got} instead of {want}");
    }
}

pub fn run(gpu: &Gpu) {
    let cases = [
        ([67, 65], [23, 17], Some([16, 9]), 0, 8),
        ([40, 30], [40, 30], None, 1, 8),
        ([31, 20], [45, 33], Some([5, 7]), 1, 16),
        ([1, 1], [1, 1], None, 0, 8),
        ([1, 70], [1, 9], Some([1, 2]), 0, 8),
        ([70, 2], [9, 1], None, 0, 16),
    ];
    for (k, (size, prior, mask, edges, bits)) in cases.into_iter().enumerate() {
        let v = view(size, prior, mask, edges, bits, 50 + k as u64);
        check(gpu, &v, &format!("{size:?}, prior {prior:?}, mask {mask:?}, edges {edges}, {bits} bits"));
    }
    // A view without splats, and one of garbage: zero gradients, or at least finite ones.
    let mut v = view([20, 10], [6, 5], Some([3, 3]), 0, 8, 70);
    v.image.iter_mut().for_each(|p| p[3] = 1.0);
    v.aux.fill([0.0; 4]);
    assert_eq!(finite_gradients(gpu, &v), 0);
    v.prior.fill(pack_prior(f32::NAN, Some([f32::NAN; 3]), f32::NAN));
    v.image.iter_mut().for_each(|p| p[3] = 0.0);
    v.aux
        .iter_mut()
        .enumerate()
        .for_each(|(k, p)| *p = [[5.0, 0.0, 0.0, 0.0], [f32::NAN; 4], [f32::INFINITY; 4]][k % 3]);
    v.push.median = 0.0;
    finite_gradients(gpu, &v);
    v.prior.fill(pack_prior(1e-9, Some([0.0, 0.0, -1.0]), 1.0));
    assert!(finite_gradients(gpu, &v) > 20);
    v.image.iter_mut().for_each(|p| p[3] = f32::NAN);
    assert_eq!(finite_gradients(gpu, &v), 0);
}

/// Number of nonzero gradients and parts. Panics where one is not finite.
fn finite_gradients(gpu: &Gpu, v: &View) -> usize {
    let pixels = v.image.len();
    let (image, aux, prior) = (bytes(&v.image), bytes(&v.aux), bytes(v.prior.as_flattened()));
    let given = [("MASK", u32::from(v.mask.is_some())), ("PHOTOGRAPH_BITS", v.bits)];
    let mask = v.mask.clone().unwrap_or(vec![0; 4]);
    let buffers = [
        image.clone(),
        aux.clone(),
        bytes(&v.target),
        prior.clone(),
        mask,
        garbage(4 * pixels),
        garbage(4 * v.parts()),
    ];
    let first = harness::run(gpu, &passes::DEPTH, &given, &buffers, &v.push, v.groups());
    let sums = added(&bytemuck::pod_collect_to_vec::<u8, [f32; 4]>(&first.device[6]));
    let zeros = bytes(&vec![0.0f32; 4 * pixels]);
    let buffers =
        [image, aux, prior, first.device[5].clone(), bytes(&sums), zeros, garbage(4 * pixels), garbage(4 * v.parts())];
    let second = harness::run(gpu, &passes::GRAD, &[("EDGES", v.edges)], &buffers, &v.push, v.groups());
    let all: Vec<f32> = (5..8).flat_map(|k| second.device::<f32>(k)).collect();
    assert!(all.iter().all(|x| x.is_finite()), "a gradient or a part is not finite");
    all.iter().filter(|x| **x != 0.0).count()
}

/// The gradient of the twin against central differences of the definition.
#[test]
fn geometry_twin_gradient_is_its_derivative() {
    for (edges, mask) in [(0, Some([4, 3])), (1, None)] {
        let v = view([13, 11], [7, 6], mask, edges, 8, 91);
        let scene = v.scene();
        let want = wanted(&scene);
        let value = scene.value();
        assert!(value.iter().all(|v| *v > 1e-6), "{value:?}: a term is missing");
        for (got, want) in want.terms.iter().zip(value) {
            assert!((got - want).abs() < 1e-12, "{got} instead of {want}");
        }
        let total = |scene: &Scene<'_, f64>| scene.value().iter().sum::<f64>();
        let h = 1e-7;
        let mut moved = scene.clone();
        for k in 0..scene.image.len() {
            let mut slope = |change: &dyn Fn(&mut Scene<'_, f64>, f64)| {
                let mut at = |h: f64| {
                    change(&mut moved, h);
                    let value = total(&moved);
                    (moved.image[k], moved.aux[k]) = (scene.image[k], scene.aux[k]);
                    value
                };
                (at(h) - at(-h)) / (2.0 * h)
            };
            let of_t = slope(&|s, h| s.image[k][3] += h);
            assert!((want.of_transmittance[k] - of_t).abs() < 1e-7, "T {k}: {} is {of_t}", want.of_transmittance[k]);
            for c in 0..4 {
                let of_aux = slope(&|s, h| s.aux[k][c] += h);
                assert!((want.of_aux[k][c] - of_aux).abs() < 1e-7, "aux {k} {c}: {} is {of_aux}", want.of_aux[k][c]);
            }
        }
    }
}

#[test]
fn packed_priors_keep_what_they_hold() {
    let mut random = Random::new(8);
    for _ in 0..2000 {
        let normal = unit(std::array::from_fn(|_| random.between(-1.0, 1.0)));
        let confidence = random.between(0.0, 1.0);
        let [depth, word] = pack_prior(3.5, Some(normal), confidence);
        assert_eq!(f32::from_bits(depth), 3.5);
        assert!(((word >> 24) as f32 / 255.0 - confidence).abs() <= 0.5 / 255.0 + 1e-6);
        let got = prior_normal::<f64>(word).unwrap();
        let cosine: f64 = got.iter().zip(normal).map(|(a, b)| a * f64::from(b)).sum();
        // Half a step of 1/2047 in both coordinates moves the point of the octahedron by up to sqrt(6) half steps, at a
        // distance of at least 1/sqrt(3) from the middle: 0.06 degrees.
        assert!(cosine > (1.0f64 / 15.0).to_radians().cos(), "{normal:?} became {got:?}");
    }
    for axis in [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [-0.0, -0.0, -1.0]] {
        let got = prior_normal::<f64>(pack_prior(1.0, Some(axis), 1.0)[1]).unwrap();
        assert!(got.iter().zip(axis).all(|(a, b)| (a - f64::from(b)).abs() < 1e-6), "{axis:?} became {got:?}");
    }
    for none in [None, Some([0.0; 3]), Some([f32::NAN; 3])] {
        assert_eq!(pack_prior(1.0, none, 0.5)[1], 128 << 24);
    }
}
