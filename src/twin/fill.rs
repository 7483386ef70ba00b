//! Twin of `glsl/fill.comp`.

use super::TwinCall;
use crate::pass::fill::Push;

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let mut target = call.get::<u32>(0);
    let threads = (call.groups as usize * 64).min(push.count as usize);
    target[..threads].fill(push.value);
    call.set(0, &target);
}
