//! Twin of `glsl/saliency_plane.comp`.

use super::TwinCall;
use super::place::ByteMask;
use crate::pass::saliency_plane::Push;

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let (size, mask_size) = ([push.width, push.of_height], [push.mask_width, push.mask_height]);
    let [size, mask_size] = [size, mask_size].map(|s| s.map(|v| v as usize));
    let bytes = call.get::<u8>(0);
    let mask = ByteMask { bytes: &bytes, size: mask_size };
    let mut saliency = call.get::<f32>(1);
    let pixels = (push.width as usize * push.height as usize).min(64 * call.groups as usize);
    for (k, value) in saliency.iter_mut().enumerate().take(pixels) {
        *value = mask.at([k % size[0], push.top as usize + k / size[0]], size);
    }
    call.set(1, &saliency);
}
