//! Twin of `glsl/densify_scores.comp`.

use super::loss::{counting, unpack};
use super::{Real, TwinCall};
use crate::pass::counters::SPLATS;
use crate::pass::densify_scores::Push;

/// A splat's scores after one more view, from the values at its centre: mask value, absolute gradient of the 2D mean
/// per pixel, half the image's size in pixels, and whether the render is wrong.
pub fn add_view<R: Real>(scores: [R; 2], mask: R, gradient: [R; 2], half_size: [R; 2], wrong: bool) -> [R; 2] {
    let (x, y) = (gradient[0] * half_size[0], gradient[1] * half_size[1]);
    [scores[0] + mask * (x * x + y * y).sqrt(), if wrong { scores[1] + R::one() } else { scores[1] }]
}

/// The pixel that contains a centre; the nearest pixel where the centre is outside the image.
pub fn pixel(mean: [f32; 2], width: u32, height: u32) -> usize {
    let [column, row] = [(mean[0], width), (mean[1], height)].map(|(x, size)| x.clamp(0.0, (size - 1) as f32) as usize);
    row * width as usize + column
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let bits = call.constants[0];
    let splats = call.get::<u32>(0)[SPLATS].min(64 * call.groups) as usize;
    let tile_counts = call.get::<u32>(1);
    let (splat2d, grad2d, image) = (call.get::<f32>(2), call.get::<f32>(3), call.get::<[f32; 4]>(4));
    let target = call.get::<u32>(5);
    let (colours, counted) = (unpack::<f32>(&target, bits), counting(&target, bits));
    let (mask, mut scores) = (call.get::<f32>(6), call.get::<[f32; 2]>(7));
    for i in (0..splats).filter(|&i| tile_counts[i] > 0) {
        let k = pixel([splat2d[12 * i], splat2d[12 * i + 1]], push.width, push.height);
        let difference: f32 = (0..3).map(|c| (image[k][c] - colours[k][c]).abs()).sum();
        let wrong = counted[k] && difference > 3.0 * push.error;
        let value = if push.masked == 0 { 0.0 } else { mask[k] };
        let half_size = [0.5 * push.width as f32, 0.5 * push.height as f32];
        scores[i] = add_view(scores[i], value, [grad2d[12 * i + 10], grad2d[12 * i + 11]], half_size, wrong);
    }
    call.set(7, &scores);
}
