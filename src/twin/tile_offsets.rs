//! Twin of `glsl/tile_offsets.comp`.

use super::TwinCall;
use super::plan::fold;
use crate::pass::counters;
use crate::pass::tile_offsets::Push;

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let Push { columns, rows, capacity, void_entries, first, per_group, per_sum } = call.push();
    let mut counts = call.get::<u32>(0);
    let mut edges = call.get::<u32>(1);
    let mut ranges = call.get::<[u32; 2]>(2);
    let mut args = call.get::<[u32; 4]>(3);
    if counts[counters::STATUS] != 0 {
        args[..void_entries as usize].fill([0; 4]);
        return call.set(3, &args);
    }
    // A count of splats fits a word, but the number of all pairs need not.
    let (mut here, mut pairs) = (0u32, 0u64);
    let mut edge = edges.iter_mut();
    for row in 0..rows as usize {
        for column in 0..=columns as usize {
            let Some(word) = edge.next() else { return };
            here = here.wrapping_add(*word);
            *word = pairs as u32;
            if column < columns as usize {
                ranges[row * columns as usize + column] = [pairs as u32; 2];
            }
            pairs += u64::from(here);
        }
    }
    counts[counters::VISIBLE] = edge.next().map_or(0, |word| *word);
    let pairs = u32::try_from(pairs).unwrap_or(u32::MAX);
    counts[counters::PAIRS] = pairs;
    counts[counters::WANT_PAIRS] = counts[counters::WANT_PAIRS].max(pairs);
    if pairs > capacity {
        counts[counters::STATUS] = counters::PAIRS_BIT;
        args[..void_entries as usize].fill([0; 4]);
    } else {
        let visible = counts[counters::VISIBLE];
        args[first as usize] = fold(visible.div_ceil(per_group));
        args[first as usize + 1] = fold(visible.div_ceil(per_sum));
    }
    call.set(0, &counts);
    call.set(1, &edges);
    call.set(2, &ranges);
    call.set(3, &args);
}
