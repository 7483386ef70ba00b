//! How many splats photographs ask for at places of theirs, by local frequency.

use crate::dataset::{Dataset, HostShare, View};
use crate::saliency::{self, Gate, Plane};
use crate::train::Settings;
use crate::train::prepare::{finer, longer_side};
use crate::train::settings::Frequencies;

/// Most photographs that are decoded for a plan. Of more, evenly chosen ones speak for all.
const DECODED: usize = 2048;

/// Splats at the height of a training for each one that the rule asks for on the surface of all points. Ten scenes had
/// from 0.2 to 0.9: training begins where several photographs agree, and grows from there to about 2.5 times as many.
const HEIGHT: f64 = 0.5;
/// The same where splats do not grow.
const BEGINNING: f64 = 0.2;

/// A place in a photograph.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    /// Position of the view in [`Dataset::views`].
    pub(super) view: u32,
    /// Pixels at the size of training.
    pub(super) at: [f64; 2],
    /// Pixels of the piece of surface around it.
    pub(super) pixels: f64,
}

/// The way from pixels to splats: that by which a training chooses the number of its first splats.
pub(super) struct Frequency<'a> {
    settings: &'a Settings,
    share: HostShare,
}

impl<'a> Frequency<'a> {
    pub(super) fn new(settings: &'a Settings, share: HostShare) -> Self {
        Self { settings, share }
    }

    pub(super) fn seed(&self) -> u64 {
        self.settings.run.seed
    }

    /// Splats of each place; 0 where there is none. Photographs are decoded one after the other, within the share of
    /// host memory. Places of photographs that are not decoded, or that cannot be, have the mean density of the others.
    pub(super) fn splats(&self, dataset: &Dataset, places: &[Option<Place>]) -> Result<Vec<f64>, super::Error> {
        let mut order: Vec<usize> = (0..places.len()).filter(|at| places[*at].is_some()).collect();
        let view = |at: usize| places[at].map_or(u32::MAX, |place| place.view);
        order.sort_by_key(|at| view(*at));
        let of_views: Vec<&[usize]> = order.chunk_by(|a, b| view(*a) == view(*b)).collect();
        let step = of_views.len().div_ceil(DECODED).max(1);
        let chosen: Vec<&[usize]> = of_views.into_iter().step_by(step).collect();
        let viewed = |of: &[usize]| of.first().and_then(|at| dataset.views.get(view(*at) as usize));
        let costs: Vec<u64> = chosen.iter().map(|of| viewed(of).map_or(0, View::decoding_bytes)).collect();
        let found = self.share.in_turns(&costs, |turn| {
            let of = chosen[turn];
            let at = of.iter().filter_map(|at| places[*at]);
            viewed(of).map_or(Ok(None), |view| self.densities(view, at))
        });
        let mut densities: Vec<Option<f64>> = vec![None; places.len()];
        for (of, found) in chosen.iter().zip(found) {
            for (at, density) in of.iter().zip(found?.into_iter().flatten()) {
                densities[*at] = Some(density);
            }
        }
        let (sum, count) = densities.iter().flatten().fold((0.0, 0.0), |(sum, count), d| (sum + d, count + 1.0));
        let mean = if count > 0.0 { sum / count } else { 1.0 };
        let splats = |(place, density): (&Option<Place>, Option<f64>)| {
            place.map_or(0.0, |place| place.pixels * density.unwrap_or(mean))
        };
        Ok(places.iter().zip(densities).map(splats).collect())
    }

    /// Splats that a pixel takes in the mean around places of a photograph: reconstructed points lie where texture is
    /// finest, and the surface that they stand for is plainer. `None` if the photograph cannot be decoded, which
    /// training will tell.
    fn densities(&self, view: &View, at: impl Iterator<Item = Place>) -> Result<Option<Vec<f64>>, super::Error> {
        let Ok(photograph) = view.photograph() else { return Ok(None) };
        let (width, height) = (view.camera.width, view.camera.height);
        let geometry = &self.settings.geometry;
        let luma = Plane::luma(width, height, &photograph.pixels)?.reduced(geometry.stereo_side);
        drop(photograph);
        let frequencies = Frequencies::default();
        let seen = Gate::Spectral.mask(&luma, frequencies.sigma, 0, &saliency::Settings::default())?;
        let spacing =
            saliency::spacing_by_mask(&luma, &seen.mask, [geometry.stereo_error_low, geometry.stereo_error_high])?;
        let shrunk = [f64::from(luma.width()) / f64::from(width), f64::from(luma.height()) / f64::from(height)];
        let grown = if self.settings.density.no_densify { BEGINNING } else { HEIGHT };
        let finer = finer(longer_side([(width, height)]), self.settings.run.iterations);
        let times = grown * finer * shrunk[0] * shrunk[1];
        let around = Means::new(&luma, spacing.values().iter().map(|s| 1.0 / f64::from(*s).powi(2)));
        let of = |place: Place| {
            let [u, v] = [place.at[0] * shrunk[0], place.at[1] * shrunk[1]];
            times * around.mean([u, v], 0.5 * (place.pixels * shrunk[0] * shrunk[1]).sqrt())
        };
        Ok(Some(at.map(of).collect()))
    }
}

/// Means of a plane over rectangles, by sums from the first pixel on.
struct Means {
    width: usize,
    height: usize,
    sums: Vec<f64>,
}

impl Means {
    fn new(plane: &Plane, values: impl Iterator<Item = f64>) -> Self {
        let (width, height) = (plane.width() as usize, plane.height() as usize);
        let mut sums = vec![0.0; (width + 1) * (height + 1)];
        for (pixel, value) in values.enumerate().take(width * height) {
            let (x, y) = (pixel % width + 1, pixel / width + 1);
            let at = |x: usize, y: usize| y * (width + 1) + x;
            sums[at(x, y)] = value + sums[at(x - 1, y)] + sums[at(x, y - 1)] - sums[at(x - 1, y - 1)];
        }
        Self { width, height, sums }
    }

    /// The mean over a square with its middle at a place, cut to the plane; one pixel at least.
    fn mean(&self, [u, v]: [f64; 2], half: f64) -> f64 {
        let ends = |at: f64, side: usize| {
            let first = ((at - half).max(0.0) as usize).min(side.saturating_sub(1));
            (first, ((at + half).ceil().max(0.0) as usize).clamp(first + 1, side.max(first + 1)))
        };
        let ((x0, x1), (y0, y1)) = (ends(u, self.width), ends(v, self.height));
        let sum = |x: usize, y: usize| self.sums.get(y * (self.width + 1) + x).copied().unwrap_or(0.0);
        let pixels = ((x1 - x0) * (y1 - y0)) as f64;
        (sum(x1, y1) - sum(x0, y1) - sum(x1, y0) + sum(x0, y0)) / pixels
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_those_of_the_pixels_in_a_square() {
        let plane = Plane::new(5, 4, (0..20_u8).map(f32::from).collect()).expect("a plane");
        let means = Means::new(&plane, plane.values().iter().map(|v| f64::from(*v)));
        assert_eq!(means.mean([2.5, 1.5], 0.4), 7.0, "one pixel");
        assert_eq!(means.mean([1.0, 1.0], 1.0), 3.0, "four pixels");
        assert_eq!(means.mean([2.0, 2.0], 99.0), 9.5, "all");
        assert_eq!(means.mean([4.9, 3.9], 0.0), 19.0);
        assert_eq!(means.mean([-3.0, 9.0], 0.0), 15.0, "outside: the nearest pixel");
    }
}
