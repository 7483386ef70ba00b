//! Selection of the views that a view is compared with.

use std::collections::{BTreeMap, HashMap};

use crate::scene::Camera;

/// Range of angles at a point between two views, in degrees, that are worth most.
const BEST_ANGLES: [f64; 2] = [5.0, 30.0];
/// A pair of views is of no use where three quarters of its angles are below this many degrees (COLMAP's and ACMM's
/// rule).
const LEAST_ANGLE: f64 = 1.0;
/// Approximate number of pairs of observations that are counted.
const COMPARED: usize = 1_000_000;
/// Smallest number of points that two views must share.
const LEAST_SHARED: usize = 5;
/// Weight of a point that zero, one, two or more of the chosen views see already.
const SEEN_AGAIN: [f64; 4] = [1.0, 0.8, 0.2, 0.05];
/// A point counts as seen where its angle is worth more than this.
const LITTLE: f64 = 0.1;

/// Points, and the views that see each point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Observations {
    /// Positions in the cameras' coordinates.
    pub points: Vec<[f64; 3]>,
    /// For each point, the indices of its views, ascending.
    pub views: Vec<Vec<u32>>,
    /// Whether the points were drawn at random and lie on no surface.
    pub drawn: bool,
    /// Indices of the views whose observations are unknown, ascending: they are assumed to see every point inside their
    /// image, occluded or not.
    pub assumed: Vec<u32>,
}

/// The points that a view shares with another.
#[derive(Default)]
struct SharedPoints {
    narrow: usize,
    /// Number of each point, and the worth of the angle between the views there.
    shared: Vec<(u32, f64)>,
}

/// For each camera, the indices of at most `most` other cameras, the best first: those that see most of its points at
/// good angles. Points that two chosen cameras see already count little. Empty where no camera overlaps, or where all
/// cameras are in one position.
pub fn choose_sources(cameras: &[Camera], seen: &Observations, most: usize) -> Vec<Vec<usize>> {
    let centers: Vec<[f64; 3]> = cameras.iter().map(Camera::center).collect();
    let pairs_of = |views: &Vec<u32>| views.len() * views.len();
    let step = seen.views.iter().map(pairs_of).sum::<usize>().div_ceil(COMPARED).max(1);
    let mut pairs: Vec<BTreeMap<usize, SharedPoints>> = Vec::new();
    pairs.resize_with(cameras.len(), BTreeMap::new);
    for (number, (point, views)) in seen.points.iter().zip(&seen.views).step_by(step).enumerate() {
        for (k, &i) in views.iter().enumerate() {
            for &j in &views[k + 1..] {
                let (i, j) = (i as usize, j as usize);
                let (Some(a), Some(b)) = (centers.get(i), centers.get(j)) else { continue };
                let degrees = angle(a, b, point);
                for (from, to) in [(i, j), (j, i)] {
                    let pair = pairs[from].entry(to).or_default();
                    pair.narrow += usize::from(degrees < LEAST_ANGLE);
                    pair.shared.push((number as u32, worth(degrees)));
                }
            }
        }
    }
    // The thinning of observations lowers the limit too.
    let least = LEAST_SHARED.div_ceil(step).max(1);
    let usable = |pair: &SharedPoints| pair.shared.len() >= least && 4 * pair.narrow < 3 * pair.shared.len();
    pairs.iter().map(|of| covering(of.iter().filter(|(_, pair)| usable(pair)), most)).collect()
}

/// Chooses one view after another, each time the view that adds most.
fn covering<'a>(pairs: impl Iterator<Item = (&'a usize, &'a SharedPoints)>, most: usize) -> Vec<usize> {
    let mut left: Vec<(usize, &SharedPoints)> = pairs.map(|(view, pair)| (*view, pair)).collect();
    let mut times: HashMap<u32, usize> = HashMap::new();
    let mut chosen = Vec::new();
    while chosen.len() < most {
        let adds = |pair: &SharedPoints| {
            let worth = |(point, worth): &(u32, f64)| worth * SEEN_AGAIN[times.get(point).map_or(0, |n| *n.min(&3))];
            pair.shared.iter().map(worth).sum::<f64>()
        };
        let gains = left.iter().map(|(_, pair)| adds(pair)).enumerate();
        // The first of equal gains wins.
        let best = gains.fold(None, |best: Option<(usize, f64)>, (k, gain)| match best {
            Some((_, most)) if most >= gain => best,
            _ => Some((k, gain)),
        });
        let Some((best, _)) = best else { break };
        let (view, pair) = left.remove(best);
        pair.shared.iter().filter(|(_, worth)| *worth > LITTLE).for_each(|(p, _)| *times.entry(*p).or_default() += 1);
        chosen.push(view);
    }
    chosen
}

/// The angle in degrees at a point between the directions to two centres.
fn angle(a: &[f64; 3], b: &[f64; 3], point: &[f64; 3]) -> f64 {
    let to = |c: &[f64; 3]| glam::DVec3::from_array(*c) - glam::DVec3::from_array(*point);
    let (a, b) = (to(a), to(b));
    let (across, along) = (a.cross(b).length(), a.dot(b));
    across.atan2(along).to_degrees()
}

fn worth(degrees: f64) -> f64 {
    let [low, high] = BEST_ANGLES;
    if degrees < low {
        (degrees / low).powi(2)
    } else if degrees > high {
        (high / degrees).powi(2)
    } else {
        1.0
    }
}
