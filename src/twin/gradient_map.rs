//! Twins of `glsl/gradient_map_*.comp`, and the loss by its definition.

use super::geometry::{LUMA, luma};
use super::loss::{counting, unpack};
use super::place::ByteMask;
use super::{Real, TwinCall};
use crate::pass::gradient_map::{PIXELS, Push, WINDOW_SIDE, parts, windows};

const ROOT_FLOOR: f64 = 1e-6;
const LENGTH_FLOOR: f64 = 1e-4;

/// The inputs of the gradient map loss.
#[derive(Clone, Debug)]
pub struct Scene<'a, R> {
    /// Sizes and weights.
    pub push: Push,
    /// Whether the residual's total variation is a term of the loss.
    pub variation: bool,
    /// (r, g, b, T) per pixel.
    pub image: Vec<[R; 4]>,
    /// The photograph.
    pub photo: Vec<[R; 3]>,
    /// Another render that gradient maps are compared with in place of the photograph.
    pub other: Option<Vec<[R; 4]>>,
    /// Whether each pixel counts: those that are not masked.
    pub counts: Vec<bool>,
    /// The texture mask, where there is one.
    pub mask: Option<ByteMask<'a>>,
}

/// The correlation r of a window of weight m, and the derivatives m dr/da of its pixels.
pub struct Window<R> {
    /// (m r, m).
    pub row: [R; 2],
    /// Pixels with their derivatives.
    pub slopes: Vec<(usize, R)>,
}

fn root<R: Real>(x: R, y: R) -> R {
    (x * x + y * y + R::of(ROOT_FLOOR)).sqrt()
}

