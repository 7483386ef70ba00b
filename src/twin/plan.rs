//! Twins of `glsl/plan.comp` and `glsl/finish.comp`, which begin and end an event.

use super::TwinCall;
use crate::pass::plan::{MOST_ENTRIES, MOST_ON_AXIS, NO_COUNTER, Push};
use crate::pass::{counters, finish};

/// `ceil(count / divide) * multiply`.
pub fn table_size(count: u32, divide: u32, multiply: u32) -> u32 {
    count.div_ceil(divide).wrapping_mul(multiply)
}

/// The number of items that a pass works on: from a counter, or from the host.
pub fn given_count(counters: &[u32], source: u32, count: u32) -> u32 {
    if source == NO_COUNTER { count } else { counters[source as usize] }
}

/// Workgroups per axis for a number of workgroups.
pub fn fold(groups: u32) -> [u32; 4] {
    if groups == 0 {
        return [0; 4];
    }
    let rows = groups.div_ceil(MOST_ON_AXIS);
    [groups.div_ceil(rows), rows, 1, 0]
}

/// Checks the count against its capacity and writes the entries of `args`.
pub fn plan(push: &Push, counts: &mut [u32], args: &mut [[u32; 4]]) {
    let count = counts[push.source as usize];
    let mut go = counts[counters::STATUS] == 0;
    if go {
        if push.want != NO_COUNTER {
            let want = &mut counts[push.want as usize];
            *want = (*want).max(count);
        }
        if count > push.capacity {
            counts[counters::STATUS] = push.status_bit;
            go = false;
        }
    }
    if !go {
        args[..push.void_entries as usize].fill([0; 4]);
    }
    for i in 0..(push.entries as usize).min(MOST_ENTRIES) {
        let groups = match push.items[i] {
            _ if !go => 0,
            0 => push.multiply[i],
            items => table_size(count, push.divide[i], push.multiply[i]).div_ceil(items),
        };
        args[push.first as usize + i] = fold(groups);
    }
}

/// Adapter over raw buffers: `plan`.
pub fn run(call: &mut TwinCall<'_>) {
    let mut counts = call.get::<u32>(0);
    let mut args = call.get::<[u32; 4]>(1);
    plan(&call.push(), &mut counts, &mut args);
    call.set(0, &counts);
    call.set(1, &args);
}

/// Adapter over raw buffers: `finish`.
pub fn run_finish(call: &mut TwinCall<'_>) {
    let push: finish::Push = call.push();
    let mut counts = call.get::<u32>(0);
    if counts[counters::STATUS] == 0 {
        counts[counters::DONE] = push.event;
        if push.constrain != 0 {
            counts[counters::CONSTRAINED] = counts[counters::NEXT_ID];
        }
        if push.caught_up != finish::NOT_CAUGHT_UP {
            counts[counters::CAUGHT_UP] = push.caught_up;
        }
    }
    let loss = call.get::<u32>(1);
    call.set(2, &[&counts[..counters::COUNT], &loss[..3]].concat());
    counts[counters::BAD_SPLATS] = 0;
    call.set(0, &counts);
}
