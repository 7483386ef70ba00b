//! Twins of `glsl/compact.comp` and `glsl/gather_counts.comp`.

use super::TwinCall;
use crate::pass::compact::Push;
use crate::pass::counters;

/// Adapter over raw buffers: `compact`.
pub fn run(call: &mut TwinCall<'_>) {
    let Push { shift } = call.push();
    let splat2d = call.get::<[u32; 12]>(0);
    let tile_counts = call.get::<u32>(1);
    let places = call.get::<u32>(2);
    let splats = call.get::<u32>(3)[counters::SPLATS].min(call.groups * 64) as usize;
    let mut keys = call.get::<u32>(4);
    let mut vals = call.get::<u32>(5);
    for splat in (0..splats).filter(|&i| tile_counts[i] != 0) {
        keys[places[splat] as usize] = splat2d[splat][6] >> shift;
        vals[places[splat] as usize] = splat as u32;
    }
    call.set(4, &keys);
    call.set(5, &vals);
}

/// Adapter over raw buffers: `gather_counts`.
pub fn run_gather_counts(call: &mut TwinCall<'_>) {
    let tile_counts = call.get::<u32>(1);
    let visible = call.get::<u32>(2)[counters::VISIBLE].min(call.groups * 64) as usize;
    let counts: Vec<u32> = call.get::<u32>(0)[..visible].iter().map(|&splat| tile_counts[splat as usize]).collect();
    call.set(3, &counts);
}
