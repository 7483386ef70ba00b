//! Which views a view is compared with.

use std::collections::BTreeMap;

use crate::scene::Camera;

/// Angles at a point between two views, in degrees: from the first to the second a pair is worth most.
const BEST_ANGLES: [f64; 2] = [5.0, 30.0];
/// A pair of views is of no use where three quarters of its angles are below this many degrees (COLMAP's and ACMM's rule).
const LEAST_ANGLE: f64 = 1.0;
/// Pairs of views are compared by about this many observations.
const COMPARED: usize = 1_000_000;
/// A pair has to share so many points.
const LEAST_SHARED: u32 = 5;

/// Points and the views that see each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Observations {
    /// Positions in the cameras' coordinates.
    pub points: Vec<[f64; 3]>,
    /// For each point the positions of its views, ascending.
    pub views: Vec<Vec<u32>>,
    /// The points were drawn at random: no surface is where they are.
    pub drawn: bool,
}

#[derive(Clone, Copy, Default)]
struct Pair {
    shared: u32,
    narrow: u32,
    worth: f64,
}

/// For each camera at most `most` others, the best first: by the number of points that both see, weighted by the angle between the
/// views there. None where there is no overlap, or where all see everything from one place.
pub fn choose_sources(cameras: &[Camera], seen: &Observations, most: usize) -> Vec<Vec<usize>> {
    let centers: Vec<[f64; 3]> = cameras.iter().map(Camera::center).collect();
    let pairs_of = |views: &Vec<u32>| views.len() * views.len();
    let step = seen.views.iter().map(pairs_of).sum::<usize>().div_ceil(COMPARED).max(1);
    let mut pairs: BTreeMap<(u32, u32), Pair> = BTreeMap::new();
    for (point, views) in seen.points.iter().zip(&seen.views).step_by(step) {
        for (k, &i) in views.iter().enumerate() {
            for &j in &views[k + 1..] {
                let (Some(a), Some(b)) = (centers.get(i as usize), centers.get(j as usize)) else { continue };
                let degrees = angle(a, b, point);
                let pair = pairs.entry((i, j)).or_default();
                pair.shared += 1;
                pair.narrow += u32::from(degrees < LEAST_ANGLE);
                pair.worth += worth(degrees);
            }
        }
    }
    // Thinned out, sharing few points says less.
    let least = LEAST_SHARED.div_ceil(step as u32).max(1);
    let mut found: Vec<Vec<(f64, usize)>> = vec![Vec::new(); cameras.len()];
    for ((i, j), pair) in pairs {
        if pair.shared >= least && 4 * pair.narrow < 3 * pair.shared {
            found[i as usize].push((pair.worth, j as usize));
            found[j as usize].push((pair.worth, i as usize));
        }
    }
    for of in &mut found {
        // Stable, so that equal ones stay in the order of the views.
        of.sort_by(|a, b| b.0.total_cmp(&a.0));
        of.truncate(most);
    }
    found.into_iter().map(|of| of.into_iter().map(|(_, view)| view).collect()).collect()
}

/// The angle at a point between the directions to two centres, degrees.
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
