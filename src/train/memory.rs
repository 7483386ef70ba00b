//! Memory of a training, on the device and of the host. On the device: what splats, pairs and pixels cost, and how much of each fits.
//! Nothing here knows the buffers: the engine is built on a handle that only counts.

mod cost;
mod host;

pub use cost::MemoryCost;
pub use host::{HostMemory, HostPlan, shares_memory};

use std::fmt;

use super::Error;
use super::engine::Engine;
use super::input::{Input, Outline};
use super::pacing::Pacing;
use super::photographs::{Photographs, Residency};
use super::settings::Settings;
use crate::byte_size::readable;
use crate::dataset::Depth;
use crate::numbers::counted;
use crate::raster::{Variants, Viewer, most_pairs, most_splats};
use crate::scene::Camera;
use crate::vk::{self, Gpu, Memory};

/// Pairs that are reserved for a splat, and for a tile.
const PAIRS_PER_SPLAT: u32 = 8;
const PAIRS_PER_TILE: u32 = 24;
/// Other users of the device's memory (staging, the host's own) are rounded up to this, so that they do not decide how many
/// splats fit.
const GRAIN: u64 = 16 << 20;
/// Set aside for what is on its way to the device.
const STAGING: u64 = 4 << 20;

/// What the memory of a training depends on, apart from the numbers of splats and pairs.
#[derive(Clone)]
pub(super) struct Needs {
    pub(super) gpu: Gpu,
    pub(super) views: Vec<(Camera, Depth)>,
    pub(super) settings: Settings,
    pub(super) extent: f64,
    /// Whether pictures are rendered on the way: of held-out photographs, or to weigh splats.
    pub(super) pictures: bool,
    /// Bytes that the training may use.
    pub(super) room: u64,
    /// Where the photographs are.
    pub(super) residency: Residency,
    /// Where they are taken to be when the most splats are counted, which must not depend on how much memory the host has to
    /// spare today.
    counted: Residency,
    in_flight: usize,
}

impl Needs {
    pub(super) fn new(gpu: &Gpu, outline: &Outline, settings: &Settings, pacing: Pacing) -> Result<Self, Error> {
        let tally = gpu.memory_use();
        let mut needs = Self {
            gpu: gpu.clone(),
            views: outline.train.clone(),
            settings: settings.clone(),
            extent: f64::from(outline.extent),
            pictures: !outline.held_out.is_empty() || settings.density.prune_weight > 0.0,
            room: tally.limit.saturating_sub(tally.current.next_multiple_of(GRAIN)),
            residency: pacing.photographs,
            counted: pacing.photographs,
            in_flight: pacing.events_in_flight(),
        };
        let usual = needs.usual_residency()?;
        if needs.residency == Residency::Auto {
            needs.residency = usual;
        }
        // Streaming takes less than what is set aside so.
        needs.counted = if usual == Residency::Resident { usual } else { needs.residency };
        Ok(needs)
    }

    /// On the device where that takes little of it, or less than streaming.
    fn usual_residency(&self) -> Result<Residency, Error> {
        let resident = self.of_photographs(Residency::Resident)?;
        let little = resident <= self.room / 2 || resident <= self.of_photographs(Residency::Streamed)?;
        Ok(if little { Residency::Resident } else { Residency::Streamed })
    }

    /// Bytes of the buffers of the photographs.
    pub(super) fn of_photographs(&self, residency: Residency) -> Result<u64, Error> {
        let counting = self.gpu.planning();
        self.photographs(&counting, residency)?;
        Ok(counting.planned_bytes())
    }

    /// Bytes of the buffers of a training with room for so many splats and pairs, photographs apart.
    pub(super) fn training(&self, variants: Variants, splats: u32, pairs: u32) -> Result<u64, Error> {
        let counting = self.gpu.planning();
        let photographs = Photographs::allocate(&self.gpu.planning(), &[], Residency::Resident, (1, 1), 1)?;
        Engine::allocate(&counting, photographs, self, variants, splats, pairs)?;
        Ok(counting.planned_bytes())
    }