impl<R: Real> Scene<'_, R> {
    fn size(&self) -> [usize; 2] {
        [self.push.width as usize, self.push.height as usize]
    }

    fn weight(&self, k: usize) -> R {
        let [width, _] = self.size();
        self.mask.map_or(R::one(), |mask| mask.at([k % width, k / width], self.size()))
    }

    fn colour(&self, k: usize) -> [R; 3] {
        let [r, g, b, _] = self.image[k];
        if self.counts[k] { [r, g, b] } else { self.photo[k] }
    }

    /// What a pixel of the render is compared with.
    fn wanted(&self, k: usize) -> [R; 3] {
        match &self.other {
            Some(other) if self.counts[k] => [other[k][0], other[k][1], other[k][2]],
            _ => self.photo[k],
        }
    }

    /// `gradient_map_sobel`: a pixel's row.
    pub fn sobel(&self, k: usize) -> [R; 4] {
        let ([width, height], o) = (self.size(), R::zero());
        let (x, y) = (k % width, k / width);
        if x == 0 || y == 0 || x + 1 >= width || y + 1 >= height || !self.counts[k] {
            return [-R::one(), o, o, o];
        }
        let gradient = |value: &dyn Fn(usize) -> R| {
            let (mut gx, mut gy) = (o, o);
            for (dx, dy) in (-1..=1).flat_map(|dy: i32| (-1..=1).map(move |dx: i32| (dx, dy))) {
                let at = (y as i32 + dy) as usize * width + (x as i32 + dx) as usize;
                gx += R::of(f64::from(dx * (2 - dy.abs()))) * value(at);
                gy += R::of(f64::from(dy * (2 - dx.abs()))) * value(at);
            }
            [gx, gy]
        };
        let [gx, gy] = gradient(&|k| luma(self.colour(k)));
        let [px, py] = gradient(&|k| luma(self.wanted(k)));
        [root(gx, gy), root(px, py), gx, gy]
    }

    /// Pixels of a window.
    fn pixels_of(&self, window: usize) -> impl Iterator<Item = usize> {
        let ([width, height], side) = (self.size(), WINDOW_SIDE as usize);
        let across = width.div_ceil(side);
        let (left, top) = (window % across * side, window / across * side);
        let columns = left..(left + side).min(width);
        (top..(top + side).min(height)).flat_map(move |y| columns.clone().map(move |x| y * width + x))
    }

    /// `gradient_map_windows`, from the rows of [`Self::sobel`].
    pub fn window(&self, maps: &[[R; 4]], window: usize) -> Window<R> {
        let pixels: Vec<usize> = self.pixels_of(window).filter(|k| maps[*k][0] > R::zero()).collect();
        let sum = |f: &dyn Fn(usize) -> R| pixels.iter().fold(R::zero(), |sum, k| sum + f(*k));
        let (m, n) = (sum(&|k| self.weight(k)), R::of(pixels.len().max(1) as f64));
        let mean: [R; 2] = std::array::from_fn(|c| sum(&|k| maps[k][c]) / n);
        let off = |k: usize, c: usize| maps[k][c] - mean[c];
        let size: [R; 2] = std::array::from_fn(|c| sum(&|k| off(k, c) * off(k, c)).sqrt());
        let [of_a, of_b] = size.map(|size| R::one() / size.max(R::of(LENGTH_FLOOR)));
        let r = sum(&|k| off(k, 0) * off(k, 1)) * of_a * of_b;
        let held = if size[0] > R::of(LENGTH_FLOOR) { r * of_a * of_a } else { R::zero() };
        let slope = |k: usize| m * (off(k, 1) * of_a * of_b - off(k, 0) * held);
        Window { row: [m * r, m], slopes: pixels.iter().map(|k| (*k, slope(*k))).collect() }
    }

    /// Rows of the maps after `gradient_map_windows`.
    pub fn flows(maps: &[[R; 4]], windows: &[Window<R>]) -> Vec<[R; 4]> {
        let o = R::zero();
        let mut flows = vec![[o; 4]; maps.len()];
        for (k, slope) in windows.iter().flat_map(|w| &w.slopes) {
            let [a, _, gx, gy] = maps[*k];
            flows[*k] = [*slope / a * gx, *slope / a * gy, o, o];
        }
        flows
    }

    /// Residual of a pixel; `None` outside the image and for masked pixels.
    fn residual(&self, x: usize, y: usize) -> Option<[R; 3]> {
        let [width, height] = self.size();
        let k = y.checked_mul(width)?.checked_add(x)?;
        let there = x < width && y < height && self.counts[k];
        there.then(|| std::array::from_fn(|c| self.image[k][c] - self.photo[k][c]))
    }

    /// Differences of the residual to the right and downwards; `None` outside the image and for masked pixels.
    fn steps(&self, x: usize, y: usize) -> Option<[[R; 2]; 3]> {
        let here = self.residual(x, y)?;
        let to = |other: Option<[R; 3]>, c: usize| other.map_or(R::zero(), |other| other[c] - here[c]);
        Some(std::array::from_fn(|c| [to(self.residual(x + 1, y), c), to(self.residual(x, y + 1), c)]))
    }

    /// `gradient_map_grad`: the weighted variation of a pixel's residual, and the gradient of its colour.
    pub fn grad_row(&self, flows: &[[R; 4]], totals: &[R; 4], k: usize) -> (R, [R; 3]) {
        let ([width, height], o) = (self.size(), R::zero());
        let (x, y) = (k % width, k / width);
        let mut of_luma = o;
        for (dx, dy) in (-1..=1).flat_map(|dy: i32| (-1..=1).map(move |dx: i32| (dx, dy))) {
            let (qx, qy) = (x as i32 + dx, y as i32 + dy);
            if qx >= 0 && qy >= 0 && (qx as usize) < width && (qy as usize) < height {
                let flow = flows[qy as usize * width + qx as usize];
                of_luma -= flow[0] * R::of(f64::from(dx * (2 - dy.abs())));
                of_luma -= flow[1] * R::of(f64::from(dy * (2 - dx.abs())));
            }
        }
        let number = |v: f32| R::of(f64::from(v));
        let scale = if totals[1] > o { -number(self.push.weight) / totals[1] } else { o };
        let mut grad = LUMA.map(|share| scale * of_luma * R::of(share));
        let mut variation = o;
        if let (true, Some(own)) = (self.variation, self.steps(x, y)) {
            let each = number(self.push.tv_weight) / number(self.push.values);
            let left = x.checked_sub(1).and_then(|x| self.steps(x, y));
            let up = y.checked_sub(1).and_then(|y| self.steps(x, y));
            for (c, grad) in grad.iter_mut().enumerate() {
                let [dx, dy] = own[c];
                variation += each * root(dx, dy);
                *grad -= each * (dx + dy) / root(dx, dy);
                *grad += left.map_or(o, |steps| each * steps[c][0] / root(steps[c][0], steps[c][1]));
                *grad += up.map_or(o, |steps| each * steps[c][1] / root(steps[c][0], steps[c][1]));
            }
        }
        (variation, if self.counts[k] { grad } else { [o; 3] })
    }

    /// The weighted terms by their definitions: (1 - mean correlation, variation).
    pub fn value(&self) -> [R; 2] {
        let ([width, height], o) = (self.size(), R::zero());
        let maps: Vec<[R; 4]> = (0..width * height).map(|k| self.sobel(k)).collect();
        let (mut weighted, mut weights) = (o, o);
        for window in 0..windows(self.push.width, self.push.height) as usize {
            let pixels: Vec<usize> = self.pixels_of(window).filter(|k| maps[*k][0] > o).collect();
            let n = R::of(pixels.len().max(1) as f64);
            let mean = |f: &dyn Fn(&[R; 4]) -> R| pixels.iter().fold(o, |sum, k| sum + f(&maps[*k])) / n;
            let (a, b) = (mean(&|m| m[0]), mean(&|m| m[1]));
            let deviation =
                |c: usize, about: R| (mean(&|m| (m[c] - about).powi(2)) * n).sqrt().max(R::of(LENGTH_FLOOR));
            let together = mean(&|m| (m[0] - a) * (m[1] - b)) * n;
            let m = pixels.iter().fold(o, |sum, k| sum + self.weight(*k));
            weighted += m * together / (deviation(0, a) * deviation(1, b));
            weights += m;
        }
        let number = |v: f32| R::of(f64::from(v));
        let mut sum = o;
        for k in 0..if self.variation { width * height } else { 0 } {
            let steps = self.steps(k % width, k / width);
            sum += steps.map_or(o, |steps| steps.iter().fold(o, |sum, [x, y]| sum + root(*x, *y)));
        }
        let correlation = if weights > o { number(self.push.weight) * (R::one() - weighted / weights) } else { o };
        [correlation, number(self.push.tv_weight) * sum / number(self.push.values)]
    }
}

