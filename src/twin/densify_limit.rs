//! Twin of `glsl/densify_limit.comp`.

use super::TwinCall;
use crate::pass::counters::{SCAN_TOTAL, SPLATS};
use crate::pass::densify_limit::Push;

/// Withdraws the growth of the last sources from `flags` (four segments of `stride` words). `total` is the sum of the flags.
pub fn limit(flags: &mut [u32], stride: usize, splats: usize, total: u32, max_splats: u32) {
    let sum = |kind: usize| flags[kind * stride..(kind + 1) * stride].iter().sum::<u32>();
    let growth = sum(1) + sum(3);
    let admitted = growth.saturating_sub(total.saturating_sub(max_splats));
    let mut rank = 0;
    for i in 0..splats {
        let grows = flags[stride + i] + flags[3 * stride + i];
        if rank >= admitted {
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
    limit(&mut flags, push.stride as usize, splats, counters[SCAN_TOTAL], push.max_splats);
    call.set(2, &flags);
}
