//! Scenes for the blending tests: splats on an image with their tile lists, and the pixels where the f32 device may
//! decide differently.

use psrgs_vk::scene::random::Random;
use psrgs_vk::scene::tile::ALPHA_MIN;
use psrgs_vk::twin::Real;
use psrgs_vk::twin::blend_forward::{Blend, TRANSMITTANCE_MIN, evaluate};

/// Slope of the depth along x, per pixel, of a splat at depth 1.
pub const SLOPE: f64 = 0.003;

/// A splat with standard deviations `sigma` (before the dilation of 0.3) along axes turned by `angle`.
pub fn splat(mean: [f64; 2], sigma: [f64; 2], angle: f64, opacity: f64, depth: f64, colour: [f64; 3]) -> [f32; 12] {
    let (s, c) = angle.sin_cos();
    let [u, v] = sigma.map(|x| x * x);
    let (xx, xy, yy) = (c * c * u + s * s * v + 0.3, c * s * (u - v), s * s * u + c * c * v + 0.3);
    let det = xx * yy - xy * xy;
    let [r, g, b] = colour;
    [mean[0], mean[1], yy / det, -xy / det, xx / det, opacity, depth, 1.0 / yy, r, g, b, SLOPE * depth * angle.cos()]
        .map(|x| x as f32)
}

/// A scene as the device gets it.
pub struct Scene {
    pub name: &'static str,
    pub width: usize,
    pub height: usize,
    pub background: [f32; 3],
    /// In depth order.
    pub splats: Vec<[f32; 12]>,
    /// Whether every tile lists every splat; else a tile lists splats whose box of three to four deviations touches
    /// the tile.
    pub everywhere: bool,
}

impl Scene {
    /// `n` random splats, opacities up to `most`.
    pub fn random(name: &'static str, seed: u64, n: usize, size: [usize; 2], most: f64) -> Self {
        let mut d = Random::new(seed);
        let [width, height] = size;
        let splats = (0..n)
            .map(|i| {
                let mean = [d.range(-4.0, width as f64 + 4.0), d.range(-4.0, height as f64 + 4.0)];
                let sigma = [d.range(-1.0, 2.2).exp(), d.range(-1.0, 2.2).exp()];
                let colour = [d.unit(), d.unit(), d.unit()];
                splat(mean, sigma, d.range(0.0, 3.2), d.range(0.0, most), 1.0 + i as f64 * 0.01, colour)
            })
            .collect();
        Self { name, width, height, background: [0.2, 0.5, 0.9], splats, everywhere: false }
    }

    fn touches(&self, s: &[f32; 12], x: usize, y: usize, side: usize) -> bool {
        let [a, b, c, o] = [s[2], s[3], s[4], s[5]].map(f64::from);
        let level = 2.0 * (255.0 * o).max(1.0).ln() + 0.1;
        let det = a * c - b * b;
        let (ex, ey) = ((level * c / det).sqrt(), (level * a / det).sqrt());
        let (mx, my) = (f64::from(s[0]), f64::from(s[1]));
        let near = |m: f64, e: f64, t: usize| m + e >= (t * side) as f64 && m - e <= ((t + 1) * side) as f64;
        self.everywhere || near(mx, ex, x) && near(my, ey, y)
    }

    /// Tile lists for tiles of `side` pixels: the splats' own numbers are permuted so that depth order is not memory
    /// order.
    pub fn blend(&self, side: usize, aux: bool) -> Blend<f32> {
        let n = self.splats.len();
        let step = (n / 2..).find(|&k| k > 0 && gcd(k, n.max(1)) == 1).unwrap_or(1);
        let place = |rank: usize| rank * step % n;
        let mut splats = vec![[0.0; 12]; n];
        let mut normals = vec![[0.0; 4]; n];
        for (rank, s) in self.splats.iter().enumerate() {
            splats[place(rank)] = *s;
            let mut d = Random::new(rank as u64 + 77);
            let v: [f64; 3] = std::array::from_fn(|_| d.range(-1.0, 1.0));
            let length = v.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-3);
            normals[place(rank)] =
                [v[0] / length, v[1] / length, v[2] / length, SLOPE * d.range(-1.0, 1.0)].map(|x| x as f32);
        }
        let (columns, rows) = (self.width.div_ceil(side), self.height.div_ceil(side));
        let (mut sorted, mut ranges) = (Vec::new(), Vec::new());
        for tile in 0..columns * rows {
            let begin = sorted.len() as u32;
            for (rank, s) in self.splats.iter().enumerate() {
                if s[5] > 0.0 && self.touches(s, tile % columns, tile / columns, side) {
                    sorted.push(place(rank) as u32);
                }
            }
            ranges.push([begin, sorted.len() as u32]);
        }
        Blend {
            width: self.width,
            height: self.height,
            background: self.background,
            side,
            splats,
            normals: aux.then_some(normals),
            sorted,
            ranges,
            block: None,
            alpha_min: ALPHA_MIN,
        }
    }
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// The same scene in another precision.
pub fn widen<R: Real>(b: &Blend<f32>) -> Blend<R> {
    let up = |x: f32| R::of(f64::from(x));
    Blend {
        width: b.width,
        height: b.height,
        background: b.background.map(up),
        side: b.side,
        splats: b.splats.iter().map(|s| s.map(up)).collect(),
        normals: b.normals.as_ref().map(|n| n.iter().map(|s| s.map(up)).collect()),
        sorted: b.sorted.clone(),
        ranges: b.ranges.clone(),
        block: b.block,
        alpha_min: b.alpha_min,
    }
}

