//! Where on the surfaces that stereo has found splats begin.

use rayon::prelude::*;

use crate::saliency::{self, Cache, Gate, Plane};
use crate::scene::Camera;
use crate::stereo::{FusedPoint, Scene, StereoView};
use crate::train::Error;
use crate::train::settings::Settings;

/// Densities at equal error have this exponent where the sum of the errors is to be least for a number of splats. Where
/// the squared error grows with spacing d as A d^p, the errors are equal at densities 1 / d^2 in proportion to A^(2 /
/// p), and their sum is least at A^(2 / (p + 2)); p is about 1 for common texture.
const EVENNESS: f64 = 1.0 / 3.0;

/// A point at which a splat begins.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chosen<'a> {
    pub(super) point: &'a FusedPoint,
    /// From one splat to the next around the point, in pixels of the point's first view.
    pub(super) spacing: f64,
}

/// How many splats each pixel of each view is to begin with, at most one: row by row for each view.
pub(super) struct Densities(Vec<Vec<f32>>);

impl Densities {
    /// The same everywhere.
    pub(super) fn uniform(scene: &Scene) -> Self {
        Self(scene.views.iter().map(|view| vec![1.0; view.pixels()]).collect())
    }

    /// As close as it takes to show the photographs, with the error that the settings allow for the mask's value.
    pub(super) fn by_frequency(scene: &Scene, training: &Settings, gate: Gate, sigma: f64) -> Result<Self, Error> {
        let (lumas, masks) = masked(scene, training, gate, sigma)?;
        let errors = [training.geometry.stereo_error_low, training.geometry.stereo_error_high];
        let of_view = |(luma, mask): (&Plane, &Plane)| {
            let spacing = saliency::spacing_by_mask(luma, mask, errors)?;
            Ok(spacing.values().iter().map(|s| 1.0 / (s * s)).collect())
        };
        let densities: Result<Vec<Vec<f32>>, saliency::Error> = lumas.par_iter().zip(&masks).map(of_view).collect();
        Ok(Self(densities?))
    }

    fn of(&self, point: &FusedPoint) -> f64 {
        let (view, pixel) = point.first;
        self.0.get(view as usize).and_then(|of| of.get(pixel as usize)).copied().unwrap_or(1.0).into()
    }

    /// The mean over points.
    pub(super) fn mean(&self, points: &[FusedPoint]) -> f64 {
        points.iter().map(|point| self.of(point)).sum::<f64>() / points.len().max(1) as f64
    }

    /// `count` of the points, or all where there are fewer, as dense as the densities say. `layers` is the number of
    /// points for each pixel of surface.
    pub(super) fn choose<'a>(
        &self,
        points: &'a [FusedPoint],
        cameras: &[Camera],
        count: usize,
        layers: f64,
    ) -> Vec<Chosen<'a>> {
        let count = count.min(points.len());
        // Points that are neighbours in a view are neighbours in this order, which leaves and comes back to no place.
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by_cached_key(|&i| {
            let (view, pixel) = points[i].first;
            let width = cameras.get(view as usize).map_or(1, |camera| camera.width.max(1));
            (view, fast_hilbert::xy2h(pixel % width, pixel / width, 16))
        });
        let densities: Vec<f64> = order.iter().map(|&i| self.of(&points[i]).powf(EVENNESS)).collect();
        let times = factor(&densities, count as f64);
        let (mut chosen, mut sum) = (Vec::with_capacity(count), 0.5);
        for (&i, density) in order.iter().zip(&densities) {
            let taken = (density * times).min(1.0);
            sum += taken;
            if sum >= 1.0 && chosen.len() < count {
                sum -= 1.0;
                chosen.push(Chosen { point: &points[i], spacing: 1.0 / (taken * layers).sqrt() });
            }
        }
        chosen
    }
}

