//! Twins of `glsl/loss_*.comp`, and the loss by its definition, with all 121 taps of the window.

use super::{Real, TwinCall};
use crate::pass::loss::{Push, SLOT_FLOATS, SumPush};

const RADIUS: usize = 5;
const C1: f64 = 1e-4;
const C2: f64 = 9e-4;
const PIVOT: f64 = 0.5;

/// The 11 taps of the window along one axis: a Gaussian with sigma 1.5, normalised.
pub fn window<R: Real>() -> [R; 11] {
    let raw: [f64; 11] = std::array::from_fn(|i| (-(i as f64 - 5.0).powi(2) / 4.5).exp());
    let sum: f64 = raw.iter().sum();
    raw.map(|x| R::of(x / sum))
}

/// Value and gradient of the loss of one channel.
#[derive(Clone, Debug)]
pub struct ChannelLoss<R> {
    /// Sum over pixels of |x - y|.
    pub l1: R,
    /// Sum over pixels of SSIM.
    pub ssim: R,
    /// Sum over pixels of weight times |x - y|.
    pub weighted_l1: R,
    /// Sum over pixels of weight times (1 - SSIM).
    pub weighted_dssim: R,
    /// d(sum over pixels of weight times SSIM)/dx.
    pub grad_ssim: Vec<R>,
}

/// One channel by the definition (Wang et al. 2004): means, variances and covariance in the 11x11 window, zero padding.
/// Where `counts` is false, x is replaced by y, nothing is summed and the gradient is 0. The pixels' `weights` enter
/// the gradient and the weighted sums.
pub fn channel<R: Real>(
    x: &[R],
    y: &[R],
    counts: &[bool],
    weights: &[R],
    width: usize,
    height: usize,
) -> ChannelLoss<R> {
    let x: Vec<R> = x.iter().zip(y).zip(counts).map(|((x, y), counts)| if *counts { *x } else { *y }).collect();
    let taps = window::<R>();
    let near = |at: usize, size: usize| at.saturating_sub(RADIUS)..(at + RADIUS + 1).min(size);
    let tap = |i: usize, j: usize| taps[j + RADIUS - i];
    let (c1, c2, two) = (R::of(C1), R::of(C2), R::of(2.0));
    let [l1, ssim, weighted_l1, weighted_dssim] = [R::zero(); 4];
    let mut out = ChannelLoss { l1, ssim, weighted_l1, weighted_dssim, grad_ssim: vec![R::zero(); x.len()] };
    for i in 0..height {
        for j in 0..width {
            if !counts[i * width + j] {
                continue;
            }
            let weight = weights[i * width + j];
            let [mut mx, mut my, mut xx, mut yy, mut xy] = [R::zero(); 5];
            for p in near(i, height) {
                for q in near(j, width) {
                    let (w, a, b) = (tap(i, p) * tap(j, q), x[p * width + q], y[p * width + q]);
                    mx += w * a;
                    my += w * b;
                    xx += w * a * a;
                    yy += w * b * b;
                    xy += w * a * b;
                }
            }
            let (v1, v2, cov) = (xx - mx * mx, yy - my * my, xy - mx * my);
            let (top_mean, top_cov) = (two * mx * my + c1, two * cov + c2);
            let (bottom_mean, bottom_var) = (mx * mx + my * my + c1, v1 + v2 + c2);
            let ssim = top_mean * top_cov / (bottom_mean * bottom_var);
            let of_var = -ssim / bottom_var;
            let of_cov = two * top_mean / (bottom_mean * bottom_var);
            let of_mean = two * my * top_cov / (bottom_mean * bottom_var)
                - two * mx * ssim / bottom_mean
                - two * mx * of_var
                - my * of_cov;
            for p in near(i, height) {
                for q in near(j, width) {
                    if !counts[p * width + q] {
                        continue;
                    }
                    let (w, a, b) = (tap(i, p) * tap(j, q), x[p * width + q], y[p * width + q]);
                    out.grad_ssim[p * width + q] += weight * w * (of_mean + two * a * of_var + b * of_cov);
                }
            }
            let l1 = (x[i * width + j] - y[i * width + j]).abs();
            out.ssim += ssim;
            out.l1 += l1;
            out.weighted_l1 += weight * l1;
            out.weighted_dssim += weight * (R::one() - ssim);
        }
    }
    out
}

/// Loss, L1, SSIM and dL/d(image).
#[derive(Clone, Debug)]
pub struct Loss<R> {
    /// (1 - lambda) L1 + lambda (1 - SSIM).
    pub total: R,
    /// Mean of |x - y|.
    pub l1: R,
    /// Mean SSIM.
    pub ssim: R,
    /// The total with weights.
    pub weighted: R,
    /// Gradient of the total with weights; the last component is 0.
    pub grad: Vec<[R; 4]>,
}

