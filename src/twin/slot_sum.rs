//! Twin of `glsl/slot_sum.comp`.

use super::{Real, TwinCall};
use crate::pass::{counters, slot_sum};

/// Sums of rows of `N` columns: for rank k in depth order the rows `offsets[k] .. offsets[k] + counts[order[k]]`, first to last,
/// given with the splat they belong to.
pub fn sums<R: Real, const N: usize>(
    order: &[u32],
    offsets: &[u32],
    counts: &[u32],
    rows: &[[R; N]],
) -> Vec<(u32, [R; N])> {
    order
        .iter()
        .zip(offsets)
        .map(|(&splat, &begin)| {
            let mut sum = [R::zero(); N];
            for row in &rows[begin as usize..][..counts[splat as usize] as usize] {
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
    let (order, offsets, counts) = (call.get::<u32>(1), call.get::<u32>(2), call.get::<u32>(3));
    let mut grad2d = call.get::<[f32; 12]>(6);
    for (splat, row) in sums(&order[..visible], &offsets[..visible], &counts, &call.get::<[f32; 12]>(4)) {
        grad2d[splat as usize] = row;
    }
    call.set(6, &grad2d);
    if call.constants[0] != 0 {
        let mut normals = call.get::<[f32; 4]>(7);
        for (splat, [x, y, z, _]) in sums(&order[..visible], &offsets[..visible], &counts, &call.get::<[f32; 4]>(5)) {
            normals[splat as usize] = [x, y, z, 0.0];
        }
        call.set(7, &normals);
    }
}
