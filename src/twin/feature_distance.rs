//! Twins of `glsl/feature_distance.comp` and `glsl/distance_sum.comp`.

use super::{Real, TwinCall};
use crate::pass::feature_distance::{FLAG_GATE, FLAG_GRADIENT, Push, SumPush};

/// The distance of two features, and its gradient with respect to the first:
/// sum of w (f / (|f| + eps) - g / (|g| + eps))^2.
pub fn distance<R: Real>(f: &[R], g: &[R], weights: &[R], eps: R) -> (R, Vec<R>) {
    let length = |v: &[R]| v.iter().fold(R::zero(), |sum, &x| sum + x * x).sqrt();
    let (norm, other) = (length(f), length(g));
    let two = R::of(2.0);
    let differences: Vec<R> = f.iter().zip(g).map(|(&f, &g)| f / (norm + eps) - g / (other + eps)).collect();
    let weighted = || weights.iter().zip(&differences).map(|(&w, &d)| (w * d, d));
    let value = weighted().fold(R::zero(), |sum, (wd, d)| sum + wd * d);
    let along = weighted().zip(f).fold(R::zero(), |sum, ((wd, _), &f)| sum + wd * f);
    // A zero feature has no radial direction.
    let radial = if norm > R::zero() { along / (norm * (norm + eps) * (norm + eps)) } else { R::zero() };
    let grad = weighted().zip(f).map(|((wd, _), &f)| two * (wd / (norm + eps) - f * radial)).collect();
    (value, grad)
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let channels = 4 * push.quads as usize;
    let (features, weights) = (call.get::<f32>(0), call.get::<f32>(1));
    let (mut parts, mut grads) = (call.get::<f32>(2), call.get::<f32>(3));
    let weights = &weights[4 * push.weight_row as usize..][..channels];
    let each = 1.0 / push.pixels as f32;
    for pixel in 0..push.pixels as usize {
        let of = |pixel: usize| &features[pixel * channels..][..channels];
        let f = of(pixel);
        let (value, grad) = distance(f, of(pixel + push.pixels as usize), weights, push.eps);
        parts[push.part_first as usize + pixel] = value * each;
        if push.flags & FLAG_GRADIENT != 0 {
            let open = |f: f32| push.flags & FLAG_GATE == 0 || f > 0.0;
            let gated = f.iter().zip(grad).map(|(&f, g)| if open(f) { g * each } else { 0.0 });
            grads[pixel * channels..].iter_mut().zip(gated).for_each(|(to, g)| *to = g);
        }
    }
    call.set(2, &parts);
    call.set(3, &grads);
}

/// Adapter over raw buffers.
pub fn run_sum(call: &mut TwinCall<'_>) {
    let push: SumPush = call.push();
    let parts = call.get::<f32>(0);
    let ends = &push.ends[..push.layers as usize];
    let begins = std::iter::once(&0).chain(ends);
    let sum = |(begin, end): (&u32, &u32)| parts[*begin as usize..*end as usize].iter().sum::<f32>();
    let mut sums: Vec<f32> = begins.zip(ends).map(sum).collect();
    sums.push(sums.iter().sum());
    call.set(1, &sums);
}
