//! Random points for a training without triangulated points.

use crate::scene::Camera;
use crate::scene::random::Random;

/// Number of points.
const POINTS: usize = 50_000;
/// Candidates per point. Where cameras hardly share a view, fewer points are found.
const TRIES: usize = 40;
/// Least number of cameras that have a point in view.
const SHARED_BY: usize = 3;
/// Depths range from the typical depth divided by this factor to the typical depth times it.
const DEPTHS: f64 = 2.0;
/// Least determinant of the mean of I - d d^T over the axes d, which is 0 for parallel axes. Below, the point nearest
/// to all axes has no meaning.
const CONVERGING: f64 = 0.01;
/// For cameras that look in one direction: depth in units of the neighbours' distance times the focal length over the
/// image's longer side. An overlap of three quarters gives this value.
const OVERLAPPING: f64 = 4.0;

/// Points in the view of several cameras, spread evenly over images and over the logarithm of the depth.
///
/// The typical depth is that of the point nearest to all axes if the cameras look at something. Else it is the depth at
/// which neighbouring images overlap by three quarters, as in aerial surveys.
pub(super) fn in_common_view(cameras: &[Camera], seed: u64) -> Vec<[f64; 3]> {
    let Some(typical) = typical_depth(cameras) else { return Vec::new() };
    let mut random = Random::new(seed);
    let shared_by = SHARED_BY.min(cameras.len());
    let mut points = Vec::with_capacity(POINTS);
    for _ in 0..TRIES * POINTS {
        if points.len() == POINTS {
            break;
        }
        let camera = &cameras[(random.unit() * cameras.len() as f64) as usize % cameras.len()];
        let z = typical * DEPTHS.powf(2.0 * random.unit() - 1.0);
        let u = random.unit() * f64::from(camera.width);
        let v = random.unit() * f64::from(camera.height);
        let seen = [(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z];
        let center = camera.center();
        let point = std::array::from_fn(|i| center[i] + (0..3).map(|k| camera.rotation[k][i] * seen[k]).sum::<f64>());
        if cameras.iter().filter(|camera| in_view(camera, point)).take(shared_by).count() == shared_by {
            points.push(point);
        }
    }
    points
}

/// Whether these cameras have such points: not a single camera, and not cameras that are all at one place.
pub(super) fn begins_somewhere(cameras: &[Camera]) -> bool {
    typical_depth(cameras).is_some()
}

/// Whether a point is in front of a camera and inside its image, hidden or not.
pub(crate) fn in_view(camera: &Camera, point: [f64; 3]) -> bool {
    let c = camera.center();
    // Relative to the centre, so that geo-referenced coordinates do not cancel.
    let at: [f64; 3] = camera.rotation.map(|row| (0..3).map(|k| row[k] * (point[k] - c[k])).sum());
    let (u, v) = (camera.fx * at[0] / at[2] + camera.cx, camera.fy * at[1] / at[2] + camera.cy);
    at[2] > 0.0 && (0.0..f64::from(camera.width)).contains(&u) && (0.0..f64::from(camera.height)).contains(&v)
}

fn typical_depth(cameras: &[Camera]) -> Option<f64> {
    if cameras.len() < 2 {
        return None;
    }
    let origin = cameras[0].center();
    let centers: Vec<[f64; 3]> =
        cameras.iter().map(|c| c.center()).map(|c| std::array::from_fn(|k| c[k] - origin[k])).collect();
    // The axes of a camera turned about one place meet there: then distances are only rounding errors.
    let rounding = 1e-9 * origin.iter().fold(1.0, |m: f64, v| m.max(v.abs()));
    if centers.iter().flatten().all(|v| v.abs() <= rounding) {
        return None;
    }
    converging(cameras, &centers)
        .or_else(|| overlapping(cameras, &centers))
        .filter(|depth| depth.is_finite() && *depth > 0.0)
}

/// The median depth of the point nearest to all axes, if most cameras have it in front of them.
fn converging(cameras: &[Camera], centers: &[[f64; 3]]) -> Option<f64> {
    let n = cameras.len() as f64;
    let (mut a, mut b) = ([[0.0; 3]; 3], [0.0; 3]);
    for (camera, center) in cameras.iter().zip(centers) {
        let axis = camera.rotation[2];
        for i in 0..3 {
            for j in 0..3 {
                let across = if i == j { 1.0 } else { 0.0 } - axis[i] * axis[j];
                a[i][j] += across / n;
                b[i] += across * center[j] / n;
            }
        }
    }
    let cross =
        |p: [f64; 3], q: [f64; 3]| [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
    let dot = |p: [f64; 3], q: [f64; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    let minors = [cross(a[1], a[2]), cross(a[2], a[0]), cross(a[0], a[1])];
    let det = dot(a[0], minors[0]);
    if det < CONVERGING {
        return None;
    }
    let point: [f64; 3] = std::array::from_fn(|i| (0..3).map(|k| minors[k][i] * b[k]).sum::<f64>() / det);
    let depth =
        |(camera, center): (&Camera, &[f64; 3])| dot(camera.rotation[2], std::array::from_fn(|k| point[k] - center[k]));
    let mut depths: Vec<f64> = cameras.iter().zip(centers).map(depth).collect();
    depths.sort_by(f64::total_cmp);
    (depths[depths.len() / 4] > 0.0).then(|| depths[depths.len() / 2])
}

fn overlapping(cameras: &[Camera], centers: &[[f64; 3]]) -> Option<f64> {
    let apart = |p: &[f64; 3], q: &[f64; 3]| p.iter().zip(q).map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt();
    let nearest = |i: usize| {
        let others = (0..centers.len()).filter(|j| *j != i).map(|j| apart(&centers[i], &centers[j]));
        others.filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min)
    };
    let long = |camera: &Camera| camera.fx.max(camera.fy) / f64::from(camera.width.max(camera.height));
    let mut depths: Vec<f64> = cameras.iter().enumerate().map(|(i, c)| OVERLAPPING * nearest(i) * long(c)).collect();
    depths.sort_by(f64::total_cmp);
    depths.get(depths.len() / 2).copied()
}
