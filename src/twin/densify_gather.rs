//! Twin of `glsl/densify_gather.comp`.

use super::TwinCall;
use super::densify_classify::LN_SPLIT_SHRINK;
use super::densify_map::{axis, unpack};
use super::random::Elementary;
use crate::pass::counters::SCAN_TOTAL;
use crate::pass::densify_gather::{MODE_MOMENT, MODE_SHARE, MODE_SHRINK, MODE_SHRINK_AXIS, MODE_ZERO, Push};

/// -ln sqrt(3/4): difference between the parent's log scale and a child's along the axis of the split.
const LN_AXIS_SHRINK: f32 = 0.143_841_04;
/// exp(1/6): inverse of the share of its opacity that a child of a split along an axis has at the parent's centre.
const INVERSE_AXIS_CENTER: f64 = 1.181_360_41;

/// The logit of an opacity that is faded by the factor `keep`. A child's opacity is first reduced because two children
/// overlap.
pub fn faded<R: Elementary>(logit: R, child: bool, keep: R) -> R {
    let one = R::one();
    if !child && keep >= one {
        return logit;
    }
    let mut opacity = one / (one + (-logit).exponential());
    if child {
        let half_shown = opacity / (one + (one - opacity).sqrt());
        opacity = (half_shown * R::of(INVERSE_AXIS_CENTER)).min(opacity);
    }
    let kept = (opacity * keep).max(R::of(1e-6)).min(one - R::of(1e-6));
    kept.natural_log() - (one - kept).natural_log()
}

/// A word of a gathered row of the given kind.
pub fn transform(push: &Push, kind: usize, word: u32) -> u32 {
    match push.mode {
        MODE_ZERO => 0,
        MODE_MOMENT if kind != 0 => 0,
        MODE_SHRINK if kind >= 2 => (f32::from_bits(word) - LN_SPLIT_SHRINK).to_bits(),
        MODE_SHARE if kind >= 2 || push.keep < 1.0 => faded(f32::from_bits(word), kind >= 2, push.keep).to_bits(),
        _ => word,
    }
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let width = call.constants[0] as usize;
    let rows = call.get::<u32>(0)[SCAN_TOTAL].min(64 * call.groups) as usize;
    let (map, source) = (call.get::<u32>(1), call.get::<u32>(2));
    let mut plane = call.get::<u32>(3);
    for row in 0..rows {
        let (i, kind) = unpack(map[row]);
        let words = &source[width * i..width * (i + 1)];
        for (k, word) in words.iter().enumerate() {
            plane[width * row + k] = transform(&push, kind, *word);
        }
        if width == 3 && push.mode == MODE_SHRINK_AXIS && kind >= 2 {
            let scales = [words[0], words[1], words[2]].map(f32::from_bits);
            let axis = axis(map[row], scales);
            plane[width * row + axis] = (scales[axis] - LN_AXIS_SHRINK).to_bits();
        }
    }
    call.set(3, &plane);
}
