//! The scene's frame from the training cameras, as in the 3DGS reference: centre and extent.

use super::Warning;
use super::colmap::Point;
use crate::scene::Frame;

/// Where the cameras' spread is less than this fraction of the distance to the points, it says nothing about the
/// scene's size.
const DEGENERATE: f64 = 1e-4;

/// A camera whose distance from the middle is more than this multiple of the median distance has a wrong pose.
const FAR: f64 = 30.0;
/// A camera whose distance is more than this multiple of the ninth decile stands apart: its pose counts as wrong unless
/// points confirm the pose.
const APART: f64 = 4.0;
/// With fewer cameras, no camera stands apart.
const LEAST_CAMERAS: usize = 6;

/// The cameras far from all others, each with its distance in multiples of the median distance. Distances are from the
/// middle of the cameras (the median along each axis). Empty where at least half of the cameras are at one place.
/// `fits` says whether points confirm a camera's pose.
pub(super) fn far_cameras(centers: &[[f64; 3]], fits: impl Fn(usize) -> bool) -> Vec<(usize, f64)> {
    let sorted = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values
    };
    let median = |values: &[f64]| values.get(values.len() / 2).copied().unwrap_or(0.0);
    let middle: [f64; 3] = std::array::from_fn(|k| median(&sorted(centers.iter().map(|c| c[k]).collect())));
    let distances: Vec<f64> = centers.iter().map(|c| distance(*c, middle)).collect();
    let ascending = sorted(distances.clone());
    let typical = median(&ascending);
    let rounding = 1e-9 * middle.iter().fold(1.0, |m: f64, v| m.max(v.abs()));
    let n = centers.len();
    if n < 3 || typical <= rounding {
        return Vec::new();
    }
    let reach = match n < LEAST_CAMERAS {
        true => f64::INFINITY,
        false => ascending.get(n - 1 - (n / 10).max(1)).copied().unwrap_or(typical),
    };
    let is_far = |(at, d): &(usize, f64)| {
        let times = d / typical;
        times > FAR || times.is_nan() || (*d > APART * reach && !fits(*at))
    };
    distances.into_iter().enumerate().filter(is_far).map(|(at, d)| (at, d / typical)).collect()
}

/// Offset: mean of the training cameras' centres. Extent: 1.1 x the largest distance of a training camera from the
/// offset, in dataset units. Where the cameras have no spread, the extent is the median distance of the points from the
/// cameras, which is about the extent of cameras around an object. Without points it is one dataset unit.
pub(super) fn scene_frame(centers: &[[f64; 3]], points: &[Point]) -> (Frame, f64, Option<Warning>) {
    let n = centers.len().max(1) as f64;
    // Sums are relative to the first centre, so that geo-referenced coordinates keep their last digits.
    let origin = centers.first().copied().unwrap_or_default();
    let offset: [f64; 3] =
        std::array::from_fn(|k| origin[k] + centers.iter().map(|c| c[k] - origin[k]).sum::<f64>() / n);
    let reach = 1.1 * centers.iter().map(|c| distance(*c, offset)).fold(0.0, f64::max);

    let mut distances: Vec<f64> = points.iter().map(|p| distance(p.position, offset)).collect();
    distances.sort_by(f64::total_cmp);
    let typical = distances.get(distances.len() / 2).copied().filter(|d| *d > 0.0);
    let rounding = 1e-9 * offset.iter().fold(1.0, |m: f64, v| m.max(v.abs()));
    let smallest = typical.map_or(rounding, |d| (DEGENERATE * d).max(rounding));
    let (extent, warning) = if reach > smallest {
        (reach, None)
    } else {
        let extent = typical.filter(|d| *d > rounding).unwrap_or(1.0);
        (extent, Some(Warning::CamerasAtOnePlace { cameras: centers.len(), extent }))
    };
    (Frame { offset, scale: Frame::EXTENT / extent }, extent, warning)
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt()
}
