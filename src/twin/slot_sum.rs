//! Twin of `glsl/slot_sum.comp`.

use super::{Real, TwinCall};
use crate::pass::{counters, slot_sum};

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
