//! Bytes of the buffers of a training, and how many splats and pairs fit. The bytes are counted by allocating an engine
//! on a planning handle, so no list of buffers is kept here.

use super::Engine;
use crate::dataset::Depth;
use crate::raster::{Variants, Viewer, most_pairs, most_splats};
use crate::scene::Camera;
use crate::train::Error;
use crate::train::input::Outline;
use crate::train::pacing::{Pacing, Residency};
use crate::train::photographs::Photographs;
use crate::train::settings::{DepthPrior, Settings};
use crate::vk::{Gpu, Memory};

/// Pairs reserved for a splat.
pub(in crate::train) const PAIRS_PER_SPLAT: u32 = 8;
/// Pairs reserved for a tile.
const PAIRS_PER_TILE: u32 = 24;
/// Memory in use by others is rounded up to a multiple of this, so that small differences do not change how many splats
/// fit.
const GRAIN: u64 = 16 << 20;
/// Set aside for uploads.
const STAGING: u64 = 4 << 20;

/// Everything that the memory of a training depends on, except the numbers of splats and pairs.
#[derive(Clone)]
pub(in crate::train) struct Needs {
    pub(in crate::train) gpu: Gpu,
    pub(in crate::train) views: Vec<(Camera, Depth)>,
    pub(in crate::train) settings: Settings,
    pub(in crate::train) extent: f64,
    /// Whether views are rendered between steps: held-out views, or training views to weigh splats.
    pub(in crate::train) pictures: bool,
    /// Bytes that the training may use.
    pub(in crate::train) room: u64,
    /// Where the photographs are.
    pub(in crate::train) residency: Residency,
    /// Where the photographs are assumed to be when the most splats are computed. That number must not depend on how
    /// much memory the host has free today.
    counted: Residency,
    pub(in crate::train) in_flight: usize,
}

impl Needs {
    pub(in crate::train) fn new(
        gpu: &Gpu,
        outline: &Outline,
        settings: &Settings,
        pacing: Pacing,
    ) -> Result<Self, Error> {
        let tally = gpu.memory_use();
        let mut needs = Self {
            gpu: gpu.clone(),
            views: outline.train.clone(),
            settings: settings.clone(),
            extent: f64::from(outline.extent),
            pictures: !outline.held_out.is_empty()
                || settings.density.prune_weight > 0.0
                || settings.density.recycle_share > 0.0
                || settings.geometry.depth_prior == DepthPrior::Propagation,
            room: tally.limit.saturating_sub(tally.current.next_multiple_of(GRAIN)),
            residency: pacing.photographs,
            counted: pacing.photographs,
            in_flight: pacing.events_in_flight(),
        };
        let usual = needs.usual_residency()?;
        if needs.residency == Residency::Auto {
            needs.residency = usual;
        }
        // Streaming takes less memory than the photographs on the device, so the limit holds for it too.
        needs.counted = if usual == Residency::Resident { usual } else { needs.residency };
        Ok(needs)
    }

    /// The needs with photographs of 8 x 8 pixels.
    pub(in crate::train) fn of_small_views(&self) -> Self {
        Self { views: self.views.iter().map(|(c, d)| (c.resized(8, 8), *d)).collect(), ..self.clone() }
    }

    /// On the device if the photographs take at most half of the memory, or less than streaming; else streamed.
    fn usual_residency(&self) -> Result<Residency, Error> {
        let resident = self.of_photographs(Residency::Resident)?;
        let little = resident <= self.room / 2 || resident <= self.of_photographs(Residency::Streamed)?;
        Ok(if little { Residency::Resident } else { Residency::Streamed })
    }

    /// Bytes of the buffers of the photographs.
    pub(in crate::train) fn of_photographs(&self, residency: Residency) -> Result<u64, Error> {
        let counting = self.gpu.planning();
        self.photographs(&counting, residency)?;
        Ok(counting.planned_bytes())
    }

    /// Bytes of the buffers of a training with room for `splats` splats and `pairs` pairs, without photographs.
    pub(in crate::train) fn training(&self, variants: Variants, splats: u32, pairs: u32) -> Result<u64, Error> {
        let counting = self.gpu.planning();
        let photographs = Photographs::allocate(&self.gpu.planning(), &[], Residency::Resident, 2, 1)?;
        Engine::allocate(&counting, photographs, self, variants, splats, pairs)?;
        Ok(counting.planned_bytes())
    }

    /// Bytes of the buffers of a training, photographs and temporary buffers included: renders of held-out views,
    /// read-back for a checkpoint, staging.
    pub(in crate::train) fn bytes(&self, variants: Variants, splats: u32, pairs: u32) -> Result<u64, Error> {
        Ok(self.of_photographs(self.residency)? + self.without_photographs(variants, splats, pairs)?)
    }

    fn without_photographs(&self, variants: Variants, splats: u32, pairs: u32) -> Result<u64, Error> {
        let counting = self.gpu.planning();
        let cameras = self.views.iter().map(|(camera, _)| camera);
        if self.pictures
            && let Some(largest) = cameras.max_by_key(|c| u64::from(c.width) * u64::from(c.height))
        {
            Viewer::new(&counting).reserve(splats, largest.width, largest.height)?;
        }
        counting.buffer("staging", STAGING, Memory::Upload)?;
        counting.buffer("read-back", crate::raster::LARGEST_ROW * u64::from(splats), Memory::Readback)?;
        Ok(self.training(variants, splats, pairs)? + counting.planned_bytes())
    }

