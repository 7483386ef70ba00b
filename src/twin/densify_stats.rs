//! Twin of `glsl/densify_stats.comp`.

use super::{Real, TwinCall};
use crate::pass::counters::SPLATS;
use crate::pass::densify_stats::Push;

/// 3 standard deviations of a splat along its longer axis in pixels, from its conic (A, B, C).
pub fn screen_radius<R: Real>(conic: [R; 3]) -> R {
    let [a, b, c] = conic;
    let larger = R::of(0.5) * (a + c) + (R::of(0.25) * (a - c) * (a - c) + b * b).sqrt();
    R::of(3.0) * (larger / (a * c - b * b).max(R::of(1e-20))).sqrt()
}

/// A splat's statistics after one more view. `splat2d` and `grad2d` are its rows of 12, `half_size` half the image in
/// pixels; `stats` is (sum of signed norms, sum of absolute norms, views, largest radius).
pub fn add_view<R: Real>(stats: [R; 4], splat2d: &[R], grad2d: &[R], half_size: [R; 2]) -> [R; 4] {
    let norm = |x: R, y: R| {
        let (x, y) = (x * half_size[0], y * half_size[1]);
        (x * x + y * y).sqrt()
    };
    [
        stats[0] + norm(grad2d[0], grad2d[1]),
        stats[1] + norm(grad2d[10], grad2d[11]),
        stats[2] + R::one(),
        stats[3].max(screen_radius([splat2d[2], splat2d[3], splat2d[4]])),
    ]
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let splats = call.get::<u32>(0)[SPLATS].min(64 * call.groups) as usize;
    let tile_counts = call.get::<u32>(1);
    let (splat2d, grad2d, mut stats) = (call.get::<f32>(2), call.get::<f32>(3), call.get::<[f32; 4]>(4));
    for i in (0..splats).filter(|&i| tile_counts[i] > 0) {
        let row = 12 * i..12 * i + 12;
        stats[i] = add_view(stats[i], &splat2d[row.clone()], &grad2d[row], [push.half_width, push.half_height]);
    }
    call.set(4, &stats);
}