    /// The same with the photographs and with what comes and goes on the way: pictures of held-out views, what is read back for a
    /// checkpoint, staging.
    pub(super) fn bytes(&self, variants: Variants, splats: u32, pairs: u32) -> Result<u64, Error> {
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
    pub(super) fn photographs(&self, gpu: &Gpu, residency: Residency) -> Result<Photographs, Error> {
        let at_once = self.settings.texture.views_at_once() as usize;
        Photographs::allocate(gpu, &self.views, residency, (self.in_flight, at_once), self.settings.run.bands)
    }

    fn fits(&self, variants: Variants, splats: u32, pairs: u32) -> bool {
        self.bytes(variants, splats, pairs).is_ok_and(|bytes| bytes <= self.room)
    }

    /// Pairs to have room for with so many splats.
    fn pairs_for(&self, variants: Variants, splats: u32) -> u32 {
        let side = variants.tile.size();
        let tiles = self.views.iter().map(|(c, _)| c.width.div_ceil(side) * c.height.div_ceil(side)).max().unwrap_or(1);
        let pairs = tiles.saturating_mul(PAIRS_PER_TILE).max(splats.saturating_mul(PAIRS_PER_SPLAT));
        pairs.min(most_pairs(&self.gpu, variants))
    }

    /// Most splats that fit with the pairs that belong to them: a function of settings, photographs and limit alone, so that a
    /// resumed run has the same. `None` when memory is not what limits them.
    pub(super) fn most_splats(&self, variants: Variants) -> Option<u32> {
        let most = most_splats(&self.gpu);
        let room = self.room.saturating_sub(self.of_photographs(self.counted).unwrap_or(u64::MAX));
        let fits = |splats| {
            let pairs = self.pairs_for(variants, splats);
            self.without_photographs(variants, splats, pairs).is_ok_and(|bytes| bytes <= room)
        };
        if fits(most) { None } else { Some(largest(0, most, fits).unwrap_or(0)) }
    }

    /// Capacities for splats and pairs at the start.
    pub(super) fn at_start(&self, variants: Variants, initial: u32, pacing: Pacing) -> Result<(u32, u32), Error> {
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
        // Asked for once as it is, so that other errors than a lack of memory are told.
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
    pub(super) fn pairs(&self, variants: Variants, splats: u32, wanted: u32, planned: u32) -> Result<u32, Error> {
        match largest(wanted, planned, |pairs| self.fits(variants, splats, pairs)) {
            Some(pairs) => Ok(pairs),
            None => Err(self.refusal("(splat, tile) pairs", wanted, self.bytes(variants, splats, wanted)?)),
        }
    }

    /// A capacity of splats between `wanted` and `planned` that fits beside `pairs` pairs, if there is one.
    pub(super) fn splats(&self, variants: Variants, pairs: u32, wanted: u32, planned: u32) -> Option<u32> {
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

/// The largest number from `low` to `high` that fits, where all below one that fits do too. `None` when `low` does not.
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

/// The memory of a training before it starts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MemoryPlan {
    /// Bytes that may be used, by this training and what else is on the device.
    pub limit: u64,
    /// Photographs to train on, and their bytes.
    pub photographs: (usize, u64),
    /// Whether these are all on the device, or those of the next steps.
    pub residency: Residency,
    /// Bytes per splat of the capacity.
    pub per_splat: f64,
    /// Bytes per (splat, tile) pair of the capacity.
    pub per_pair: f64,
    /// Bytes per pixel of the largest photograph, photographs apart.
    pub per_pixel: f64,
    /// Splats and pairs that there is room for at the start.
    pub capacities: (u32, u32),
    /// Bytes with that room, pictures and checkpoints on the way included.
    pub at_start: u64,
    /// Most splats, with 8 pairs each, and whether memory (rather than the size of a buffer) is what limits them.
    pub most_splats: (u32, bool),
}

impl MemoryPlan {
    /// Of a training that begins with `splats` splats.
    pub fn new(
        gpu: &Gpu,
        input: &Input,
        settings: &Settings,
        variants: Variants,
        pacing: Pacing,
        splats: u32,
    ) -> Result<Self, Error> {
        Self::of(gpu, &input.outline(), settings, variants, pacing, splats)
    }

    /// The same, before any photograph is decoded.
    pub fn of(
        gpu: &Gpu,
        outline: &Outline,
        settings: &Settings,
        variants: Variants,
        pacing: Pacing,
        splats: u32,
    ) -> Result<Self, Error> {
        let needs = Needs::new(gpu, outline, settings, pacing)?;
        let capacities = needs.at_start(variants, splats, pacing)?;
        let photographs = (needs.views.len(), needs.of_photographs(needs.residency)?);
        // Differences of large numbers: tables of the sorts grow in steps.
        let (n, more) = (1 << 19, 1 << 20);
        let bytes = |splats, pairs| needs.training(variants, splats, pairs).map(|b| b as f64);
        let base = bytes(n, n)?;
        let per = |with: f64| (with - base) / f64::from(more - n);
        let fewest = Needs { views: needs.views.iter().map(|(c, d)| (c.resized(8, 8), *d)).collect(), ..needs.clone() };
        let pixels = needs.views.iter().map(|(c, _)| f64::from(c.width) * f64::from(c.height)).fold(1.0, f64::max);
        let of_pixels = base - fewest.training(variants, n, n)? as f64;
        let most = needs.most_splats(variants);
        Ok(Self {
            limit: gpu.memory_use().limit,
            photographs,
            residency: needs.residency,
            per_splat: per(bytes(more, n)?),
            per_pair: per(bytes(n, more)?),
            per_pixel: of_pixels / pixels,
            capacities,
            at_start: needs.bytes(variants, capacities.0, capacities.1)?,
            most_splats: (most.unwrap_or(most_splats(gpu)), most.is_some()),
        })
    }
}

/// Whether an error says that there is not enough memory.
pub(super) fn is_lack_of_memory(error: &Error) -> bool {
    matches!(
        error,
        Error::MemoryLimit { .. }
            | Error::TooMany { .. }
            | Error::Device(vk::Error::OutOfDeviceMemory { .. } | vk::Error::BufferTooLarge { .. })
    )
}

impl fmt::Display for MemoryPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (splats, pairs) = self.capacities;
        let (most, by_memory) = self.most_splats;
        let most = counted(most, "splat");
        write!(
            f,
            "device memory: {} for {}{}, {:.0} B per splat, {:.0} B per (splat, tile) pair, {:.0} B per pixel; {} at the \
             start, with room for {} and {}; of the {} that may be used, {}",
            readable(self.photographs.1),
            counted(self.photographs.0, "photograph"),
            if self.residency == Residency::Streamed { ", uploaded in their steps" } else { "" },
            self.per_splat,
            self.per_pair,
            self.per_pixel,
            readable(self.at_start),
            counted(splats, "splat"),
            counted(pairs, "pair"),
            readable(self.limit),
            if by_memory {
                format!("{most} fit with {PAIRS_PER_SPLAT} pairs each: growth stops there")
            } else {
                format!("more than {most} would fit, which is the most that a buffer holds")
            }
        )
    }
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
