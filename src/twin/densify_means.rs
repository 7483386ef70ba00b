//! Twin of `glsl/densify_means.comp`.

use super::TwinCall;
use super::densify_map::{axis, unpack};
use super::random::{Elementary, normals};
use crate::pass::counters::SCAN_TOTAL;
use crate::pass::densify_means::Push;

/// `v` rotated by a quaternion (w, x, y, z) of any length.
fn rotate<R: Elementary>(q: [R; 4], v: [R; 3]) -> [R; 3] {
    let (one, two) = (R::one(), R::of(2.0));
    let norm = (((q[0] * q[0] + q[1] * q[1]) + q[2] * q[2]) + q[3] * q[3]).sqrt();
    let scale = one / norm.max(R::of(1e-12));
    let [w, x, y, z] = q.map(|c| c * scale);
    let row = |a: R, b: R, c: R| (a * v[0] + b * v[1]) + c * v[2];
    [
        row(one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)),
        row(two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x)),
        row(two * (x * z - w * y), two * (y * z + w * x), one - two * (x * x + y * y)),
    ]
}

/// The centre of child 0 or 1 of a splat: a draw from its Gaussian. The key is (seed, event, parent's id, child).
pub fn child_mean<R: Elementary>(mean: [R; 3], quat: [R; 4], log_scales: [R; 3], key: [u32; 4]) -> [R; 3] {
    placed(mean, quat, log_scales, normals::<R>(key))
}

/// The centre of a child at `place`, given in standard deviations along the parent's axes.
fn placed<R: Elementary>(mean: [R; 3], quat: [R; 4], log_scales: [R; 3], place: [R; 3]) -> [R; 3] {
    let offset = rotate(quat, std::array::from_fn(|k| place[k] * log_scales[k].exponential()));
    std::array::from_fn(|k| mean[k] + offset[k])
}

/// Half a standard deviation along an axis: positive for the first child, negative for the second.
fn axis_place(axis: usize, kind: usize) -> [f32; 3] {
    let mut place = [0.0; 3];
    place[axis] = if kind == 2 { 0.5 } else { -0.5 };
    place
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let rows = call.get::<u32>(0)[SCAN_TOTAL].min(64 * call.groups) as usize;
    let (map, old_ids) = (call.get::<u32>(1), call.get::<u32>(2));
    let (source, quats, scales) = (call.get::<[u32; 3]>(3), call.get::<[f32; 4]>(4), call.get::<[f32; 3]>(5));
    let mut means = call.get::<[u32; 3]>(6);
    for row in 0..rows {
        let (i, kind) = unpack(map[row]);
        means[row] = source[i];
        if kind >= 2 {
            let key = [push.seed, push.event, old_ids[i], kind as u32 - 2];
            let place = match push.along_axis {
                0 => normals::<f32>(key),
                _ => axis_place(axis(map[row], scales[i]), kind),
            };
            means[row] = placed(source[i].map(f32::from_bits), quats[i], scales[i], place).map(f32::to_bits);
        }
    }
    call.set(6, &means);
}
