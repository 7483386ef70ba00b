//! Twin of `glsl/finish.comp`.

use super::TwinCall;
use crate::pass::counters;
use crate::pass::finish::{NOT_CAUGHT_UP, Push};

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let mut counts = call.get::<u32>(0);
    if counts[counters::STATUS] == 0 {
        counts[counters::DONE] = push.event;
        if push.constrain != 0 {
            counts[counters::CONSTRAINED] = counts[counters::NEXT_ID];
        }
        if push.caught_up != NOT_CAUGHT_UP {
            counts[counters::CAUGHT_UP] = push.caught_up;
        }
    }
    let loss = call.get::<u32>(1);
    call.set(2, &[&counts[..counters::COUNT], &loss[..3]].concat());
    counts[counters::BAD_SPLATS] = 0;
    call.set(0, &counts);
}