/// The loss by its definition, over the pixels that count, without weights.
pub fn loss<R: Real>(
    image: &[[R; 4]],
    photo: &[[R; 3]],
    counts: &[bool],
    width: usize,
    height: usize,
    lambda: R,
) -> Loss<R> {
    weighted_loss(image, photo, counts, &vec![R::one(); image.len()], (width, height), lambda)
}

/// The loss by its definition, with a weight per pixel.
pub fn weighted_loss<R: Real>(
    image: &[[R; 4]],
    photo: &[[R; 3]],
    counts: &[bool],
    weights: &[R],
    (width, height): (usize, usize),
    lambda: R,
) -> Loss<R> {
    let each = R::one() / R::of((3 * counts.iter().filter(|c| **c).count()) as f64);
    let [total, l1, ssim, weighted] = [R::zero(); 4];
    let mut out = Loss { total, l1, ssim, weighted, grad: vec![[R::zero(); 4]; image.len()] };
    for c in 0..3 {
        let x: Vec<R> = image.iter().map(|p| p[c]).collect();
        let y: Vec<R> = photo.iter().map(|p| p[c]).collect();
        let one = channel(&x, &y, counts, weights, width, height);
        out.l1 += one.l1 * each;
        out.ssim += one.ssim * each;
        out.weighted += ((R::one() - lambda) * one.weighted_l1 + lambda * one.weighted_dssim) * each;
        for (k, grad) in out.grad.iter_mut().enumerate() {
            let d = if counts[k] { x[k] - y[k] } else { R::zero() };
            let sign = if d == R::zero() { R::zero() } else { d.signum() };
            grad[c] = ((R::one() - lambda) * weights[k] * sign - lambda * one.grad_ssim[k]) * each;
        }
    }
    out.total = (R::one() - lambda) * out.l1 + lambda * (R::one() - out.ssim);
    out
}

/// Red, green, blue and alpha of a photograph's pixels, packed with 8 bits per channel (red lowest) or 16 (two words
/// per pixel).
pub fn codes(target: &[u32], bits: u32) -> Vec<[u32; 4]> {
    match bits {
        16 => target.chunks_exact(2).map(|t| [t[0] & 0xffff, t[0] >> 16, t[1] & 0xffff, t[1] >> 16]).collect(),
        _ => target.iter().map(|t| t.to_le_bytes().map(u32::from)).collect(),
    }
}

/// The photograph's channels from 0 to 1.
pub fn unpack<R: Real>(target: &[u32], bits: u32) -> Vec<[R; 3]> {
    let white = R::of(f64::from((1_u32 << bits) - 1));
    let colour = |p: [u32; 4]| std::array::from_fn(|c| R::of(f64::from(p[c])) / white);
    codes(target, bits).into_iter().map(colour).collect()
}

/// Which pixels of a photograph count: those whose alpha is not 0.
pub fn counting(target: &[u32], bits: u32) -> Vec<bool> {
    codes(target, bits).into_iter().map(|p| p[3] != 0).collect()
}

/// The window's weighted sums along a line of `n` values, with `outside` beyond its ends.
fn along<R: Real>(n: usize, outside: [R; 4], value: impl Fn(usize) -> [R; 4]) -> Vec<[R; 4]> {
    let taps = window::<R>();
    (0..n)
        .map(|i| {
            let mut sum = [R::zero(); 4];
            for (k, &w) in taps.iter().enumerate() {
                let at = (i + k).wrapping_sub(RADIUS);
                let v = if at < n { value(at) } else { outside };
                sum.iter_mut().zip(v).for_each(|(s, v)| *s += w * v);
            }
            sum
        })
        .collect()
}

fn padding<R: Real>() -> [R; 4] {
    [R::of(-PIVOT), R::zero(), R::zero(), R::of(2.0 * PIVOT * PIVOT)]
}

/// Moments (x, x - y, (x - y)^2, x^2 + y^2) about the pivot, weighted along rows.
fn rows<R: Real>(x: &[R], y: &[R], width: usize) -> Vec<[R; 4]> {
    let line = |(x, y): (&[R], &[R])| {
        along(x.len(), padding(), |i| {
            let (d, p, q) = (x[i] - y[i], x[i] - R::of(PIVOT), y[i] - R::of(PIVOT));
            [p, d, d * d, p * p + q * q]
        })
    };
    x.chunks(width).zip(y.chunks(width)).flat_map(line).collect()
}

/// A channel of the render and of the photograph, flattened.
#[derive(Clone, Copy, Debug)]
pub struct Compared<'a, R> {
    /// The render's values, replaced by the photograph's where pixels do not count.
    pub x: &'a [R],
    /// The photograph's values.
    pub y: &'a [R],
    /// Which pixels count.
    pub counts: &'a [bool],
    /// The weight of each pixel.
    pub weights: &'a [R],
    /// Pixels of a row.
    pub width: usize,
}

