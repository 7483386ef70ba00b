//! Twins of `glsl/crop_pair.comp` and `glsl/crop_gradient.comp`.

use super::TwinCall;
use super::loss::unpack;
use crate::pass::crop::{GradientPush, Push};

/// Whether a pixel with 8 bits per channel is masked.
fn masked(photograph: u32) -> bool {
    photograph >> 24 == 0
}

/// Adapter over raw buffers.
pub fn run_pair(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let (image, target) = (call.get::<[f32; 4]>(0), call.get::<u32>(1));
    let pixels = (push.width * push.height) as usize;
    let mut pair = vec![[0.0f32; 4]; 2 * pixels];
    for y in 0..push.height {
        for x in 0..push.width {
            let from = ((push.top + y) * push.image_width + push.left + x) as usize;
            let to = (y * push.width + x) as usize;
            let [r, g, b] = unpack::<f32>(&target[from..=from], 8)[0];
            let render = if push.cropped != 0 { to } else { from };
            let shown = if masked(target[from]) { [r, g, b, 0.0] } else { image[render] };
            pair[to] = [shown[0], shown[1], shown[2], 0.0];
            pair[pixels + to] = [r, g, b, 0.0];
        }
    }
    call.set(2, &pair);
}

/// Adapter over raw buffers.
pub fn run_gradient(call: &mut TwinCall<'_>) {
    let push: GradientPush = call.push();
    let (blocks, target) = (call.get::<[f32; 4]>(0), call.get::<u32>(1));
    let mut grad = call.get::<[f32; 4]>(2);
    for y in 0..push.height {
        for x in 0..push.width {
            let at = ((push.top + y) * push.image_width + push.left + x) as usize;
            let block = (y / 2) * push.width.div_ceil(2) + x / 2;
            let from = blocks[(4 * block + 2 * (y % 2) + x % 2) as usize];
            let to = if push.cropped != 0 { (y * push.width + x) as usize } else { at };
            if !masked(target[at]) {
                (0..3).for_each(|c| grad[to][c] += push.weight * from[c]);
            }
        }
    }
    call.set(2, &grad);
}
