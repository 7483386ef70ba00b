//! Twin of `glsl/densify_gather.comp`.

use super::TwinCall;
use super::densify_classify::LN_SPLIT_SHRINK;
use super::densify_map::unpack;
use crate::pass::counters::SCAN_TOTAL;
use crate::pass::densify_gather::{MODE_MOMENT, MODE_SHRINK, MODE_ZERO, Push};

/// A word of a row of the given kind.
pub fn transform(mode: u32, kind: usize, word: u32) -> u32 {
    match mode {
        MODE_ZERO => 0,
        MODE_MOMENT if kind != 0 => 0,
        MODE_SHRINK if kind >= 2 => (f32::from_bits(word) - LN_SPLIT_SHRINK).to_bits(),
        _ => word,
    }
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let mode = call.push::<Push>().mode;
    let width = call.constants[0] as usize;
    let rows = call.get::<u32>(0)[SCAN_TOTAL].min(64 * call.groups) as usize;
    let (map, source) = (call.get::<u32>(1), call.get::<u32>(2));
    let mut plane = call.get::<u32>(3);
    for row in 0..rows {
        let (i, kind) = unpack(map[row]);
        for k in 0..width {
            plane[width * row + k] = transform(mode, kind, source[width * i + k]);
        }
    }
    call.set(3, &plane);
}