    /// Buffers of the photographs.
    pub(in crate::train) fn photographs(&self, gpu: &Gpu, residency: Residency) -> Result<Photographs, Error> {
        let at_once = self.settings.texture.views_at_once() as usize;
        Photographs::allocate(gpu, &self.views, residency, self.in_flight + at_once, self.settings.run.bands)
    }

    fn fits(&self, variants: Variants, splats: u32, pairs: u32) -> bool {
        self.bytes(variants, splats, pairs).is_ok_and(|bytes| bytes <= self.room)
    }

    /// Capacity of pairs for `splats` splats.
    fn pairs_for(&self, variants: Variants, splats: u32) -> u32 {
        let side = variants.tile.size();
        let tiles = self.views.iter().map(|(c, _)| c.width.div_ceil(side) * c.height.div_ceil(side)).max().unwrap_or(1);
        let pairs = tiles.saturating_mul(PAIRS_PER_TILE).max(splats.saturating_mul(PAIRS_PER_SPLAT));
        pairs.min(most_pairs(&self.gpu, variants))
    }

    /// Most splats that fit with their pairs. Depends only on settings, photographs and the memory limit, so that a
    /// resumed run has the same number. `None` if memory does not limit the splats.
    pub(in crate::train) fn most_splats(&self, variants: Variants) -> Option<u32> {
        let most = most_splats(&self.gpu);
        let room = self.room.saturating_sub(self.of_photographs(self.counted).unwrap_or(u64::MAX));
        let fits = |splats| {
            let pairs = self.pairs_for(variants, splats);
            self.without_photographs(variants, splats, pairs).is_ok_and(|bytes| bytes <= room)
        };
        if fits(most) { None } else { Some(largest(0, most, fits).unwrap_or(0)) }
    }

    /// Capacities for splats and pairs at the start.
    pub(in crate::train) fn at_start(
        &self,
        variants: Variants,
        initial: u32,
        pacing: Pacing,
    ) -> Result<(u32, u32), Error> {
        let asked = self.settings.density.max_splats.unwrap_or(u32::MAX);
        let most = self.most_splats(variants).unwrap_or(u32::MAX).min(most_splats(&self.gpu)).min(asked).max(initial);
        let splats = match pacing.splat_capacity {
            0 => initial.saturating_add(initial / 2).max(1 << 14).min(most),
            given => given.max(initial),
        };
        let pairs = match pacing.pair_capacity {
            0 => self.pairs_for(variants, splats),
            given => given.min(most_pairs(&self.gpu, variants)),
        };
        // Computed once with `?`, so that errors other than a lack of memory are returned.
        let needed = self.bytes(variants, splats, pairs)?;
        if needed <= self.room {
            return Ok((splats, pairs));
        }
        let fewest = pairs.min(1 << 10);
        match largest(fewest, pairs, |pairs| self.fits(variants, initial, pairs)) {
            Some(pairs) => {
                let splats = largest(initial, splats, |splats| self.fits(variants, splats, pairs));
                Ok((splats.unwrap_or(initial), pairs))
            }
            None => Err(self.refusal("splats to begin with", initial, self.bytes(variants, initial, fewest)?)),
        }
    }

    /// A capacity of pairs between `wanted` and `planned` that fits beside `splats` splats.
    pub(in crate::train) fn pairs(
        &self,
        variants: Variants,
        splats: u32,
        wanted: u32,
        planned: u32,
    ) -> Result<u32, Error> {
        match largest(wanted, planned, |pairs| self.fits(variants, splats, pairs)) {
            Some(pairs) => Ok(pairs),
            None => Err(self.refusal("(splat, tile) pairs", wanted, self.bytes(variants, splats, wanted)?)),
        }
    }

    /// A capacity of splats between `wanted` and `planned` that fits beside `pairs` pairs, if any fits.
    pub(in crate::train) fn splats(&self, variants: Variants, pairs: u32, wanted: u32, planned: u32) -> Option<u32> {
        largest(wanted, planned.max(wanted), |splats| self.fits(variants, splats, pairs))
    }

    fn refusal(&self, what: &'static str, wanted: u32, needed: u64) -> Error {
        let tally = self.gpu.memory_use();
        Error::MemoryLimit {
            what,
            wanted: u64::from(wanted),
            needed,
            room: self.room,
            in_use: tally.current,
            limit: tally.limit,
            saved: None,
        }
    }
}

/// The largest number from `low` to `high` that fits, by bisection: all numbers below a fitting one must fit. `None` if
/// `low` does not fit.
fn largest(low: u32, high: u32, fits: impl Fn(u32) -> bool) -> Option<u32> {
    if !fits(low) {
        return None;
    }
    if high <= low || fits(high) {
        return Some(high.max(low));
    }
    let (mut fitting, mut failing) = (low, high);
    while failing - fitting > 1 {
        let middle = fitting + (failing - fitting) / 2;
        if fits(middle) { fitting = middle } else { failing = middle }
    }
    Some(fitting)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_that_fits_is_found() {
        for (low, high, most, want) in [
            (0, 100, 37, Some(37)),
            (0, 100, 100, Some(100)),
            (0, 100, 5000, Some(100)),
            (38, 100, 37, None),
            (37, 100, 37, Some(37)),
            (50, 20, 60, Some(50)),
            (0, u32::MAX, u32::MAX - 1, Some(u32::MAX - 1)),
        ] {
            assert_eq!(largest(low, high, |n| n <= most), want, "{low}..{high}, {most}");
        }
    }
}
