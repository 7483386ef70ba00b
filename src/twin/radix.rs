//! Twins of `glsl/radix_count.comp`, `glsl/radix_rows.comp` and `glsl/radix_scatter.comp`.

use super::TwinCall;
use super::plan::given_count;
use super::scan::exclusive;
use crate::pass::radix::{GROUPS_LOCAL_SIZE, Push, RUNS_LOCAL_SIZE};

/// Digit counts of each block of keys as a table, digit by digit, a word per block.
pub fn count(keys: &[u32], block: usize, push: &Push) -> Vec<u32> {
    let blocks = keys.len().div_ceil(block);
    let mut table = vec![0; blocks * push.digits as usize];
    for (b, keys) in keys.chunks(block).enumerate() {
        for key in keys {
            table[((key >> push.shift) & push.mask) as usize * blocks + b] += 1;
        }
    }
    table
}

/// The new position of each key, from the prefix sum of the table.
pub fn places(keys: &[u32], block: usize, push: &Push, prefix: &[u32]) -> Vec<u32> {
    let blocks = keys.len().div_ceil(block);
    let mut next = prefix.to_vec();
    let mut to = Vec::with_capacity(keys.len());
    for (b, keys) in keys.chunks(block).enumerate() {
        for key in keys {
            let place = &mut next[((key >> push.shift) & push.mask) as usize * blocks + b];
            to.push(*place);
            *place += 1;
        }
    }
    to
}

/// Prefix sums of the rows of a table, followed by the sums of the rows.
pub fn row_sums(table: &[u32], digits: usize) -> Vec<u32> {
    let blocks = table.len() / digits.max(1);
    let (mut places, mut sums) = (Vec::with_capacity(table.len() + digits), Vec::with_capacity(digits));
    for digit in 0..digits {
        let (prefix, sum) = exclusive(table[digit * blocks..][..blocks].iter().copied());
        places.extend(prefix);
        sums.push(sum);
    }
    places.extend(sums);
    places
}

/// The prefix sum of the whole table, from the result of [`row_sums`].
pub fn whole(places: &[u32], digits: usize) -> Vec<u32> {
    let blocks = places.len() / digits.max(1) - 1;
    let (rows, sums) = places.split_at(blocks * digits);
    let (begins, _) = exclusive(sums.iter().copied());
    rows.iter().enumerate().map(|(i, place)| begins[i / blocks].wrapping_add(*place)).collect()
}

fn count_blocks(call: &mut TwinCall<'_>, block: u32, covered: u32) {
    let push: Push = call.push();
    let n = given_count(&call.get::<u32>(1), push.source, push.count) as usize;
    debug_assert!(covered as usize >= n.div_ceil(block as usize), "a radix pass covers all keys");
    let table = count(&call.get::<u32>(0)[..n], block as usize, &push);
    call.set(2, &table);
}

fn scatter_blocks(call: &mut TwinCall<'_>, block: u32, covered: u32, by_rows: bool) {
    let push: Push = call.push();
    let n = given_count(&call.get::<u32>(2), push.source, push.count) as usize;
    debug_assert!(covered as usize >= n.div_ceil(block as usize), "a radix pass covers all keys");
    let keys = call.get::<u32>(0);
    let vals = call.get::<u32>(1);
    let table = n.div_ceil(block as usize) * push.digits as usize;
    let prefix = match by_rows {
        true => whole(&call.get::<u32>(3)[..table + push.digits as usize], push.digits as usize),
        false => call.get::<u32>(3),
    };
    let to = places(&keys[..n], block as usize, &push, &prefix);
    let mut keys_out = call.get::<u32>(4);
    let mut vals_out = call.get::<u32>(5);
    for (i, &place) in to.iter().enumerate() {
        keys_out[place as usize] = keys[i];
        vals_out[place as usize] = vals[i];
    }
    call.set(4, &keys_out);
    call.set(5, &vals_out);
}

/// Adapter of the count, RUNS shape.
pub fn count_runs(call: &mut TwinCall<'_>) {
    count_blocks(call, call.constants[0], call.groups * RUNS_LOCAL_SIZE);
}

/// Adapter of the count, GROUPS shape.
pub fn count_groups(call: &mut TwinCall<'_>) {
    count_blocks(call, call.constants[0] * GROUPS_LOCAL_SIZE, call.groups);
}

/// Adapter of the scatter, RUNS shape.
pub fn scatter_runs(call: &mut TwinCall<'_>) {
    scatter_blocks(call, call.constants[0], call.groups * RUNS_LOCAL_SIZE, false);
}

/// Adapter of the scatter, GROUPS shape.
pub fn scatter_groups(call: &mut TwinCall<'_>) {
    scatter_blocks(call, call.constants[0] * GROUPS_LOCAL_SIZE, call.groups, true);
}

/// Adapter of the prefix sums of the rows.
pub fn rows(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let n = given_count(&call.get::<u32>(0), push.source, push.count);
    let words = n.div_ceil(call.constants[0] * GROUPS_LOCAL_SIZE) * push.digits;
    debug_assert!(call.groups >= push.digits, "a workgroup per digit");
    let places = row_sums(&call.get::<u32>(1)[..words as usize], push.digits as usize);
    call.set(2, &places);
}
