//! Splats off the surface.

use rayon::prelude::*;

use super::closest::Closest;
use crate::scene::{Frame, Gaussians};

/// A splat counts as opaque above this opacity.
const OPAQUE: f64 = 0.5;
/// Share of the extent beyond which a splat floats.
const FAR: f64 = 0.01;

/// How far splats are from a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OffSurface {
    /// Median distance of opaque splats, weighted by their mass, in the dataset's units.
    pub distance: Option<f64>,
    /// Share of the mass of all splats that floats.
    pub floaters: Option<f64>,
}

/// Distances of a model's splats (in scene coordinates) from the true surface (in the dataset's).
///
/// The *opaque mass* of a splat is its opacity times the product of its two largest standard deviations: what it covers
/// where it is seen from its flat side. The distance is that of its centre from the nearest point of the surface.
/// `distance` is the median over splats with an opacity above 0.5, weighted by mass; `floaters` is the share of the
/// mass of all splats, also transparent ones, that is further away than 1 % of `extent` (the dataset's extent as
/// [`crate::dataset::Dataset::extent`] has it, in its units). The surface has to cover what the photographs show:
/// splats beyond its border would count too.
pub fn off_surface(model: &Gaussians, frame: &Frame, extent: f64, surface: &Closest) -> OffSurface {
    if surface.is_empty() {
        return OffSurface::default();
    }
    let splat = |i: usize| {
        let row = |plane: &[f32]| [0, 1, 2].map(|k| f64::from(plane[3 * i + k]));
        let opacity = 1.0 / (1.0 + (-f64::from(model.opacities[i])).exp());
        let mut axes = row(&model.scales);
        axes.sort_by(f64::total_cmp);
        let mass = opacity * (axes[1] + axes[2]).exp();
        let distance = surface.distance(frame.to_dataset(row(&model.means)));
        (mass, distance, opacity)
    };
    let splats: Vec<(f64, f64, f64)> =
        (0..model.len()).into_par_iter().map(splat).filter(|(m, d, _)| m.is_finite() && d.is_finite()).collect();
    let total: f64 = splats.iter().map(|(mass, ..)| mass).sum();
    // The sum of no floats is -0, which would be told as such.
    let far: f64 = splats.iter().filter(|(_, d, _)| *d > FAR * extent).map(|(mass, ..)| mass).sum::<f64>().abs();
    let mut opaque: Vec<(f64, f64)> = splats.iter().filter(|s| s.2 > OPAQUE).map(|s| (s.1, s.0)).collect();
    OffSurface { distance: weighted_median(&mut opaque), floaters: (total > 0.0).then(|| far / total) }
}

/// The smallest value such that it and the smaller ones have half of the weight; values with their weights.
fn weighted_median(values: &mut [(f64, f64)]) -> Option<f64> {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * values.iter().map(|v| v.1).sum::<f64>();
    let mut sum = 0.0;
    values
        .iter()
        .find(|v| {
            sum += v.1;
            sum >= half
        })
        .map(|v| v.0)
}
