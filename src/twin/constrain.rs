//! Twins of `glsl/constrain.comp`, `glsl/grad2d_keep.comp` and `glsl/grad2d_add.comp`.

use super::TwinCall;
use crate::pass::constrain::Push;
use crate::pass::counters::{CONSTRAINED, SPLATS};

fn splats(call: &TwinCall<'_>) -> usize {
    (call.get::<u32>(0)[SPLATS] as usize).min(64 * call.groups as usize)
}

/// Adapter over raw buffers of `constrain`.
pub fn run(call: &mut TwinCall<'_>) {
    let (n, bound, others) = (splats(call), call.get::<u32>(0)[CONSTRAINED], call.push::<Push>().others != 0);
    let (ids, mut tile_counts) = (call.get::<u32>(1), call.get::<u32>(2));
    for (count, id) in tile_counts.iter_mut().zip(&ids).take(n) {
        if (*id < bound) == others {
            *count = 0;
        }
    }
    call.set(2, &tile_counts);
}

/// Adapter over raw buffers of `grad2d_keep`.
pub fn run_keep(call: &mut TwinCall<'_>) {
    let (n, tile_counts) = (splats(call), call.get::<u32>(1));
    let (grad2d, mut kept) = (call.get::<[f32; 12]>(2), call.get::<[f32; 12]>(3));
    for (i, row) in kept.iter_mut().enumerate().take(n) {
        *row = if tile_counts[i] != 0 { grad2d[i] } else { [0.0; 12] };
    }
    call.set(3, &kept);
}

/// Adapter over raw buffers of `grad2d_add`.
pub fn run_add(call: &mut TwinCall<'_>) {
    let (n, tile_counts) = (splats(call), call.get::<u32>(1));
    let (kept, mut grad2d) = (call.get::<[f32; 12]>(2), call.get::<[f32; 12]>(3));
    for (i, row) in grad2d.iter_mut().enumerate().take(n).filter(|(i, _)| tile_counts[*i] != 0) {
        row.iter_mut().zip(kept[i]).for_each(|(sum, more)| *sum += more);
    }
    call.set(3, &grad2d);
}
