//! Twin of `glsl/photograph_reduce.comp`.

use super::TwinCall;
use super::loss::{counting, unpack};
use crate::pass::photograph_reduce::Push;

/// The mean colour of the unmasked pixels that pixel `k` of the result covers; `None` where more than half of them are
/// masked.
pub fn mean(colours: &[[f64; 3]], counts: &[bool], width: usize, factor: usize, k: usize) -> Option<[f64; 3]> {
    let columns = width / factor;
    let (left, top) = (k % columns * factor, k / columns * factor);
    let all = (top..top + factor).flat_map(|y| (left..left + factor).map(move |x| y * width + x));
    let counted: Vec<usize> = all.filter(|&i| counts[i]).collect();
    let enough = !counted.is_empty() && 2 * counted.len() >= factor * factor;
    enough.then(|| std::array::from_fn(|c| counted.iter().map(|&i| colours[i][c]).sum::<f64>() / counted.len() as f64))
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let bits = call.constants[0];
    let [width, height, factor] = [push.width, push.height, push.factor].map(|v| v as usize);
    let target = call.get::<u32>(0);
    let (colours, counts) = (unpack::<f64>(&target, bits), counting(&target, bits));
    let mut reduced = call.get::<u32>(1);
    let white = f64::from((1_u32 << bits) - 1);
    for k in 0..((width / factor) * (height / factor)).min(64 * call.groups as usize) {
        let colour = mean(&colours, &counts, width, factor, k);
        let [r, g, b] = colour.unwrap_or_default().map(|v| (v * white).round_ties_even() as u32);
        let a = if colour.is_some() { white as u32 } else { 0 };
        if bits == 16 {
            reduced[2 * k] = r | g << 16;
            reduced[2 * k + 1] = b | a << 16;
        } else {
            reduced[k] = r | g << 8 | b << 16 | a << 24;
        }
    }
    call.set(1, &reduced);
}
