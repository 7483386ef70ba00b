//! Twin of `glsl/opacity_reset.comp`.

use super::TwinCall;
use crate::pass::counters::SPLATS;
use crate::pass::opacity_reset::Push;

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let cap = call.push::<Push>().logit_cap;
    let splats = call.get::<u32>(0)[SPLATS].min(64 * call.groups) as usize;
    let mut opacities = call.get::<f32>(1);
    for opacity in opacities[..splats].iter_mut().filter(|o| **o > cap) {
        *opacity = cap;
    }
    call.set(1, &opacities);
    call.set(2, &vec![0.0_f32; splats]);
    call.set(3, &vec![0.0_f32; splats]);
}