/// Possible errors of f32 arithmetic in a pixel.
pub struct Doubt {
    /// A threshold may be decided differently.
    pub undecided: bool,
    /// Bound of the error of sum w v for |v| <= 1, where decided.
    pub weights: f64,
    /// Bound of the relative error of the final transmittance, where decided.
    pub transmittance: f64,
}

/// Alpha below which an early step skips splats.
pub const EARLY_ALPHA_MIN: f32 = 1.0 / 64.0;

/// Error bounds of the f32 forward pass, and the pixels that may fall on the other side of a threshold.
///
/// With u = 2^-24: the exponent is -(x^2 + y^2) with x = p dx + q dy and y = r dy. p and r have an error of 2u (half of
/// the constant's and the product's, and the root's), q has 5u (constant, product, division, p). The difference, the
/// product and the sum of x add 3u, the products and the sum at the end 2u. So the exponent's error is at most
/// u (2 |x| (5 |p dx| + 8 |q dy|) + 2 x^2 + 10 y^2), plus 2u |coordinate| |slope| for the rounding of the differences,
/// which is u relative to the coordinate, not to the difference. exp2 adds 2^-21 (four times the error of an
/// approximation of degree 5), the product with the opacity u. Transmittance collects the errors of its factors,
/// d alpha / (1 - alpha), and 2u per step.
pub fn doubts(blend: &Blend<f64>) -> Vec<Doubt> {
    let u = 2.0f64.powi(-24);
    let least = f64::from(TRANSMITTANCE_MIN);
    (0..blend.width * blend.height)
        .map(|pixel| {
            let (x, y) = (pixel % blend.width, pixel / blend.width);
            let mut doubt = Doubt { undecided: false, weights: 0.0, transmittance: 0.0 };
            let mut transmittance = 1.0f64;
            for &splat in blend.list(x, y) {
                let row = &blend.splats[splat as usize];
                let at = evaluate(row, Blend::center(x, y), blend.alpha_min);
                let [dx, dy] = at.d;
                let [a, b, rest] = [row[2], row[3], row[7]];
                let p = (a / 2.0).sqrt();
                let [across, skew] = [p * dx, b / (2.0 * p) * dy];
                let [root_x, root_y] = [across + skew, (rest / 2.0).sqrt() * dy];
                let slopes = 2.0 * (p * root_x).abs() + (b / p * root_x + rest * dy).abs();
                let roundings = 2.0 * root_x.abs() * (5.0 * across.abs() + 8.0 * skew.abs())
                    + 2.0 * root_x * root_x
                    + 10.0 * root_y * root_y;
                let off = u * roundings + 2.0 * u * slopes * (x.max(y) as f64 + 1.0) + 2.0f64.powi(-21) + u;
                let raw = row[5] * at.falloff;
                doubt.undecided |= (raw / f64::from(blend.alpha_min) - 1.0).abs() <= off;
                // At the clamp, gradients jump.
                doubt.undecided |= (raw / 0.99 - 1.0).abs() <= off;
                let alpha = at.alpha();
                if alpha == 0.0 {
                    continue;
                }
                let next = transmittance * (1.0 - alpha);
                doubt.weights += alpha * transmittance * (off + doubt.transmittance + 4.0 * u);
                doubt.transmittance += off * alpha / (1.0 - alpha) + 2.0 * u;
                doubt.undecided |= (next / least - 1.0).abs() <= doubt.transmittance;
                if next < least {
                    break;
                }
                transmittance = next;
            }
            // Sums of up to a few thousand terms of one sign, all below 1 in total: u per addition.
            doubt.weights += u * (blend.list(x, y).len() as f64 + 4.0);
            doubt
        })
        .collect()
}