/// `loss_strips` with channels apart, one channel: SSIM's derivatives times the pixel's weight, and the SSIM of each
/// pixel. Both are 0 where the pixel does not count.
pub fn strips_apart<R: Real>(of: &Compared<'_, R>) -> (Vec<[R; 3]>, Vec<R>) {
    let Compared { x, y, counts, weights, width } = *of;
    let moments = rows(x, y, width);
    let height = x.len() / width;
    let (mut out, mut values) = (vec![[R::zero(); 3]; x.len()], vec![R::zero(); x.len()]);
    for j in 0..width {
        let means = along(height, padding(), |i| moments[i * width + j]);
        let counted = |(i, mean)| if counts[i * width + j] { point(mean) } else { (R::zero(), [R::zero(); 4]) };
        let points: Vec<(R, [R; 4])> = means.into_iter().enumerate().map(counted).collect();
        for (i, (value, [a, b, c, _])) in points.into_iter().enumerate() {
            out[i * width + j] = [a, b, c].map(|of| weights[i * width + j] * of);
            values[i * width + j] = value;
        }
    }
    (out, values)
}

/// `loss_strips` with all channels, one channel: as [`strips_apart`], with the derivatives summed along columns by the
/// window.
pub fn strips<R: Real>(of: &Compared<'_, R>) -> (Vec<[R; 3]>, Vec<R>) {
    let (derivatives, values) = strips_apart(of);
    (down_columns(&derivatives, of.width), values)
}

/// The window's weighted sums along columns.
fn down_columns<R: Real>(planes: &[[R; 3]], width: usize) -> Vec<[R; 3]> {
    let mut out = vec![[R::zero(); 3]; planes.len()];
    for j in 0..width {
        let at = |i: usize| planes[i * width + j];
        let sums = along(planes.len() / width, [R::zero(); 4], |i| [at(i)[0], at(i)[1], at(i)[2], R::zero()]);
        for (i, [a, b, c, _]) in sums.into_iter().enumerate() {
            out[i * width + j] = [a, b, c];
        }
    }
    out
}

/// SSIM, and the factors of 1, (x - y) and (x - pivot) in its derivative, from the moments in a window.
fn point<R: Real>([mean, m, square, squares]: [R; 4]) -> (R, [R; 4]) {
    let two = R::of(2.0);
    let (mu1, other) = (mean + R::of(PIVOT), mean - m);
    let mu2 = mu1 - m;
    let a = mu1 * mu1 + mu2 * mu2 + R::of(C1);
    let b = (squares - mean * mean - other * other).max(R::zero()) + R::of(C2);
    let v = (square - m * m).max(R::zero());
    let (luminance, structure) = (R::one() - m * m / a, R::one() - v / b);
    let of_b = two * luminance * v / (b * b);
    let constant = two * structure * m / a * (mu1 * m / a - R::one()) + two * luminance * m / b - of_b * mean;
    (luminance * structure, [constant, -two * luminance / b, of_b, R::zero()])
}

/// `loss_grad`, one channel: dL/dx from the planes of [`strips`], with means over `values` values.
pub fn grad<R: Real>(planes: &[[R; 3]], of: &Compared<'_, R>, lambda: R, values: R) -> Vec<R> {
    let Compared { x, y, counts, weights, width } = *of;
    let each = R::one() / values;
    let line = |row: &[[R; 3]]| along(row.len(), [R::zero(); 4], |i| [row[i][0], row[i][1], row[i][2], R::zero()]);
    let spread: Vec<[R; 4]> = planes.chunks(width).flat_map(line).collect();
    (0..planes.len())
        .map(|k| {
            let (d, s) = (x[k] - y[k], spread[k]);
            let sign = if d == R::zero() { R::zero() } else { d.signum() };
            let ssim = s[0] + d * s[1] + (x[k] - R::of(PIVOT)) * s[2];
            if counts[k] { (R::one() - lambda) * each * weights[k] * sign - lambda * each * ssim } else { R::zero() }
        })
        .collect()
}

/// A channel of the render, and the same channel of the photograph.
type Channel = (Vec<f32>, Vec<f32>);

/// Channels of the render and of the photograph, and whether each pixel counts. The render's values are the
/// photograph's where pixels are masked.
fn channels(call: &TwinCall<'_>, push: &Push, bits: u32) -> ([Channel; 3], Vec<bool>) {
    let pixels = (push.width * push.height) as usize;
    let (image, target) = (call.get::<[f32; 4]>(0), call.get::<u32>(1));
    let target = &target[..pixels * bits as usize / 8];
    let (photo, counts) = (unpack::<f32>(target, bits), counting(target, bits));
    let shown = |k: usize, c: usize| if counts[k] { image[k][c] } else { photo[k][c] };
    let one = |c| ((0..pixels).map(|k| shown(k, c)).collect(), photo.iter().map(|p| p[c]).collect());
    ([one(0), one(1), one(2)], counts)
}

