//! Twin of `glsl/densify_sample.comp`.

use super::TwinCall;
use super::densify_classify::{KINDS, all_finite, planes};
use super::random::bits;
use crate::pass::counters::{SPLATS, full_rows};
use crate::pass::densify_sample::Push;

/// Key that separates these draws from the draws of the children's positions.
const DRAW_SPLIT: u32 = 2;

/// The probability that a splat with these statistics and scores is split.
pub fn probability(stats: [f32; 4], scores: [f32; 2], push: &Push) -> f32 {
    let [signed, absolute, views, _] = stats;
    let scored = views > 0.0 && absolute > 0.0 && absolute.is_finite() && scores.iter().all(|x| x.is_finite());
    let mask = if scored { (scores[0] / absolute).clamp(0.0, 1.0) } else { 0.0 };
    let error = if scored { (scores[1] / views).clamp(0.0, 1.0) } else { 0.0 };
    let sum = if push.absolute != 0 { absolute } else { signed };
    let threshold = (push.low_threshold + (push.high_threshold - push.low_threshold) * mask) * views;
    let reached = views > 0.0 && sum.is_finite() && sum >= threshold;
    let excess = if reached { sum / threshold.max(1e-30) } else { 0.0 };
    let share = |share: f32, value: f32| 1.0 + share * (value - 1.0);
    push.rate * excess * share(push.mask_share, mask) * share(push.error_share, error)
}

/// The flags (kept, clone, first child, second child) of a splat whose values are all finite.
pub fn sample(scales: [f32; 3], opacity: f32, stats: [f32; 4], scores: [f32; 2], id: u32, push: &Push) -> [u32; KINDS] {
    let largest = scales[0].max(scales[1]).max(scales[2]);
    let seen = push.prune_unseen == 0 || stats[1] > 0.0;
    let size_ok = push.prune_large == 0 || largest <= push.prune_scale;
    let lives = seen && size_ok && opacity >= push.prune_opacity;
    let draw = (bits([push.seed, push.event, id, DRAW_SPLIT])[0] >> 8) as f32;
    let split = draw < probability(stats, scores, push) * 16_777_216.0;
    let child = u32::from(lives && split);
    [u32::from(lives), 0, 0, child]
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let stride = push.stride as usize;
    let splats = (call.get::<u32>(0)[SPLATS] as usize).min(stride);
    let full = full_rows(&call.get::<u32>(0));
    let planes = planes(call);
    let (stats, scores, ids) = (call.get::<[f32; 4]>(9), call.get::<[f32; 2]>(10), call.get::<u32>(11));
    let (mut flags, mut tally) = (call.get::<u32>(12), call.get::<u32>(13));
    for i in 0..stride.min(64 * call.groups as usize) {
        let mut row = [0; KINDS];
        if i < splats {
            if all_finite(&planes, i, full) {
                let scales = &planes[2].0[3 * i..3 * i + 3];
                let scales = [scales[0], scales[1], scales[2]];
                row = sample(scales, planes[3].0[i], stats[i], scores[i], ids[i], &push);
            } else {
                tally[0] = tally[0].wrapping_add(1);
            }
        }
        for (kind, flag) in row.into_iter().enumerate() {
            flags[kind * stride + i] = flag;
        }
    }
    call.set(12, &flags);
    call.set(13, &tally);
}
