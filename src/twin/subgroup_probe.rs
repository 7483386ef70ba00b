//! Twin of `glsl/subgroup_probe.comp`.

use super::TwinCall;
use crate::pass::subgroup_probe::{LOCAL_SIZE, Push, RESULTS};

/// Results for the words of one subgroup; the workgroup's columns stay zero.
fn subgroup(words: &[u32]) -> Vec<[u32; RESULTS]> {
    let sum = |f: &dyn Fn(u32) -> u32, words: &[u32]| words.iter().fold(0u32, |s, &w| s.wrapping_add(f(w)));
    let odd = |w: u32| w & 1;
    let byte = |k: u32| sum(&move |w| (w >> (8 * k)) & 255, words);
    (0..words.len())
        .map(|lane| {
            let mut row = [0; RESULTS];
            row[0] = sum(&|w| w, words);
            row[1] = sum(&|w| w, &words[..lane]);
            row[2] = words.iter().copied().max().unwrap_or(0);
            row[3] = words[lane ^ 3];
            row[4] = words[5] & 0x3fff_ffff;
            row[5] = sum(&odd, &words[..lane]);
            row[6] = sum(&odd, words);
            let seven = words.iter().any(|w| w & 255 == 7);
            row[7] = u32::from(seven) + 2 * u32::from(!seven);
            row[8] = byte(0) + 3 * byte(1) + 5 * byte(2) + 7 * byte(3);
            row[11] = 1 + 2 * u32::from(lane == 0);
            row
        })
        .collect()
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let source = call.get::<u32>(0);
    let mut results = Vec::new();
    for words in source.chunks_exact(LOCAL_SIZE as usize).take(call.groups as usize) {
        let total = words.iter().fold(0u32, |s, &w| s.wrapping_add(w));
        let mut before = 0u32;
        let rows = words.chunks_exact(push.width as usize).flat_map(subgroup);
        for (mut row, &word) in rows.zip(words) {
            row[9] = before;
            row[10] = total;
            before = before.wrapping_add(word);
            results.push(row);
        }
    }
    call.set(1, &results);
}
