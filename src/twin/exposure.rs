//! Twin of `glsl/exposure_apply.comp`, `glsl/exposure_backward.comp` and `glsl/exposure_step.comp`.

use super::adam::{Element, LARGEST_GRADIENT, adam};
use super::{Real, TwinCall};
use crate::pass::adam::Push as AdamPush;
use crate::pass::exposure::{NUMBERS, PIXELS, Push, ROW, StepPush};

/// A photograph's 3x4 matrix minus the identity, from the rows of `exposures`.
pub fn deviation<R: Real>(exposures: &[R], view: usize, views: usize) -> [R; NUMBERS] {
    std::array::from_fn(|k| exposures[ROW * view + k] - exposures[ROW * views + k])
}

/// A colour under a deviation from the identity.
pub fn apply<R: Real>(e: &[R; NUMBERS], c: [R; 3]) -> [R; 3] {
    std::array::from_fn(|i| c[i] + (e[4 * i] * c[0] + e[4 * i + 1] * c[1] + e[4 * i + 2] * c[2] + e[4 * i + 3]))
}

/// The gradient of a colour from the gradient of the exposed colour; adds the matrix's gradient to `sum`.
pub fn backward<R: Real>(e: &[R; NUMBERS], c: [R; 3], g: [R; 3], sum: &mut [R; NUMBERS]) -> [R; 3] {
    for (i, g) in g.into_iter().enumerate() {
        for (j, c) in c.into_iter().enumerate() {
            sum[4 * i + j] += g * c;
        }
        sum[4 * i + 3] += g;
    }
    std::array::from_fn(|j| g[j] + (e[j] * g[0] + e[4 + j] * g[1] + e[8 + j] * g[2]))
}

/// A step of photograph `view` with its gradient minus the mean of all photographs' latest gradients. Updates the mean
/// deviation.
pub fn step<R: Real>(push: &StepPush, grad: &[R; NUMBERS], exposures: &mut [R]) {
    let settings = AdamPush {
        beta1: push.beta1,
        gain1: push.gain1,
        beta2: push.beta2,
        gain2: push.gain2,
        eps: push.eps,
        inv_bias1: push.inv_bias1,
        inv_sqrt_bias2: push.inv_sqrt_bias2,
        ..AdamPush::default()
    };
    let (view, views) = (push.view as usize, push.views as usize);
    for (k, g) in grad.iter().enumerate() {
        let at = ROW * view + k;
        let told = !g.is_nan() && g.abs() <= R::of(LARGEST_GRADIENT);
        if told {
            exposures[at + 3 * NUMBERS] = *g;
        }
        let common = fifths(views, |i| exposures[ROW * i + 3 * NUMBERS + k]) / R::of(f64::from(push.known));
        let g = if told { *g - common } else { *g };
        let (mut p, mut m, mut v) = (exposures[at], exposures[at + NUMBERS], exposures[at + 2 * NUMBERS]);
        let element = Element { param: &mut p, first: &mut m, second: &mut v };
        adam(&settings, R::of(f64::from(push.lr)), g, element);
        (exposures[at], exposures[at + NUMBERS], exposures[at + 2 * NUMBERS]) = (p, m, v);
        let sum = fifths(views, |i| exposures[ROW * i + k]);
        exposures[ROW * views + k] = sum / R::of(f64::from(push.views));
    }
}

/// A sum in the device's order: five sums of every fifth value, then their sum.
fn fifths<R: Real>(count: usize, value: impl Fn(usize) -> R) -> R {
    let run = |first: usize| (first..count).step_by(5).fold(R::zero(), |sum, i| sum + value(i));
    (0..5).fold(R::zero(), |sum, first| sum + run(first))
}

fn rgb(pixels: &[[f32; 4]], i: usize) -> [f32; 3] {
    [pixels[i][0], pixels[i][1], pixels[i][2]]
}

/// Adapter over raw buffers.
pub fn run_apply(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let (image, exposures) = (call.get::<[f32; 4]>(0), call.get::<f32>(1));
    let e = deviation(&exposures, push.view as usize, push.views as usize);
    let mut exposed = call.get::<[f32; 4]>(2);
    for i in 0..push.pixels.min(call.groups * PIXELS) as usize {
        let [r, g, b] = apply(&e, rgb(&image, i));
        exposed[i] = [r, g, b, image[i][3]];
    }
    call.set(2, &exposed);
}

/// Adapter over raw buffers. A workgroup's sum adds its threads in order, and each thread its pixels in order.
pub fn run_backward(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let (image, exposures) = (call.get::<[f32; 4]>(0), call.get::<f32>(1));
    let e = deviation(&exposures, push.view as usize, push.views as usize);
    let (mut grad, mut parts) = (call.get::<[f32; 4]>(2), call.get::<f32>(3));
    for group in 0..call.groups.min(crate::pass::exposure::parts(push.pixels)) {
        let mut total = [0.0; NUMBERS];
        for thread in 0..64 {
            let mut sum = [0.0; NUMBERS];
            let owned = (group * PIXELS + thread..(group + 1) * PIXELS).step_by(64);
            for i in owned.take_while(|i| *i < push.pixels).map(|i| i as usize) {
                let [r, g, b] = backward(&e, rgb(&image, i), rgb(&grad, i), &mut sum);
                grad[i] = [r, g, b, 0.0];
            }
            total.iter_mut().zip(sum).for_each(|(total, sum)| *total += sum);
        }
        parts[NUMBERS * group as usize..][..NUMBERS].copy_from_slice(&total);
    }
    call.set(2, &grad);
    call.set(3, &parts);
}

/// Adapter over raw buffers.
pub fn run_step(call: &mut TwinCall<'_>) {
    let push: StepPush = call.push();
    if call.groups == 0 {
        return;
    }
    let (parts, mut exposures) = (call.get::<f32>(0), call.get::<f32>(1));
    let grad = std::array::from_fn(|k| fifths(push.parts as usize, |i| parts[NUMBERS * i + k]));
    step(&push, &grad, &mut exposures);
    call.set(1, &exposures);
}
