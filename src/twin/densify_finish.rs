//! Twin of `glsl/densify_finish.comp`.

use super::TwinCall;
use crate::pass::counters::{BAD_SPLATS, CLONED, NEXT_ID, PRUNED, SCAN_TOTAL, SPLATS, SPLIT, STATUS};
use crate::pass::densify_finish::Push;

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let stride = call.push::<Push>().stride as usize;
    let mut counters = call.get::<u32>(0);
    let (offsets, tally) = (call.get::<u32>(1), call.get::<u32>(2));
    if call.groups == 0 || counters[STATUS] != 0 {
        return;
    }
    let kept = offsets[stride];
    let total = counters[SCAN_TOTAL];
    counters[CLONED] = offsets[2 * stride] - kept;
    let replaced = offsets[3 * stride] - offsets[2 * stride];
    counters[SPLIT] = total - offsets[3 * stride];
    counters[PRUNED] = counters[SPLATS] - kept - replaced;
    counters[BAD_SPLATS] = counters[BAD_SPLATS].wrapping_add(tally[0]);
    counters[NEXT_ID] = counters[NEXT_ID].wrapping_add(total - kept);
    counters[SPLATS] = total;
    call.set(0, &counters);
}
