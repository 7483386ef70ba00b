//! How wide splats are on the photographs, against the wavelengths that the photographs show there.

use glam::{DQuat, DVec3};
use rayon::prelude::*;

use crate::saliency::{self, Cache, Plane};
use crate::scene::{Camera, Gaussians};
use crate::train::Error;
use crate::train::input::View;
use crate::train::settings::Settings;

/// A view has a say if it shows a splat at least at this share of the size at which the splat is seen largest.
const LARGE_ENOUGH: f64 = 0.5;
/// A splat counts as at most this many times as wide as it should be in a view.
const MOST: f64 = 4.0;
/// Longest spacing along an axis over the shortest, as for first splats.
const LONGEST_RATIO: f64 = 3.0;

/// What a photograph shows, at the size of its depths.
pub(super) struct Detail {
    camera: Camera,
    /// From one splat to the next, in pixels; 0 where nothing limits the spacing.
    spacings: Vec<f64>,
    tensors: Vec<[f64; 3]>,
}

impl Detail {
    fn of(camera: Camera, luma: &Plane, mask: &Plane, errors: [f64; 2]) -> Result<Self, Error> {
        let spacing = saliency::spacing_by_mask(luma, mask, errors)?;
        let spacings: Vec<f64> = spacing.values().iter().map(|s| f64::from(*s)).collect();
        let places: Vec<(usize, f64)> = spacings.iter().copied().enumerate().collect();
        let tensors = saliency::variation(luma, &places);
        let limited = |s: f64| if s < saliency::WIDEST_SPACING { s } else { 0.0 };
        Ok(Self { camera, spacings: spacings.into_iter().map(limited).collect(), tensors })
    }

    /// The width of a splat (two standard deviations) in pixels over the spacing in the direction of its axis, for each
    /// axis; 0 where nothing limits the spacing.
    fn excess(&self, [u, v]: [f64; 2], axes: &[[f64; 2]; 3]) -> [f64; 3] {
        let pixel = v as usize * self.camera.width as usize + u as usize;
        let (Some(&spacing), Some(&[xx, xy, yy])) = (self.spacings.get(pixel), self.tensors.get(pixel)) else {
            return [0.0; 3];
        };
        if spacing <= 0.0 {
            return [0.0; 3];
        }
        let floor = saliency::variation_floor(spacing);
        let (xx, yy) = (xx + floor, yy + floor);
        let mean = (xx * yy - xy * xy).max(floor * floor).sqrt();
        axes.map(|[x, y]| {
            let squared = x * x + y * y;
            if squared <= 0.0 {
                return 0.0;
            }
            // Spacings are as the wavelengths in their directions, so as the inverse roots of the variations.
            let variation = (xx * x * x + 2.0 * xy * x * y + yy * y * y) / squared;
            let along = (mean / variation).sqrt().clamp(1.0 / LONGEST_RATIO.sqrt(), LONGEST_RATIO.sqrt());
            2.0 * squared.sqrt() / (spacing * along)
        })
    }
}

/// The details of photographs: lumas and masks first, spacings for some photographs at a time.
pub(super) struct Details {
    cameras: Vec<Camera>,
    cache: Cache,
    masks: Vec<Plane>,
    errors: [f64; 2],
}

impl Details {
    /// Decodes every photograph once, and computes its mask.
    pub(super) fn new(views: &[View], settings: &Settings) -> Result<Self, Error> {
        let (frequencies, geometry) = (&settings.frequencies, &settings.geometry);
        let reduced = |view: &View| {
            let (width, height) = geometry.prior_size(view.camera.width, view.camera.height);
            view.camera.resized(width, height)
        };
        let cameras: Vec<Camera> = views.iter().map(reduced).collect();
        let mut lumas = Vec::with_capacity(views.len());
        for (views, cameras) in views.chunks(at_once()).zip(cameras.chunks(at_once())) {
            let luma = |(view, camera): (&View, &Camera)| -> Result<Plane, Error> {
                let pixels = view.photograph.pixels()?;
                let whole = Plane::luma(view.camera.width, view.camera.height, &pixels)?;
                Ok(whole.resized(camera.width, camera.height))
            };
            lumas.extend(views.par_iter().zip(cameras).map(luma).collect::<Result<Vec<_>, _>>()?);
        }
        let cache = Cache::new(lumas, frequencies.gate, settings.run.seed, &saliency::Settings::default())?;
        let masks = cache.masks(frequencies.sigma)?;
        Ok(Self { cameras, cache, masks, errors: [geometry.stereo_error_low, geometry.stereo_error_high] })
    }

    /// How many times as wide as the local spacing each splat is along each axis, two standard deviations counting as
    /// the width: the mean over the views that see the splat at least half as large as any view does. Views do not know
    /// what hides what.
    pub(super) fn excess(&self, model: &Gaussians) -> Result<Vec<[f64; 3]>, Error> {
        let splats: Vec<Axes> = (0..model.len()).into_par_iter().map(|i| Axes::of(model, i)).collect();
        let least: Vec<f64> = splats.par_iter().map(|splat| LARGE_ENOUGH * splat.largest(&self.cameras)).collect();
        let mut sums = vec![([0.0; 3], 0_u32); splats.len()];
        let lumas: Vec<&Plane> = self.cache.images().collect();
        let numbers: Vec<usize> = (0..self.cameras.len()).collect();
        for some in numbers.chunks(at_once()) {
            let detail = |&k: &usize| Detail::of(self.cameras[k], lumas[k], &self.masks[k], self.errors);
            for detail in some.par_iter().map(detail).collect::<Result<Vec<_>, _>>()? {
                let add = |((splat, least), (sum, views)): ((&Axes, &f64), &mut ([f64; 3], u32))| {
                    let Some(seen) = splat.seen(&detail.camera).filter(|seen| seen.size >= *least) else { return };
                    let excess = detail.excess(seen.place, &seen.axes);
                    (0..3).for_each(|k| sum[k] += excess[k].min(MOST));
                    *views += 1;
                };
                splats.par_iter().zip(&least).zip(&mut sums).for_each(add);
            }
        }
        Ok(sums.into_iter().map(|(sum, views)| sum.map(|s| s / f64::from(views.max(1)))).collect())
    }
}

