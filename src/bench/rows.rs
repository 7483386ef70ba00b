//! Rows of a report from timestamps.

use std::collections::BTreeMap;

use super::memory_traffic::{self, Work};
use super::rates::Rates;
use super::report::{PassRow, StageRow};
use super::roofline::Floors;
use super::roofline::PerPixel;
use super::{Error, Quartiles};
use crate::vk::PassTime;

/// Stage of each pass, by the start of its name. The fused step is both the projection's backward and the optimiser.
/// Every other pass is bookkeeping (plans, clears, copies, the end of a step).
const STAGES: [(&str, &str); 17] = [
    ("project_backward_adam", "optimiser"),
    ("project_backward", "projection backward"),
    ("project", "projection"),
    ("compact", "tile lists"),
    ("radix", "tile lists"),
    ("scan", "tile lists"),
    ("gather_counts", "tile lists"),
    ("emit", "tile lists"),
    ("tile_edges", "tile lists"),
    ("tile_offsets", "tile lists"),
    ("tile_ranges", "tile lists"),
    ("tile_sort", "tile lists"),
    ("blend_forward", "blend forward"),
    ("loss", "image loss"),
    ("blend_backward", "blend backward"),
    ("slot_sum", "blend backward"),
    ("adam", "optimiser"),
];

fn stage(pass: &str) -> &'static str {
    STAGES.iter().find(|(family, _)| pass.starts_with(family)).map_or("bookkeeping", |(_, stage)| stage)
}

/// Milliseconds per step of all commands with the same key, and the number of these commands.
type Sums<K> = BTreeMap<K, (Vec<f64>, u64)>;

fn sums<'a, K: Ord>(steps: &'a [&'a [PassTime]], key: impl Fn(&'a str) -> K) -> Sums<K> {
    let mut out: Sums<K> = BTreeMap::new();
    for (i, step) in steps.iter().enumerate() {
        for time in *step {
            let (ms, calls) = out.entry(key(&time.pass)).or_insert_with(|| (vec![0.0; steps.len()], 0));
            ms[i] += time.ns * 1e-6;
            *calls += 1;
        }
    }
    out
}

/// The rows of passes and stages, the longest first, and the whole step. `steps` holds the pass times of each step.
pub(super) fn rows(
    steps: &[&[PassTime]],
    work: &Work,
    per_pixel: Option<&PerPixel>,
    rates: &Rates,
) -> Result<(Vec<PassRow>, Vec<StageRow>, Quartiles), Error> {
    let whole: Vec<f64> = steps.iter().map(|step| step.iter().map(|t| t.ns * 1e-6).sum()).collect();
    let total: f64 = whole.iter().sum();
    if total <= 0.0 {
        return Err(Error::NotLive("every pass took no time at all".into()));
    }
    let share = |ms: &[f64]| ms.iter().sum::<f64>() / total;
    let mut passes: Vec<PassRow> = sums(steps, |pass| pass)
        .into_iter()
        .map(|(pass, (ms, calls))| {
            let bytes = memory_traffic::bytes(pass, work);
            let floors = Floors::of(pass, work, per_pixel, rates);
            let (share, ms) = (share(&ms), Quartiles::of(ms));
            PassRow {
                pass: pass.to_owned(),
                stage: stage(pass),
                calls: calls as f64 / steps.len() as f64,
                ms,
                share,
                bytes,
                over_floor: floors.larger().filter(|floor| *floor > 0.0).map(|floor| ms.median / floor),
                floors,
                gb_per_s: bytes.filter(|_| ms.median > 0.0).map(|b| b / ms.median * 1e-6),
            }
        })
        .collect();
    passes.sort_by(|a, b| b.share.total_cmp(&a.share));
    let mut stages: Vec<StageRow> = sums(steps, stage)
        .into_iter()
        .map(|(stage, (ms, _))| StageRow { stage, share: share(&ms), ms: Quartiles::of(ms) })
        .collect();
    stages.sort_by(|a, b| b.share.total_cmp(&a.share));
    Ok((passes, stages, Quartiles::of(whole)))
}
