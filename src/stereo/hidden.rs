//! Points that lie behind what stereo has found.

use rayon::prelude::*;

use super::scene::placed;
use super::{Prior, View};

/// A point is hidden from a view where it lies this share of the surface's depth behind it: farther than stereo, or a point, is off.
const BEHIND: f64 = 0.1;
/// Views that a point has to be hidden from.
const LEAST_VIEWS: usize = 2;

/// Which of these points, in the views' coordinates, lie behind surfaces in each view that knows a depth about the place where it would
/// show them, and in two at least. No photograph shows such a point: it is a wrong one, of which reconstructions have some in a hundred, or
/// a reflection. One that lies before a surface may be a wire, which stereo is too coarse for, and is none of them.
pub fn hidden(views: &[View], priors: &[Prior], points: &[[f64; 3]]) -> Vec<bool> {
    let of = |point: &[f64; 3]| {
        let mut behind = 0;
        for (view, prior) in views.iter().zip(priors) {
            let Some([u, v, z]) = placed(&view.camera, *point) else { continue };
            match farthest(prior, u, v) {
                Some(depth) if z > (1.0 + BEHIND) * depth => behind += 1,
                Some(_) => return false,
                None => {}
            }
        }
        behind >= LEAST_VIEWS
    };
    points.par_iter().map(of).collect()
}

/// The largest depth that is known about a place in the picture: at an edge a point may be of the surface beyond it.
fn farthest(prior: &Prior, u: f64, v: f64) -> Option<f64> {
    let (x, y) = (u as i64, v as i64);
    let near = (y - 1..=y + 1).flat_map(|y| (x - 1..=x + 1).map(move |x| (x, y)));
    let inside =
        near.filter(|(x, y)| (0..i64::from(prior.width)).contains(x) && (0..i64::from(prior.height)).contains(y));
    let depths = inside.filter_map(|(x, y)| prior.depth.get((y * i64::from(prior.width) + x) as usize));
    depths.filter(|depth| **depth > 0.0).map(|depth| f64::from(*depth)).reduce(f64::max)
}