/// Scenes that have broken rasterizers, and sizes around those of the tiles.
pub fn hard_scenes() -> Vec<Scene> {
    let stack = |name, size: [usize; 2], background, everywhere, splats| Scene {
        name,
        width: size[0],
        height: size[1],
        background,
        splats,
        everywhere,
    };
    let mut draws = Random::new(5);
    let mut colour = || [draws.unit(), draws.unit(), draws.unit()];
    let opaque = (0..50).map(|i| splat([6.3, 4.8], [2.0, 3.0], 0.4, 0.9999, 1.0 + f64::from(i), colour())).collect();
    let fog = (0..2000).map(|i| splat([5.0, 5.0], [400.0, 400.0], 0.0, 0.0043, 1.0 + f64::from(i), colour())).collect();
    let saturated = (0..300)
        .map(|i| {
            splat([f64::from(i % 23), f64::from(i % 17)], [9.0, 6.0], f64::from(i), 0.97, 2.0 + f64::from(i), colour())
        })
        .collect();
    let few = (0..3).map(|i| splat([50.0, 20.0 + f64::from(i)], [1.0, 2.0], 1.0, 0.8, 3.0, colour())).collect();
    let centered = (0..12)
        .map(|i| splat([f64::from(i) + 0.5, f64::from(i % 5) + 0.5], [1.5, 0.7], 0.7, 0.6, 1.0, colour()))
        .collect();
    let needles = (0..20)
        .map(|i| splat([20.0, 2.0 * f64::from(i)], [30.0, 0.05], f64::from(i) * 0.16, 0.9, 1.0, colour()))
        .collect();
    let faint = (0..40).map(|i| splat([f64::from(i), 10.0], [4.0, 4.0], 0.0, 1.3 / 255.0, 1.0, colour())).collect();
    // Pixels stop after different numbers of splats, 30 to some hundred: inside and at the ends of buckets and batches.
    let stops = (0..300)
        .map(|i| {
            let mean = [f64::from(i * 7 % 22), f64::from(i * 5 % 18)];
            splat(mean, [7.0, 5.0], f64::from(i), 0.25, 2.0 + f64::from(i), colour())
        })
        .collect();
    // Lists with the length of a bucket or a batch, and one less or more, in tiles of 16.
    let lengths = [31, 32, 33, 255, 256, 257]
        .into_iter()
        .enumerate()
        .flat_map(|(tile, length)| (0..length).map(move |i| (tile, i)))
        .map(|(tile, i)| {
            let mean = [16.0 * tile as f64 + 6.0 + f64::from(i % 5), 6.0 + f64::from(i % 3)];
            splat(mean, [1.0, 0.8], f64::from(i), 0.06, 1.0 + f64::from(i), colour())
        })
        .collect();
    vec![
        stack("stops in every place", [22, 18], [0.4, 0.2, 0.1], true, stops),
        stack("lists of 31 to 257 splats", [96, 12], [0.4, 0.2, 0.1], false, lengths),
        stack("50 stacked opaque splats", [13, 11], [0.1, 0.2, 0.3], false, opaque),
        stack("fog of 2,000 layers", [9, 9], [1.0, 0.0, 0.5], true, fog),
        stack("saturated tiles", [30, 20], [1.0, 1.0, 1.0], true, saturated),
        stack("mostly empty tiles", [64, 40], [0.3, 0.6, 0.9], false, few),
        stack("means on pixel centres: power exactly 0", [16, 8], [0.0; 3], false, centered),
        stack("needles", [40, 40], [0.5; 3], false, needles),
        stack("alpha just above 1/255", [40, 20], [0.2; 3], false, faint),
        stack("nothing visible", [20, 10], [0.7, 0.1, 0.4], false, Vec::new()),
        Scene::random("one pixel", 21, 12, [1, 1], 0.9),
        Scene::random("one tile", 22, 60, [8, 8], 0.99),
        Scene::random("thin", 23, 60, [3, 41], 0.99),
        Scene::random("wide", 24, 80, [67, 5], 0.99),
        Scene::random("multiple of both tiles", 25, 200, [48, 32], 0.9),
        Scene::random("multiple of neither", 26, 300, [53, 37], 1.0),
    ]
}
