//! Twin of `glsl/part_sum.comp`.

use super::{Real, TwinCall};
use crate::pass::part_sum::Push;

/// The sum of rows in the device's order: 64 sums of every 64th row, then their sum.
pub fn part_sum<R: Real>(parts: &[[R; 4]]) -> [R; 4] {
    let add = |sum: [R; 4], row: [R; 4]| -> [R; 4] { std::array::from_fn(|k| sum[k] + row[k]) };
    let zero = [R::zero(); 4];
    (0..64).fold(zero, |sum, first| add(sum, parts.iter().skip(first).step_by(64).fold(zero, |s, row| add(s, *row))))
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    if call.groups == 0 {
        return;
    }
    let parts = call.get::<[f32; 4]>(0);
    let mut sums = call.get::<[f32; 4]>(1);
    sums[push.slot as usize] = part_sum(&parts[..push.count as usize]);
    call.set(1, &sums);
}
