//! Twins of `glsl/densify_births.comp`, `glsl/densify_flags.comp`, `glsl/densify_codes.comp` and
//! `glsl/densify_order.comp`.

use super::TwinCall;
use super::densify_classify::KINDS;
use super::densify_map::{entry, unpack};
use crate::pass::counters::{SCAN_TOTAL, SPLATS};
use crate::pass::densify_order::{CodesPush, Push};

/// The cell of a coordinate, 0 to 1023: 128 cells of size 1 / (128 scale) from the origin to 1 / scale on either side,
/// then 128 cells each of twice, four times and eight times that size.
pub fn cell(x: f32, scale: f32) -> u32 {
    let size = (x.abs() * scale).min(15.0) + 1.0;
    let q = ((size.to_bits() - 1_f32.to_bits()) >> 16).min(511);
    if x < 0.0 { 511 - q } else { 512 + q }
}

/// The code of a centre: the interleaved bits of its cells, x lowest.
pub fn code(mean: [f32; 3], scale: f32) -> u32 {
    let cells = mean.map(|x| cell(x, scale));
    (0..30).fold(0, |code, bit| code | (cells[bit % 3] >> (bit / 3) & 1) << bit)
}

/// Adapter of `densify_births`: the ids as sort keys.
pub fn run_births(call: &mut TwinCall<'_>) {
    let stride = (call.push::<Push>().stride as usize).min(64 * call.groups as usize);
    let splats = call.get::<u32>(0)[SPLATS] as usize;
    let ids = call.get::<u32>(1);
    let keys: Vec<u32> = (0..stride).map(|row| if row < splats { ids[row] } else { u32::MAX }).collect();
    call.set(2, &keys);
    call.set(3, &(0..stride as u32).collect::<Vec<_>>());
}

/// Adapter of `densify_flags`.
pub fn run_flags(call: &mut TwinCall<'_>) {
    let stride = call.push::<Push>().stride as usize;
    let (row_of, by_row) = (call.get::<u32>(0), call.get::<u32>(1));
    let mut flags = call.get::<u32>(2);
    for (rank, row) in row_of.iter().enumerate().take(stride.min(64 * call.groups as usize)) {
        for kind in 0..KINDS {
            flags[kind * stride + rank] = by_row[kind * stride + *row as usize];
        }
    }
    call.set(2, &flags);
}

/// Adapter of `densify_codes`.
pub fn run_codes(call: &mut TwinCall<'_>) {
    let scale = call.push::<CodesPush>().scale;
    let rows = call.get::<u32>(0)[SCAN_TOTAL].min(64 * call.groups) as usize;
    let (row_of, means) = (call.get::<u32>(1), call.get::<[f32; 3]>(2));
    let (mut map, mut codes, mut births) = (call.get::<u32>(3), call.get::<u32>(4), call.get::<u32>(5));
    for birth in 0..rows {
        let (rank, kind) = unpack(map[birth]);
        let row = row_of[rank] as usize;
        map[birth] = entry(row, kind);
        codes[birth] = code(means[row], scale);
        births[birth] = birth as u32;
    }
    call.set(3, &map);
    call.set(4, &codes);
    call.set(5, &births);
}

/// Adapter of `densify_order`.
pub fn run_order(call: &mut TwinCall<'_>) {
    let rows = call.get::<u32>(0)[SCAN_TOTAL].min(64 * call.groups) as usize;
    let (births, map, ids) = (call.get::<u32>(1), call.get::<u32>(2), call.get::<u32>(3));
    let ordered = |words: &[u32]| births.iter().take(rows).map(|birth| words[*birth as usize]).collect::<Vec<_>>();
    call.set(4, &ordered(&map));
    call.set(5, &ordered(&ids));
}
