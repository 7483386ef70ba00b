//! Twin of `glsl/gather_counts.comp`.

use super::TwinCall;
use crate::pass::counters;

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let tile_counts = call.get::<u32>(1);
    let visible = call.get::<u32>(2)[counters::VISIBLE].min(call.groups * 64) as usize;
    let counts: Vec<u32> = call.get::<u32>(0)[..visible].iter().map(|&splat| tile_counts[splat as usize]).collect();
    call.set(3, &counts);
}