/// The pixels' weights, from the saliency at a binding; all 1 without weights.
fn weights(call: &TwinCall<'_>, push: &Push, binding: usize, weighted: u32) -> Vec<f32> {
    let pixels = (push.width * push.height) as usize;
    if weighted == 0 {
        return vec![1.0; pixels];
    }
    let saliency = call.get::<f32>(binding);
    saliency[..pixels].iter().map(|s| push.low_weight + (push.high_weight - push.low_weight) * s).collect()
}

/// Planes and values of a channel.
type Strips = fn(&Compared<'_, f32>) -> (Vec<[f32; 3]>, Vec<f32>);

/// Adapter over raw buffers; the channels of a strip share their parts.
pub fn run_strips(call: &mut TwinCall<'_>) {
    strip_parts(call, 1, strips);
}

/// Adapter over raw buffers; each channel of a strip has its own parts.
pub fn run_strips_apart(call: &mut TwinCall<'_>) {
    strip_parts(call, 3, strips_apart);
}

fn strip_parts(call: &mut TwinCall<'_>, apart: usize, strips: Strips) {
    let push: Push = call.push();
    let (width, segment) = (push.width as usize, call.constants[1] as usize);
    let mut parts = vec![0.0f32; (push.height as usize).div_ceil(segment) * apart * width];
    let (channels, counts) = channels(call, &push, call.constants[2]);
    let weights = weights(call, &push, 6, call.constants[3]);
    for (c, (x, y)) in channels.into_iter().enumerate() {
        let (planes, values) = strips(&Compared { x: &x, y: &y, counts: &counts, weights: &weights, width });
        for (k, value) in values.into_iter().enumerate() {
            parts[(k / width / segment * apart + c % apart) * width + k % width] += value;
        }
        call.set(2 + c, &planes);
    }
    call.set(5, &parts);
}

/// Adapter over raw buffers, planes of [`strips`]. The first constant is the subgroup's width.
pub fn run_grad(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let (width, lanes) = (push.width as usize, call.constants[0] as usize);
    gradients(call, &push, push.height as usize * lanes, |k, _| k / width * lanes + k % width % lanes, <[_]>::to_vec);
}

/// Adapter over raw buffers, planes of [`strips_apart`]. The last constant is the number of rows of a strip.
pub fn run_grad_apart(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let (width, segment) = (push.width as usize, call.constants[3] as usize);
    let parts = (push.height as usize).div_ceil(segment) * 3 * width;
    let part = |k, c| (k / width / segment * 3 + c) * width + k % width;
    gradients(call, &push, parts, part, |planes| down_columns(planes, width));
}

/// The gradient, and sums of |x - y| in `parts` parts; `part` is that of a pixel's channel, and `filtered` gives planes
/// summed along columns.
fn gradients(
    call: &mut TwinCall<'_>,
    push: &Push,
    parts: usize,
    part: impl Fn(usize, usize) -> usize,
    filtered: impl Fn(&[[f32; 3]]) -> Vec<[f32; 3]>,
) {
    let width = push.width as usize;
    let mut parts = vec![0.0f32; parts];
    let mut out = vec![[0.0f32; 4]; width * push.height as usize];
    let (channels, counts) = channels(call, push, call.constants[1]);
    let weights = weights(call, push, 7, call.constants[2]);
    for (c, (x, y)) in channels.into_iter().enumerate() {
        let planes = call.get::<[f32; 3]>(2 + c);
        let compared = Compared { x: &x, y: &y, counts: &counts, weights: &weights, width };
        let of_channel = grad(&filtered(&planes[..x.len()]), &compared, push.lambda, push.values);
        for (k, g) in of_channel.into_iter().enumerate() {
            out[k][c] = g;
            parts[part(k, c)] += (x[k] - y[k]).abs();
        }
    }
    call.set(5, &out);
    call.set(6, &parts);
}

/// Adapter over raw buffers.
pub fn run_sum(call: &mut TwinCall<'_>) {
    let push: SumPush = call.push();
    let each = 1.0 / push.values;
    let mean = |parts: Vec<f32>, count: u32| parts[..count as usize].iter().sum::<f32>() * each;
    let ssim = mean(call.get(0), push.ssim_count);
    let l1 = mean(call.get(1), push.l1_count);
    let mut ring = call.get::<f32>(2);
    let total = (1.0 - push.lambda) * l1 + push.lambda * (1.0 - ssim);
    ring[(SLOT_FLOATS * push.slot) as usize..][..3].copy_from_slice(&[total, l1, ssim]);
    call.set(2, &ring);
}