/// The luma of the photographs as stereo sees them, and their masks.
fn masked(scene: &Scene, training: &Settings, gate: Gate, sigma: f64) -> Result<(Vec<Plane>, Vec<Plane>), Error> {
    let luma = |view: &StereoView| Plane::new(view.camera.width, view.camera.height, view.luma.clone());
    let lumas = scene.views.iter().map(luma).collect::<Result<Vec<_>, _>>()?;
    let cache = Cache::new(lumas, gate, training.run.seed, &saliency::Settings::default())?;
    let masks = cache.masks(sigma)?;
    Ok((cache.images().cloned().collect(), masks))
}

/// Leaves pixels out of stereo whose mask value is at least `stereo-texture`.
pub(super) fn leave_out_texture(scene: &mut Scene, training: &Settings) -> Result<(), Error> {
    let (from, frequencies) = (training.geometry.stereo_texture, &training.frequencies);
    if from >= 1.0 {
        return Ok(());
    }
    let (_, masks) = masked(scene, training, frequencies.gate, frequencies.sigma)?;
    for (view, mask) in scene.views.iter_mut().zip(masks) {
        let before = view.wanted.take();
        let wanted = |(pixel, value): (usize, &f32)| {
            f64::from(*value) < from && before.as_ref().is_none_or(|w| w.get(pixel).copied().unwrap_or(false))
        };
        view.wanted = Some(mask.values().iter().enumerate().map(wanted).collect());
    }
    Ok(())
}

/// What densities are multiplied by for their sum, each at most 1, to be `count`.
fn factor(densities: &[f64], count: f64) -> f64 {
    let sum = |times: f64| densities.iter().map(|d| (d * times).min(1.0)).sum::<f64>();
    let (mut low, mut high) = (0.0, 1.0);
    while sum(high) < count && high < 1e9 {
        high *= 2.0;
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if sum(middle) < count { low = middle } else { high = middle }
    }
    high
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Camera;

    #[test]
    fn points_are_as_dense_as_asked_and_as_many() {
        let size = 64_u32;
        let camera = Camera {
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            translation: [0.0; 3],
            fx: 64.0,
            fy: 64.0,
            cx: 32.0,
            cy: 32.0,
            width: size,
            height: size,
        };
        let point = |k: u32| FusedPoint {
            position: [f64::from(k % size), f64::from(k / size), 0.0],
            normal: [0.0, 0.0, 1.0],
            colour: [0; 3],
            pixels: 1,
            first: (0, k),
        };
        let points: Vec<FusedPoint> = (0..size * size).map(point).collect();
        // Splats are twice as dense on the right, where equal errors would ask for eight times as many.
        let density = (0..size * size).map(|k| if k % size < size / 2 { 0.05 } else { 0.4 }).collect();
        let chosen = Densities(vec![density]).choose(&points, &[camera], 1000, 1.0);
        assert_eq!(chosen.len(), 1000);
        // Two in three splats are on the right half, which is 32 times 64 pixels large.
        let want =
            |chosen: &Chosen<'_>| (2048.0 / if chosen.point.first.1 % size < 32 { 333.0 } else { 667.0_f64 }).sqrt();
        assert!(chosen.iter().all(|chosen| (chosen.spacing / want(chosen) - 1.0).abs() < 0.01));
        let chosen: Vec<&FusedPoint> = chosen.iter().map(|chosen| chosen.point).collect();
        let right = chosen.iter().filter(|p| p.position[0] >= f64::from(size / 2)).count();
        assert!(right.abs_diff(667) <= 2, "{right}");
        // Evenly within: no square of 8 x 8 pixels lacks its share.
        for corner in (0..64).map(|k| [8 * (k % 8), 8 * (k / 8)]) {
            let inside = |p: &&&FusedPoint| (0..2).all(|k| (p.position[k] as u32) / 8 == corner[k] / 8);
            let want = if corner[0] < size / 2 { 10.4 } else { 20.8 };
            let got = chosen.iter().filter(inside).count() as f64;
            assert!((got - want).abs() <= 1.0, "{got} of {want} at {corner:?}");
        }
    }

    #[test]
    fn more_points_than_there_are_is_all_of_them() {
        assert!((factor(&[0.5, 0.5], 1.0) - 1.0).abs() < 1e-9);
        assert!((factor(&[0.1, 0.4], 1.25) - 2.5).abs() < 1e-6, "no density is above 1");
    }
}