/// Photographs that are worked on at once.
fn at_once() -> usize {
    rayon::current_num_threads().max(1)
}

/// A splat's centre, and its axes as long as the standard deviations.
struct Axes {
    mean: DVec3,
    axes: [DVec3; 3],
}

/// A splat in a view.
struct Seen {
    place: [f64; 2],
    /// The axes in pixels.
    axes: [[f64; 2]; 3],
    /// Length of the longest one.
    size: f64,
}

impl Axes {
    fn of(model: &Gaussians, i: usize) -> Self {
        let row = |values: &[f32]| DVec3::new(values[0].into(), values[1].into(), values[2].into());
        let q = &model.quats[4 * i..4 * i + 4];
        let turn = DQuat::from_xyzw(q[1].into(), q[2].into(), q[3].into(), q[0].into());
        let turn = if turn.length_squared() > 1e-24 { turn.normalize() } else { DQuat::IDENTITY };
        let scales = row(&model.scales[3 * i..3 * i + 3]).exp();
        let axes = [DVec3::X * scales.x, DVec3::Y * scales.y, DVec3::Z * scales.z].map(|axis| turn * axis);
        Self { mean: row(&model.means[3 * i..3 * i + 3]), axes }
    }

    /// The splat in a view; `None` where its centre is outside of the photograph, or the camera is within it.
    fn seen(&self, camera: &Camera) -> Option<Seen> {
        let [u, v, z] = camera.placed(self.mean.to_array())?;
        if self.axes.iter().any(|axis| axis.length() >= z || !axis.is_finite()) {
            return None;
        }
        let (x, y) = ((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy);
        let [right, down, forward] = camera.rotation.map(DVec3::from_array);
        let axes = self.axes.map(|axis| {
            let away = axis.dot(forward);
            [camera.fx * (axis.dot(right) - x * away) / z, camera.fy * (axis.dot(down) - y * away) / z]
        });
        let size = axes.iter().map(|[x, y]| x.hypot(*y)).fold(0.0, f64::max);
        Some(Seen { place: [u, v], axes, size })
    }

    fn largest(&self, cameras: &[Camera]) -> f64 {
        cameras.iter().filter_map(|camera| self.seen(camera)).map(|seen| seen.size).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Pixels;

    const SIZE: u32 = 64;

    /// The excess of a flat splat on a photograph: two standard deviations are 3 by 1.5 pixels, turned about the view.
    fn excess(degrees: f64, luma: impl Fn(f64, f64) -> f64) -> [f64; 3] {
        let camera = Camera {
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            translation: [0.0, 0.0, 2.0],
            fx: 64.0,
            fy: 64.0,
            cx: 32.0,
            cy: 32.0,
            width: SIZE,
            height: SIZE,
        };
        let pixel = |k: u32| [(255.0 * luma(f64::from(k % SIZE), f64::from(k / SIZE))).round() as u8; 3];
        let pixels = (0..SIZE * SIZE).flat_map(|k| pixel(k).into_iter().chain([255])).collect();
        let views = [View::new("one", camera, Pixels::Rgba8(pixels))];
        let mut settings = Settings::default();
        settings.geometry.stereo_side = SIZE;
        let mut model = Gaussians::zeros(2);
        let half = (0.5 * degrees).to_radians();
        for i in 0..2 {
            model.quats[4 * i..4 * i + 4].copy_from_slice(&[half.cos() as f32, 0.0, 0.0, half.sin() as f32]);
            let pixels = |n: f64| (n / 2.0 * 2.0 / 64.0_f64).ln() as f32;
            model.scales[3 * i..3 * i + 3].copy_from_slice(&[pixels(3.0), pixels(1.5), pixels(0.1)]);
        }
        // The second one is behind the camera.
        model.means[5] = -5.0;
        let found = Details::new(&views, &settings).expect("details").excess(&model).expect("excess");
        assert_eq!(found[1], [0.0; 3]);
        found[0]
    }

    #[test]
    fn splats_are_wide_on_fine_texture_and_not_on_flat_fields() {
        assert_eq!(excess(0.0, |_, _| 0.5), [0.0; 3]);
        let wave = |x: f64, length: f64| (x * std::f64::consts::TAU / length).sin();
        let board = |length: f64| move |x: f64, y: f64| 0.5 + 0.2 * wave(x, length) + 0.2 * wave(y, length);
        let ([fine, fine_across, thin], [coarse, ..]) = (excess(0.0, board(6.0)), excess(0.0, board(24.0)));
        assert!(fine > 2.0 && thin < 0.1, "{fine} {thin}");
        assert!((fine / fine_across - 2.0).abs() < 0.4, "twice as long as wide: {fine} {fine_across}");
        assert!(fine > 2.0 * coarse, "{fine} {coarse}");
    }

    #[test]
    fn splats_along_stripes_are_less_wide_than_across() {
        let stripes = |x: f64, _: f64| 0.5 + 0.2 * (x * std::f64::consts::TAU / 8.0).sin();
        let ([across, ..], [along, ..]) = (excess(0.0, stripes), excess(90.0, stripes));
        assert!((across / along - 3.0).abs() < 0.1 && across > 2.0, "{across} across, {along} along");
    }
}
