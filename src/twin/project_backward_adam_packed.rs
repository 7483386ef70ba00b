//! Twin of `glsl/project_backward_adam_packed.comp` and of `glsl/include/packed_moments.glsl`.

use half::f16;

use super::TwinCall;
use super::project_backward_adam::{Inputs, SplatState, set_planes, step_of, steppers, touched};
use super::random;
use super::splat::{PARAMETERS, Splat, model_of};
use crate::pass::project_backward_adam::{Push, STEP_SHIFT, STEPS_OPACITIES};

/// Number of low bits of the second moment's f32 that are dropped.
pub const V_SHIFT: u32 = 15;
/// Key of the random bits, besides splat, step and parameter.
const STREAM: u32 = 0x5eed;

/// Both moments of a parameter in one word: the second moment's upper bits, rounded stochastically by `bits` (below
/// 2^15), and the first moment over the second's root as a half float.
pub fn pack(first: f32, second: f32, bits: u32) -> u32 {
    let kept = (second.to_bits() + bits) >> V_SHIFT;
    let root = f32::from_bits(kept << V_SHIFT).sqrt();
    let ratio = if kept == 0 { 0.0 } else { first / root };
    kept << 16 | u32::from(f16::from_f32(ratio).to_bits())
}

/// First and second moment from a word.
pub fn unpack(word: u32) -> (f32, f32) {
    let second = f32::from_bits(word >> 16 << V_SHIFT);
    (f16::from_bits(word as u16).to_f32() * second.sqrt(), second)
}

/// Random bits below 2^15 for parameter `k` of splat `i`. Rows of four share a draw.
pub fn dither(flags: u32, i: usize, k: usize) -> u32 {
    let (row, lane) = match k {
        3..7 => (3, k - 3),
        11.. => (11 + (k - 11) / 4 * 4, (k - 11) % 4),
        _ => (k, 0),
    };
    random::bits([i as u32, flags >> STEP_SHIFT, row as u32, STREAM])[lane] >> (32 - V_SHIFT)
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let inputs = Inputs::new(call, &push);
    let mut model = model_of(call, 5, inputs.n);
    // Packed words stored as floats: copies keep their bits.
    let mut words = model_of(call, 13, inputs.n);
    let stepped = |i: usize, k: usize| {
        k < touched(call.constants, i < inputs.full) && (k != 10 || push.flags & STEPS_OPACITIES != 0)
    };
    for (i, pace) in steppers(call, &inputs, 21) {
        let (splat, packed) = (Splat::<f32>::of(&model, i), Splat::<f32>::of(&words, i).to_array());
        let moments = packed.map(|word| unpack(word.to_bits()));
        let state = SplatState {
            first: Splat::from_array(&moments.map(|m| m.0)),
            second: Splat::from_array(&moments.map(|m| m.1)),
            splat,
        };
        let gradient = inputs.gradient(i, &state.splat);
        let after = step_of(&push, call.constants, &state, &gradient, pace, i < inputs.full);
        let (first, second) = (after.first.to_array(), after.second.to_array());
        let repacked: [f32; PARAMETERS] = std::array::from_fn(|k| {
            if stepped(i, k) { f32::from_bits(pack(first[k], second[k], dither(push.flags, i, k))) } else { packed[k] }
        });
        after.splat.store(&mut model, i);
        Splat::from_array(&repacked).store(&mut words, i);
    }
    set_planes(call, 5, &model, inputs.full);
    set_planes(call, 13, &words, inputs.full);
}

#[cfg(test)]
mod tests {
    use super::{V_SHIFT, pack, unpack};

    #[test]
    fn packing_keeps_what_it_unpacked() {
        for (m, v) in [(0.0, 0.0), (1e-4, 3e-9), (-7.3e-9, 1e-18), (2.0, 0.1), (-1e-30, 1e-37), (4e16, 1.6e34)] {
            let word = pack(m, v, 0);
            let (m0, v0) = unpack(word);
            // Half a unit of a half float (of the smallest one below its normal numbers); one unit of the eight bits of
            // v.
            assert!((m0 - m).abs() <= m.abs() * f32::exp2(-11.0) + v.sqrt() * f32::exp2(-25.0), "{m} {v}: {m0}");
            assert!(v0 <= v && v - v0 <= v * f32::exp2(-8.0), "{m} {v}: {v0}");
            for bits in [0, 1, (1 << V_SHIFT) - 1] {
                assert_eq!(pack(m0, v0, bits), word, "{m} {v}: rounded again");
            }
        }
    }

    /// The mean over all random bits is the value itself. Rounding to nearest would lose a decay by a thousandth.
    #[test]
    fn the_second_moment_is_right_in_the_mean() {
        let (start, step) = (3.0e-9_f32, 0.999_f32);
        let (_, v) = unpack(pack(0.0, start, 0));
        let wanted = f64::from(v * step);
        let count = 1u32 << V_SHIFT;
        let mean =
            (0..count).map(|bits| f64::from(unpack(pack(0.0, v * step, bits)).1)).sum::<f64>() / f64::from(count);
        assert!((mean / wanted - 1.0).abs() < 1e-6, "{mean:e} instead of {wanted:e}");
        assert_eq!(unpack(pack(0.0, v * step, count / 2)).1, v, "to nearest");
    }
}
