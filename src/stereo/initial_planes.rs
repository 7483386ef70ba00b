//! The initial hypotheses of pixels, and the range of their depths.

use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};

use super::prior::hypothesis;
use crate::scene::Camera;

/// Number of nearest points that a plane is fitted to.
const NEIGHBOURS: usize = 6;
/// Side in pixels of the squares that start with one plane.
const CELL: u32 = 4;
/// Weight of the preference for planes parallel to the image, in units of the points' spread.
const FLATNESS: f64 = 0.2;
/// Share of the points' depths left out at either end before the range is widened.
const OUTSIDE: f64 = 0.01;
/// Factor by which the range of the points' depths is widened on both sides.
const WIDENED: f64 = 1.3;

/// The initial hypotheses of a view's pixels.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum InitialPlanes {
    /// Random planes in the range of depths.
    #[default]
    Random,
    /// For each pixel, the inverse depth and its change per pixel to the right and down; random where the inverse depth
    /// is not positive.
    Hypotheses(Vec<[f32; 3]>),
}

impl InitialPlanes {
    /// Planes fitted to the nearest of `points`, given as (u, v, depth) with u and v in pixels.
    pub fn from_points(camera: &Camera, points: &[[f64; 3]]) -> Self {
        let usable = |p: &&[f64; 3]| p.iter().all(|v| v.is_finite()) && p[2] > 0.0;
        let points: Vec<[f64; 3]> = points.iter().filter(usable).copied().collect();
        if points.is_empty() {
            return Self::Random;
        }
        let places: Vec<[f64; 2]> = points.iter().map(|p| [p[0], p[1]]).collect();
        let tree = ImmutableKdTree::<f64, 2>::new_from_slice(&places);
        let wanted = NonZero::new(NEIGHBOURS).unwrap_or(NonZero::<usize>::MIN);
        let mut rows = vec![[0.0; 3]; camera.width as usize * camera.height as usize];
        for top in (0..camera.height).step_by(CELL as usize) {
            for left in (0..camera.width).step_by(CELL as usize) {
                let middle = [left, top].map(|v| f64::from(v) + 0.5 * f64::from(CELL));
                let near = tree.nearest_n::<SquaredEuclidean>(&middle, wanted);
                let near: Vec<([f64; 3], f64)> =
                    near.iter().filter_map(|n| Some((*points.get(n.item as usize)?, n.distance))).collect();
                let [d, gx, gy] = plane(middle, &near);
                for y in top..(top + CELL).min(camera.height) {
                    for x in left..(left + CELL).min(camera.width) {
                        let away = [f64::from(x) + 0.5 - middle[0], f64::from(y) + 0.5 - middle[1]];
                        let here = (d + gx * away[0] + gy * away[1]).max(0.5 * d);
                        rows[(y * camera.width + x) as usize] = [here as f32, gx as f32, gy as f32];
                    }
                }
            }
        }
        Self::Hypotheses(rows)
    }

    /// From a render's maps: for each pixel, the depth along the camera's axis and the normal in the camera frame,
    /// towards the camera. Pixels without a positive depth start at random.
    pub fn from_maps(camera: &Camera, depth: &[f32], normals: &[[f32; 3]]) -> Self {
        let one = |(pixel, (z, n)): (usize, (&f32, &[f32; 3]))| {
            let pixel = pixel as u32;
            let middle = [pixel % camera.width, pixel / camera.width].map(|v| f64::from(v) + 0.5);
            let depth = f64::from(*z);
            let facing = hypothesis(camera, middle, depth, n.map(f64::from));
            facing.unwrap_or(if depth > 0.0 { [(1.0 / depth) as f32, 0.0, 0.0] } else { [0.0; 3] })
        };
        Self::Hypotheses(depth.iter().zip(normals).enumerate().map(one).collect())
    }

    /// Rows of hypotheses without a score.
    pub(super) fn rows(&self, camera: &Camera) -> Vec<[f32; 4]> {
        match self {
            Self::Random => vec![[0.0; 4]; camera.width as usize * camera.height as usize],
            Self::Hypotheses(rows) => rows.iter().map(|[d, gx, gy]| [*d, *gx, *gy, 0.0]).collect(),
        }
    }
}

/// The inverse depth at a position and its slopes, fitted to points given as (u, v, depth) with their squared distance.
/// Near points weigh more, and planes parallel to the image are preferred.
fn plane(at: [f64; 2], points: &[([f64; 3], f64)]) -> [f64; 3] {
    let spread = points.iter().map(|(_, squared)| squared).sum::<f64>() / points.len().max(1) as f64 + 1.0;
    let weighted = points.iter().map(|([u, v, z], squared)| {
        let weight = 1.0 / (squared + 0.25 * spread);
        (weight, [u - at[0], v - at[1]], 1.0 / z)
    });
    let total: f64 = weighted.clone().map(|(w, ..)| w).sum();
    let mean = |f: &dyn Fn([f64; 2], f64) -> f64| weighted.clone().map(|(w, p, d)| w * f(p, d)).sum::<f64>() / total;
    let (mu, mv, md) = (mean(&|p, _| p[0]), mean(&|p, _| p[1]), mean(&|_, d| d));
    let ridge = FLATNESS * spread;
    let (uu, vv) = (mean(&|p, _| (p[0] - mu).powi(2)) + ridge, mean(&|p, _| (p[1] - mv).powi(2)) + ridge);
    let uv = mean(&|p, _| (p[0] - mu) * (p[1] - mv));
    let (ud, vd) = (mean(&|p, d| (p[0] - mu) * (d - md)), mean(&|p, d| (p[1] - mv) * (d - md)));
    let determinant = uu * vv - uv * uv;
    let (gx, gy) = ((ud * vv - vd * uv) / determinant, (vd * uu - ud * uv) / determinant);
    let bounds = points.iter().map(|([_, _, z], _)| 1.0 / z);
    let (low, high) = bounds.fold((f64::INFINITY, 0.0_f64), |(l, h), d| (l.min(d), h.max(d)));
    [(md - gx * mu - gy * mv).clamp(low, high), gx, gy]
}

/// Nearest and farthest depth to search, from the depths of points; `None` without a positive depth.
pub fn depth_range(depths: impl IntoIterator<Item = f64>) -> Option<[f64; 2]> {
    let mut sorted: Vec<f64> = depths.into_iter().filter(|z| z.is_finite() && *z > 0.0).collect();
    sorted.sort_by(f64::total_cmp);
    let outside = (OUTSIDE * sorted.len() as f64) as usize;
    let (near, far) = (sorted.get(outside)?, sorted.get(sorted.len() - 1 - outside)?);
    Some([near / WIDENED, far * WIDENED])
}
