//! The density change of 3DGS by its paper and code, on a list of rows, in f64: clone, split, then prune the result.
//! Shares no code with the twins.

use super::density_model::{MEANS, OPACITIES, QUATS, Row, SCALES};
use psrgs_vk::train::density::DensityRules;
use psrgs_vk::twin::random::normals;

/// Numbers of a change's effects.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Counts {
    pub(crate) cloned: u32,
    pub(crate) split: u32,
    pub(crate) pruned: u32,
    pub(crate) bad: u32,
}

fn finite(row: &Row) -> bool {
    row.planes.iter().flatten().all(|v| v.is_finite())
}

fn mean(sum: f32, views: f32) -> f64 {
    let score = f64::from(sum) / f64::from(views);
    if score.is_finite() { score } else { 0.0 }
}

/// Largest standard deviation; logarithms are compared, as f32 rounds them.
fn largest(row: &Row) -> f32 {
    row.planes[SCALES].iter().copied().fold(f32::MIN, f32::max)
}

fn prune(row: &Row, s: &DensityRules) -> bool {
    let opacity_limit = (s.prune_opacity / (1.0 - s.prune_opacity)).ln() as f32;
    row.planes[OPACITIES][0] < opacity_limit || s.prune_scale.is_some_and(|limit| largest(row) > limit.ln() as f32)
}

fn rotation(q: &[f32]) -> [[f64; 3]; 3] {
    let n = q.iter().map(|c| f64::from(*c).powi(2)).sum::<f64>().sqrt();
    let [w, x, y, z] = std::array::from_fn(|i| f64::from(q[i]) / n);
    [
        [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
}

fn newborn(parent: &Row, id: u32) -> Row {
    Row { moments: parent.moments.clone().map(|m| vec![0.0; m.len()]), id, ..parent.clone() }
}

fn child(parent: &Row, which: u32, seed: u32, event: u32) -> Row {
    let n = normals::<f64>([seed, event, parent.id, which]);
    let (r, mut row) = (rotation(&parent.planes[QUATS]), newborn(parent, 0));
    for (k, axis) in r.iter().enumerate() {
        let offset: f64 = (0..3).map(|j| axis[j] * f64::from(parent.planes[SCALES][j]).exp() * n[j]).sum();
        row.planes[MEANS][k] = (f64::from(parent.planes[MEANS][k]) + offset) as f32;
        row.planes[SCALES][k] = (f64::from(parent.planes[SCALES][k]) - 1.6_f64.ln()) as f32;
    }
    row
}

/// The rows after a change, in order, and the counts. Identities of new rows count from `next_id`.
pub(crate) fn change(rows: &[Row], s: &DensityRules, event: u32, next_id: u32) -> (Vec<Row>, Counts) {
    let mut counts = Counts { bad: rows.iter().filter(|r| !finite(r)).count() as u32, ..Counts::default() };
    let border = s.split_scale.ln() as f32;
    let wants_clone = |r: &Row| mean(r.stats[0], r.stats[2]) >= f64::from(s.clone_threshold) && largest(r) <= border;
    let wants_split = |r: &Row| {
        let sum = if s.split_absolute { r.stats[1] } else { r.stats[0] };
        mean(sum, r.stats[2]) >= f64::from(s.split_threshold) && largest(r) > border
    };

    let healthy: Vec<&Row> = rows.iter().filter(|r| finite(r)).collect();
    let cloned: Vec<&Row> = healthy.iter().copied().filter(|r| wants_clone(r)).collect();
    let split: Vec<&Row> = healthy.iter().copied().filter(|r| wants_split(r)).collect();
    let kept = healthy.iter().copied().filter(|r| !wants_split(r));

    let mut out: Vec<Row> = kept.filter(|r| !prune(r, s)).cloned().collect();
    let originals = out.len();
    out.extend(cloned.iter().map(|r| newborn(r, 0)).filter(|r| !prune(r, s)));
    counts.cloned = (out.len() - originals) as u32;
    for which in 0..2 {
        out.extend(split.iter().map(|r| child(r, which, s.seed, event)).filter(|r| !prune(r, s)));
    }
    counts.split = (out.len() as u32 - originals as u32 - counts.cloned) / 2;
    counts.pruned = rows.len() as u32 - originals as u32 - counts.split;
    for (rank, row) in out[originals..].iter_mut().enumerate() {
        row.id = next_id + rank as u32;
    }
    out.iter_mut().for_each(|r| (r.stats, r.scores) = ([0.0; 4], [0.0; 2]));
    (out, counts)
}
