//! Twins of the sums of rows that other passes leave: `glsl/slot_sum.comp` and `glsl/part_sum.comp`.

use super::{Real, TwinCall};
use crate::pass::{counters, part_sum, slot_sum};

/// Sums of rows of `N` columns: for each listed splat the rows `offsets[splat] .. offsets[splat] + counts[splat]`,
/// first to last, each with its splat.
pub fn sums<R: Real, const N: usize>(
    listed: &[u32],
    offsets: &[u32],
    counts: &[u32],
    rows: &[[R; N]],
) -> Vec<(u32, [R; N])> {
    listed
        .iter()
        .map(|&splat| {
            let (begin, count) = (offsets[splat as usize] as usize, counts[splat as usize] as usize);
            let mut sum = [R::zero(); N];
            for row in &rows[begin..][..count] {
                for (s, &x) in sum.iter_mut().zip(row) {
                    *s += x;
                }
            }
            (splat, sum)
        })
        .collect()
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let visible = call.get::<u32>(0)[counters::VISIBLE].min(call.groups * slot_sum::SPLATS_PER_WORKGROUP) as usize;
    let (listed, offsets, counts) = (call.get::<u32>(1), call.get::<u32>(2), call.get::<u32>(3));
    let mut grad2d = call.get::<[f32; 12]>(6);
    for (splat, row) in sums(&listed[..visible], &offsets, &counts, &call.get::<[f32; 12]>(4)) {
        grad2d[splat as usize] = row;
    }
    call.set(6, &grad2d);
    if call.constants[0] != 0 {
        let mut normals = call.get::<[f32; 4]>(7);
        for (splat, [x, y, z, _]) in sums(&listed[..visible], &offsets, &counts, &call.get::<[f32; 4]>(5)) {
            normals[splat as usize] = [x, y, z, 0.0];
        }
        call.set(7, &normals);
    }
}

/// The sum of rows in the device's order: 64 sums of every 64th row, then their sum.
pub fn sum_of_parts<R: Real>(parts: &[[R; 4]]) -> [R; 4] {
    let add = |sum: [R; 4], row: [R; 4]| -> [R; 4] { std::array::from_fn(|k| sum[k] + row[k]) };
    let zero = [R::zero(); 4];
    (0..64).fold(zero, |sum, first| add(sum, parts.iter().skip(first).step_by(64).fold(zero, |s, row| add(s, *row))))
}

/// Adapter over raw buffers: `part_sum`.
pub fn run_part_sum(call: &mut TwinCall<'_>) {
    let push: part_sum::Push = call.push();
    if call.groups == 0 {
        return;
    }
    let parts = call.get::<[f32; 4]>(0);
    let mut sums = call.get::<[f32; 4]>(1);
    sums[push.slot as usize] = sum_of_parts(&parts[..push.count as usize]);
    call.set(1, &sums);
}
