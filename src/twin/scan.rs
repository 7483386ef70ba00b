//! Twins of `glsl/scan_reduce.comp`, `scan_spine.comp`, `scan_add.comp` and `scan_once.comp`.

use super::TwinCall;
use super::plan::{given_count, table_size};
use crate::pass::plan::NO_COUNTER;
use crate::pass::scan::{LOCAL_SIZE, Push};

/// The saturating sum.
pub fn total(words: impl Iterator<Item = u32>) -> u32 {
    words.fold(0, u32::saturating_add)
}

/// Exclusive prefix sum and total, modulo 2^32.
pub fn exclusive(words: impl Iterator<Item = u32>) -> (Vec<u32>, u32) {
    let mut sum = 0u32;
    let prefix = words
        .map(|word| {
            let before = sum;
            sum = sum.wrapping_add(word);
            before
        })
        .collect();
    (prefix, sum)
}

fn value(push: &Push, word: u32) -> u32 {
    if push.predicate != 0 { u32::from(word != 0) } else { word }
}

fn block(call: &TwinCall<'_>) -> usize {
    (LOCAL_SIZE * call.constants[0]) as usize
}

/// Adapter of `scan_reduce`.
pub fn reduce(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let source = call.get::<u32>(0);
    let n = table_size(given_count(&call.get::<u32>(1), push.source, push.count), push.divide, push.multiply) as usize;
    let sums: Vec<u32> = source[..n]
        .chunks(block(call))
        .take(call.groups as usize)
        .map(|words| exclusive(words.iter().map(|&w| value(&push, w))).1)
        .collect();
    call.set(2, &sums);
}

/// Adapter of `scan_spine`.
pub fn spine(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let mut counters = call.get::<u32>(0);
    let n = table_size(given_count(&counters, push.source, push.count), push.divide, push.multiply) as usize;
    let sums = call.get::<u32>(1);
    let sums = &sums[..n.div_ceil(block(call))];
    let (prefix, _) = exclusive(sums.iter().copied());
    if push.total != NO_COUNTER {
        counters[push.total as usize] = total(sums.iter().copied());
    }
    call.set(0, &counters);
    call.set(1, &prefix);
}

/// Adapter of `scan_add`.
pub fn add(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let source = call.get::<u32>(0);
    let n = table_size(given_count(&call.get::<u32>(1), push.source, push.count), push.divide, push.multiply) as usize;
    let sums = call.get::<u32>(2);
    let target: Vec<u32> = source[..n]
        .chunks(block(call))
        .take(call.groups as usize)
        .zip(sums)
        .flat_map(|(words, base)| {
            let (prefix, _) = exclusive(words.iter().map(|&w| value(&push, w)));
            prefix.into_iter().map(move |p| base.wrapping_add(p))
        })
        .collect();
    call.set(3, &target);
}

/// Adapter of `scan_once`.
pub fn once(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let (source, mut counters) = (call.get::<u32>(0), call.get::<u32>(1));
    let n = table_size(given_count(&counters, push.source, push.count), push.divide, push.multiply) as usize;
    let words = || source[..n].iter().map(|&w| value(&push, w));
    let (prefix, _) = exclusive(words());
    if push.total != NO_COUNTER {
        counters[push.total as usize] = total(words());
    }
    call.set(1, &counters);
    call.set(2, &prefix);
}
