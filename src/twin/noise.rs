//! Twin of `glsl/noise.comp`.

use super::TwinCall;
use super::projection::{rotation, sigmoid};
use super::random::{Elementary, normals};
use super::vec3;
use crate::pass::counters::SPLATS;
use crate::pass::noise::Push;

/// Last part of the key of a draw.
const STREAM: u32 = 0x401ce;
const SHARPNESS: f64 = 100.0;
/// Opacity with half of the noise.
const FAINT: f64 = 0.005;

/// How far the noise moves a splat whose draw has the key (seed, step, identity).
pub fn displacement<R: Elementary>(quat: [R; 4], log_scale: [R; 3], logit: R, rate: R, key: [u32; 3]) -> [R; 3] {
    let rows = rotation(quat).rows;
    let draw = normals::<R>([key[0], key[1], key[2], STREAM]);
    let variance = log_scale.map(|s| s.exp() * s.exp());
    let local = vec3::mul(variance, vec3::combine(draw, rows));
    let gain = rate * sigmoid(R::of(SHARPNESS) * (R::of(FAINT) - sigmoid(logit)[0]))[0];
    rows.map(|row| gain * vec3::dot(row, local))
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let splats = call.get::<u32>(0)[SPLATS].min(64 * call.groups) as usize;
    let (quats, scales) = (call.get::<[f32; 4]>(2), call.get::<[f32; 3]>(3));
    let (opacities, ids) = (call.get::<f32>(4), call.get::<u32>(5));
    let mut means = call.get::<[f32; 3]>(1);
    for (i, mean) in means.iter_mut().enumerate().take(splats) {
        let moved = displacement(quats[i], scales[i], opacities[i], push.rate, [push.seed, push.step, ids[i]]);
        if moved.iter().all(|v| v.is_finite()) {
            *mean = vec3::add(*mean, moved);
        }
    }
    call.set(1, &means);
}
