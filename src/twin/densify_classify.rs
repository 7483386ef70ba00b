//! Twin of `glsl/densify_classify.comp`.

use super::TwinCall;
use crate::pass::counters::{SPLATS, full_rows};
use crate::pass::densify_classify::Push;
use crate::raster::SH0;

/// ln 1.6: difference between a parent's log scales and its children's after a split.
pub const LN_SPLIT_SHRINK: f32 = 0.470_003_63;

/// Number of kinds of row after a density change: kept, clone, first child, second child, in the order of their
/// segments.
pub const KINDS: usize = 4;

/// Whether a mean score reaches a threshold. Without views, or with a sum that is not finite, the score is 0.
pub fn reaches(sum: f32, views: f32, threshold: f32) -> bool {
    if views > 0.0 && sum.is_finite() { sum >= threshold * views } else { threshold <= 0.0 }
}

/// The flags (kept, clone, first child, second child) of a splat whose values are all finite.
pub fn classify(scales: [f32; 3], opacity: f32, stats: [f32; 4], push: &Push) -> [u32; KINDS] {
    let largest = scales[0].max(scales[1]).max(scales[2]);
    let large = largest > push.split_scale;
    let cloned = !large && reaches(stats[0], stats[2], push.clone_threshold);
    let split_sum = if push.split_absolute != 0 { stats[1] } else { stats[0] };
    let split = large && reaches(split_sum, stats[2], push.split_threshold);
    let lives = |scale: f32| opacity >= push.prune_opacity && (push.prune_large == 0 || scale <= push.prune_scale);
    let child = u32::from(split && lives(largest - LN_SPLIT_SHRINK));
    [u32::from(!split && lives(largest)), u32::from(cloned && lives(largest)), child, child]
}

/// The model's planes, from binding 1 on, with the widths of their rows.
pub(super) fn planes(call: &TwinCall<'_>) -> Vec<(Vec<f32>, usize)> {
    [3, 4, 3, 1, 12, 12, 12, 12].iter().enumerate().map(|(p, &width)| (call.get::<f32>(1 + p), width)).collect()
}

/// Whether every parameter of a splat is finite. Rows from `full` on have only the first group of harmonics.
pub(super) fn all_finite(planes: &[(Vec<f32>, usize)], i: usize, full: usize) -> bool {
    let planes = if i < full { planes } else { &planes[..=SH0] };
    planes.iter().all(|(plane, width)| plane[width * i..width * (i + 1)].iter().all(|x| x.is_finite()))
}

/// Adapter over raw buffers.
pub fn run(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let stride = push.stride as usize;
    let splats = (call.get::<u32>(0)[SPLATS] as usize).min(stride);
    let full = full_rows(&call.get::<u32>(0));
    let planes = planes(call);
    let stats = call.get::<[f32; 4]>(9);
    let (mut flags, mut tally) = (call.get::<u32>(10), call.get::<u32>(11));
    for i in 0..stride.min(64 * call.groups as usize) {
        let mut row = [0; KINDS];
        if i < splats {
            if all_finite(&planes, i, full) {
                let scales = &planes[2].0[3 * i..3 * i + 3];
                row = classify([scales[0], scales[1], scales[2]], planes[3].0[i], stats[i], &push);
            } else {
                tally[0] = tally[0].wrapping_add(1);
            }
        }
        for (kind, flag) in row.into_iter().enumerate() {
            flags[kind * stride + i] = flag;
        }
    }
    call.set(10, &flags);
    call.set(11, &tally);
}
