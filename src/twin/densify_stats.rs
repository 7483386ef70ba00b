//! Twin of `glsl/densify_stats.comp`.

use super::{Real, TwinCall};
use crate::pass::counters::SPLATS;
use crate::pass::densify_stats::Push;

/// A splat's statistics after one more view. `grad2d` is its row of 12, `half_size` half the image in pixels; `stats`
/// is (sum of signed norms, sum of absolute norms, views, a value of the optimiser).
pub fn add_view<R: Real>(stats: [R; 4], grad2d: &[R], half_size: [R; 2]) -> [R; 4] {
    let norm = |x: R, y: R| {
        let (x, y) = (x * half_size[0], y * half_size[1]);
        (x * x + y * y).sqrt()
    };
    [stats[0] + norm(grad2d[0], grad2d[1]), stats[1] + norm(grad2d[10], grad2d[11]), stats[2] + R::one(), stats[3]]
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let splats = call.get::<u32>(0)[SPLATS].min(64 * call.groups) as usize;
    let tile_counts = call.get::<u32>(1);
    let (grad2d, mut stats) = (call.get::<f32>(2), call.get::<[f32; 4]>(3));
    for i in (0..splats).filter(|&i| tile_counts[i] > 0) {
        stats[i] = add_view(stats[i], &grad2d[12 * i..12 * i + 12], [push.half_width, push.half_height]);
    }
    call.set(3, &stats);
}