/// The inputs that the passes bind, without a mask.
fn scene(push: Push, image: Vec<[f32; 4]>, target: &[u32], bits: u32) -> Scene<'static, f32> {
    let (photo, counts) = (unpack(target, bits), counting(target, bits));
    Scene { push, variation: true, image, photo, other: None, counts, mask: None }
}

/// Adapter over raw buffers.
pub fn run_sobel(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let mut scene = scene(push, call.get(0), &call.get::<u32>(1), call.constants[0]);
    scene.other = (call.constants[1] != 0).then(|| call.get(2));
    let mut maps = call.get::<[f32; 4]>(3);
    let pixels = (push.width * push.height).min(64 * call.groups) as usize;
    maps.iter_mut().take(pixels).enumerate().for_each(|(k, row)| *row = scene.sobel(k));
    call.set(3, &maps);
}

/// Adapter over raw buffers.
pub fn run_windows(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let bytes = call.get::<u8>(0);
    let mask = ByteMask { bytes: &bytes, size: [push.mask_width as usize, push.mask_height as usize] };
    let mask = (call.constants[0] != 0).then_some(mask);
    let scene = Scene::<f32> {
        push,
        variation: false,
        image: Vec::new(),
        photo: Vec::new(),
        other: None,
        counts: Vec::new(),
        mask,
    };
    let mut maps = call.get::<[f32; 4]>(1);
    let count = windows(push.width, push.height).min(call.groups) as usize;
    let found: Vec<Window<f32>> = (0..count).map(|w| scene.window(&maps, w)).collect();
    let flows = Scene::flows(&maps, &found);
    for k in (0..count).flat_map(|w| scene.pixels_of(w)) {
        maps[k] = flows[k];
    }
    let rows: Vec<[f32; 4]> = found.iter().map(|w| [w.row[0], w.row[1], 0.0, 0.0]).collect();
    call.set(1, &maps);
    call.set(2, &rows);
}

/// Adapter over raw buffers.
pub fn run_grad(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let mut scene = scene(push, call.get(0), &call.get::<u32>(1), call.constants[1]);
    scene.variation = call.constants[0] != 0;
    let (flows, totals) = (call.get::<[f32; 4]>(2), call.get::<[f32; 4]>(3)[0]);
    let mut of_image = call.get::<[f32; 4]>(4);
    let mut sums = vec![[0.0f32; 4]; parts(push.width, push.height).min(64 * call.groups) as usize];
    if let (Some(first), true) = (sums.first_mut(), totals[1] > 0.0) {
        let mean = totals[0] / totals[1];
        *first = [push.weight * (1.0 - mean), 0.0, mean, 0.0];
    }
    for k in 0..(push.width * push.height).min(PIXELS * call.groups) as usize {
        let (variation, grad) = scene.grad_row(&flows, &totals, k);
        of_image[k].iter_mut().zip(grad).for_each(|(sum, v)| *sum += v);
        sums[64 * (k / PIXELS as usize) + k % 64][1] += variation;
    }
    sums.iter_mut().for_each(|sum| sum[3] = sum[0] + sum[1]);
    call.set(4, &of_image);
    call.set(5, &sums);
}
