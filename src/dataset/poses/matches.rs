//! Detects poses in another convention by matching neighbouring photographs. With correct poses, the lines of sight to
//! a matched spot meet in front of both cameras.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;

use super::super::{Dataset, Error, Role, Supply, rotation};
use super::inverted::{Convention, WrongConvention};
use super::sketch::Sketch;
use crate::scene::Camera;

/// Pairs of photographs that are matched, spread evenly. The second number is used where the first gives too few
/// matches.
const PAIRS: [usize; 2] = [16, 64];
/// Least matches of a pair that counts.
const LEAST_OF_PAIR: usize = 8;
/// Least number of pairs ...
const LEAST_PAIRS: usize = 3;
/// ... and of matches for judging poses.
const LEAST_MATCHES: usize = 60;
/// A match fits if its distance to the line of sight is below this number of cells.
const NEAR: f64 = 2.0;
/// Poses are wrong where less than this share of matches fits as read ...
const UNFIT: f64 = 0.2;
/// ... and this share in another convention.
const FIT: f64 = 0.5;

/// A pair of photographs and its matches, in pixels of both.
struct MatchedPair {
    cameras: [Camera; 2],
    /// Largest distance of a fitting match, in pixels of the second photograph.
    near: f64,
    matches: Vec<[[f64; 2]; 2]>,
}

/// Fails where matches of training photographs fit another convention of the poses, and not the format's.
pub(super) fn refuse(dataset: &Dataset, photographs: &[Option<Supply>]) -> Result<(), Error> {
    let views: Vec<(Camera, Option<&Supply>)> =
        dataset.views_of(Role::Train).zip(photographs).map(|((_, view), of)| (view.camera, of.as_ref())).collect();
    let mut sketches = BTreeMap::new();
    let mut done = BTreeSet::new();
    let mut pairs: Vec<MatchedPair> = Vec::new();
    for most in PAIRS {
        let between = views.len().saturating_sub(1);
        let wanted = (0..most.min(between)).map(|k| k * between / most.min(between));
        let new: Vec<usize> = wanted.filter(|first| done.insert(*first)).collect();
        for at in new.iter().flat_map(|first| [*first, first + 1]) {
            if let Entry::Vacant(entry) = sketches.entry(at) {
                let (camera, photograph) = &views[at];
                // One photograph at a time: pixels that are not kept take memory.
                let sketch = photograph.map(Supply::pixels).transpose()?;
                entry.insert(sketch.and_then(|pixels| Sketch::of(&pixels, camera)));
            }
        }
        let pair = |first: &usize| {
            let (a, b) = (sketches.get(first)?.as_ref()?, sketches.get(&(first + 1))?.as_ref()?);
            MatchedPair::of([views[*first].0, views[first + 1].0], [a, b])
        };
        pairs.extend(new.par_iter().filter_map(pair).collect::<Vec<MatchedPair>>());
        if pairs.len() >= LEAST_PAIRS && count(&pairs) >= LEAST_MATCHES {
            return judge(dataset, &pairs);
        }
    }
    Ok(())
}

fn judge(dataset: &Dataset, pairs: &[MatchedPair]) -> Result<(), Error> {
    let of = count(pairs) as f64;
    let share = |read: &(dyn Fn(&Camera) -> Camera + Sync)| {
        pairs.iter().map(|pair| pair.fitting(read)).sum::<usize>() as f64 / of
    };
    if share(&|camera| *camera) >= UNFIT {
        return Ok(());
    }
    let mut best = (FIT, None);
    for found in Convention::ALL {
        let fitting = share(&|camera| found.camera(dataset.format, camera));
        if fitting > best.0 {
            best = (fitting, Some(found));
        }
    }
    match best.1 {
        Some(found) => {
            let what = WrongConvention { format: dataset.format, found };
            Err(Error::PosesInOtherConvention { file: dataset.path.clone(), what })
        }
        None => Ok(()),
    }
}

fn count(pairs: &[MatchedPair]) -> usize {
    pairs.iter().map(|pair| pair.matches.len()).sum()
}

impl MatchedPair {
    /// `None` with too few matches.
    fn of(cameras: [Camera; 2], sketches: [&Sketch; 2]) -> Option<Self> {
        let matches = sketches[0].matches(sketches[1]);
        let near = NEAR * sketches[1].cell();
        (matches.len() >= LEAST_OF_PAIR).then_some(Self { cameras, near, matches })
    }

    /// Number of matches that fit with cameras converted by `read`.
    fn fitting(&self, read: &(dyn Fn(&Camera) -> Camera + Sync)) -> usize {
        let cameras = self.cameras.map(|camera| read(&camera));
        self.matches.iter().filter(|at| miss(&cameras, at) <= self.near).count()
    }
}

/// Distance in the second image from a spot to the line of sight through its match in the first, in front of both
/// cameras.
fn miss([first, second]: &[Camera; 2], [from, to]: &[[f64; 2]; 2]) -> f64 {
    let ray = |camera: &Camera, at: &[f64; 2]| [(at[0] - camera.cx) / camera.fx, (at[1] - camera.cy) / camera.fy, 1.0];
    let (a, b) = (first.center(), second.center());
    let along = ray(first, from);
    let in_world = std::array::from_fn(|k| (0..3).map(|row| first.rotation[row][k] * along[row]).sum());
    let (line, at) = (rotation::apply(&second.rotation, in_world), ray(second, to));
    let start = rotation::apply(&second.rotation, std::array::from_fn(|k| a[k] - b[k]));
    let off = |p: [f64; 3]| match p[2] > 0.0 {
        true => (second.fx * (p[0] / p[2] - at[0])).hypot(second.fy * (p[1] / p[2] - at[1])),
        false => f64::INFINITY,
    };
    let dot = |p: [f64; 3], q: [f64; 3]| (0..3).map(|k| p[k] * q[k]).sum::<f64>();
    // The point where the first line of sight is nearest to the second.
    let (lines, both, other) = (dot(line, line), dot(line, at), dot(at, at));
    let depth =
        (both * dot(at, start) - other * dot(line, start)) / (lines * other - both * both).max(f64::MIN_POSITIVE);
    let nearest = if depth > 0.0 { off(std::array::from_fn(|k| depth * line[k] + start[k])) } else { f64::INFINITY };
    // A very distant spot has no parallax.
    nearest.min(off(line))
}
