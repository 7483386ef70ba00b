//! How many splats photographs ask for at places of theirs, by local frequency.

use crate::dataset::{Dataset, HostShare, View};
use crate::saliency::{self, Gate, Plane};
use crate::train::Settings;
use crate::train::prepare::{finer, longer_side};
use crate::train::settings::Frequencies;

/// Most photographs that are decoded for a plan. Of more, evenly chosen ones speak for all.
const DECODED: usize = 2048;

/// A place in a photograph.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    /// Position of the view in [`Dataset::views`].
    pub(super) view: u32,
    /// Pixels at the size of training.
    pub(super) at: [f64; 2],
    /// Pixels around it.
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
            let at = of.iter().filter_map(|at| places[*at].map(|place| place.at));
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

    /// Splats that a pixel takes at places of a photograph; `None` if it cannot be decoded, which training will tell.
    fn densities(&self, view: &View, at: impl Iterator<Item = [f64; 2]>) -> Result<Option<Vec<f64>>, super::Error> {
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
        let times = shrunk[0] * shrunk[1] * finer(longer_side([(width, height)]), self.settings.run.iterations);
        let of = |[u, v]: [f64; 2]| {
            let along = |at: f64, by: f64, side: u32| ((at * by) as u32).min(side.saturating_sub(1)) as usize;
            let (x, y) = (along(u, shrunk[0], luma.width()), along(v, shrunk[1], luma.height()));
            let spacing = spacing.values().get(y * luma.width() as usize + x).map_or(1.0, |s| f64::from(*s));
            times / (spacing * spacing)
        };
        Ok(Some(at.map(of).collect()))
    }
}
