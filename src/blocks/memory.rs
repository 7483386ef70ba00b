//! Device memory of the training of a block, as counted before any training.

use super::photographs::Chosen;
use crate::dataset::{Dataset, Depth, Role};
use crate::scene::{Camera, Frame};
use crate::train::{Error, MemoryPlan, Outline, Pacing, Residency, Settings, chosen_variants};
use crate::vk::Gpu;

/// (splat, tile) pairs of a splat, as a training sets them aside.
const PAIRS: f64 = 8.0;

/// What the memory of blocks depends on.
pub(super) struct Memory {
    /// Bytes that blocks have in common: what depends on the size of photographs alone.
    fixed: u64,
    per_splat: f64,
    per_pair: f64,
    /// Pairs among the bytes in common.
    pairs: f64,
    /// Bytes of each photograph on the device, and of the buffers that photographs are streamed through.
    photographs: Vec<u64>,
    streamed: u64,
    /// Most bytes of photographs that stay on the device.
    resident: u64,
    /// Splats of the coarse model of everything, which each block has as its background.
    background: f64,
}

impl Memory {
    /// Plans an engine for the largest photograph on `gpu`, where buffers are counted and not allocated.
    pub(super) fn new(gpu: &Gpu, dataset: &Dataset, settings: &Settings, background: u64) -> Result<Self, Error> {
        let view = |at: usize| Some((dataset.scene_camera(at)?, dataset.views.get(at)?.samples.depth()));
        let of_role = |role| dataset.views_of(role).filter_map(|(at, _)| view(at)).collect::<Vec<_>>();
        let pixels = |camera: &Camera| u64::from(camera.width) * u64::from(camera.height);
        let largest = of_role(Role::Train).into_iter().max_by_key(|(camera, _)| pixels(camera));
        let largest: Vec<(Camera, Depth)> = largest.into_iter().collect();
        let outline =
            Outline { train: largest.clone(), held_out: of_role(Role::HeldOut), extent: Frame::EXTENT as f32 };
        let variants = chosen_variants(gpu, settings)?;
        // With one splat, the pairs are those that the tiles of a photograph ask for.
        let planned = |photographs| {
            let pacing = Pacing { splat_capacity: 1, photographs, ..Pacing::default() };
            MemoryPlan::of(gpu, &outline, settings, variants, pacing, 1)
        };
        let (resident, streamed) = (planned(Residency::Resident)?, planned(Residency::Streamed)?);
        let of_largest = Outline::bytes(&largest).max(1) as f64;
        let bytes = |at: usize| {
            let own = view(at).map_or(0, |view| Outline::bytes(&[view])) as f64;
            (own / of_largest * resident.photographs.1 as f64).ceil() as u64
        };
        Ok(Self {
            fixed: resident.at_start.saturating_sub(resident.photographs.1),
            per_splat: resident.per_splat,
            per_pair: resident.per_pair,
            pairs: f64::from(resident.capacities.1),
            photographs: (0..dataset.views.len()).map(bytes).collect(),
            streamed: streamed.photographs.1,
            resident: resident.limit / 2,
            background: background as f64,
        })
    }

    /// Bytes of a block with these photographs and so many splats, beside the background.
    pub(super) fn of(&self, photographs: &[Chosen], splats: f64) -> u64 {
        let all: u64 = photographs.iter().filter_map(|(view, _)| self.photographs.get(*view as usize)).sum();
        let pictures = if all <= self.resident { all } else { all.min(self.streamed) };
        let splats = splats + self.background;
        let pairs = (PAIRS * splats - self.pairs).max(0.0);
        let more = self.per_splat * splats + self.per_pair * pairs;
        self.fixed.saturating_add(pictures).saturating_add(more as u64)
    }

    /// Bytes that no number of blocks makes less.
    pub(super) fn least(&self) -> u64 {
        self.of(&[], 0.0)
    }
}
