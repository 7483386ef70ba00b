//! Twin of `glsl/densify_limit.comp`.

use super::{TwinCall, random};
use crate::pass::counters::{SCAN_TOTAL, SPLATS};
use crate::pass::densify_limit::Push;

/// Key that separates this draw from the draws keyed by a splat.
const DRAW_PLACE: u32 = 3;

/// Withdraws growth past `push.max_splats` from `flags` (four segments of `push.stride` words), evenly over the order
/// of birth. `total` is the sum of the flags.
pub fn limit(flags: &mut [u32], splats: usize, total: u32, push: &Push) {
    let stride = push.stride as usize;
    let sum = |kind: usize| flags[kind * stride..(kind + 1) * stride].iter().sum::<u32>();
    let growth = sum(1) + sum(3);
    let admitted = growth.saturating_sub(total.saturating_sub(push.max_splats));
    if growth == 0 {
        return;
    }
    let place = random::bits([push.seed, push.event, 0, DRAW_PLACE])[0] % growth;
    let mut rank = 0;
    for i in 0..splats {
        let grows = flags[stride + i] + flags[3 * stride + i];
        let step = (u64::from(admitted) * u64::from(rank) + u64::from(place)) % u64::from(growth);
        if admitted < growth && step >= u64::from(admitted) {
            if flags[3 * stride + i] != 0 {
                flags[i] = 1;
            }
            for kind in 1..4 {
                flags[kind * stride + i] = 0;
            }
        }
        rank += grows;
    }
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let counters = call.get::<u32>(0);
    let mut flags = call.get::<u32>(2);
    let splats = counters[SPLATS].min(push.stride).min(64 * call.groups) as usize;
    limit(&mut flags, splats, counters[SCAN_TOTAL], &push);
    call.set(2, &flags);
}
