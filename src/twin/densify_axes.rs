//! Twin of `glsl/densify_axes.comp`.

use super::TwinCall;
use super::densify_map::{along, longest_axis, unpack};
use super::project_backward_adam_packed;
use super::random::Elementary;
use crate::pass::counters::SCAN_TOTAL;
use crate::pass::densify_axes::Push;

/// Magnitude of the loss's change over one standard deviation along each axis of a splat, times the square of the
/// quaternion's length.
pub fn slopes<R: Elementary>(quat: [R; 4], log_scales: [R; 3], gradient: [R; 3]) -> [R; 3] {
    let ([w, x, y, z], two) = (quat, R::of(2.0));
    let columns = [
        [(w * w + x * x) - (y * y + z * z), two * (x * y + w * z), two * (x * z - w * y)],
        [two * (x * y - w * z), (w * w + y * y) - (x * x + z * z), two * (y * z + w * x)],
        [two * (x * z + w * y), two * (y * z - w * x), (w * w + z * z) - (x * x + y * y)],
    ];
    let dot = |c: [R; 3]| (c[0] * gradient[0] + c[1] * gradient[1]) + c[2] * gradient[2];
    let size = |v: R| v.max(-v);
    std::array::from_fn(|k| size(dot(columns[k])) * log_scales[k].exponential())
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let rows = call.get::<u32>(0)[SCAN_TOTAL].min(64 * call.groups) as usize;
    let (quats, scales, moments) = (call.get::<[f32; 4]>(1), call.get::<[f32; 3]>(2), call.get::<[u32; 3]>(3));
    let mut map = call.get::<u32>(4);
    let first = |word: u32| match push.packed_moments {
        0 => f32::from_bits(word),
        _ => project_backward_adam_packed::unpack(word).0,
    };
    for entry in &mut map[..rows] {
        let (i, kind) = unpack(*entry);
        if kind >= 2 {
            let slopes = slopes(quats[i], scales[i], moments[i].map(first));
            let axis = longest_axis(slopes);
            if slopes[axis] > 0.0 {
                *entry = along(*entry, axis);
            }
        }
    }
    call.set(4, &map);
}
