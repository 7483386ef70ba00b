//! Device memory of the training of a block, as counted before any training.

use super::photographs::Chosen;
use crate::dataset::{Dataset, Depth, Role};
use crate::scene::{Camera, Frame};
use crate::train::{Error, MemoryPlan, Outline, Pacing, Settings, chosen_variants};
use crate::vk::Gpu;

/// (splat, tile) pairs of a splat, as a training sets them aside.
const PAIRS: f64 = 8.0;

/// What the memory of blocks depends on.
pub(super) struct Memory<'a> {
    gpu: &'a Gpu,
    settings: &'a Settings,
    views: Vec<Option<(Camera, Depth)>>,
    held_out: Vec<(Camera, Depth)>,
    /// Splats of the coarse model of everything, which each block has as its background.
    background: u64,
}

impl<'a> Memory<'a> {
    pub(super) fn new(gpu: &'a Gpu, dataset: &Dataset, settings: &'a Settings, background: u64) -> Self {
        let view = |at: usize| Some((dataset.scene_camera(at)?, dataset.views.get(at)?.samples.depth()));
        let views = (0..dataset.views.len()).map(view).collect();
        let held_out = dataset.views_of(Role::HeldOut).filter_map(|(at, _)| view(at)).collect();
        Self { gpu, settings, views, held_out, background }
    }

    /// Bytes with so many splats and the background: those of the photographs, of each splat with its pairs, and of
    /// what depends on neither.
    pub(super) fn of(&self, photographs: &[Chosen], splats: f64) -> Result<u64, Error> {
        let train = photographs.iter().filter_map(|(view, _)| self.views.get(*view as usize).copied().flatten());
        let outline = Outline { train: train.collect(), held_out: self.held_out.clone(), extent: Frame::EXTENT as f32 };
        let variants = chosen_variants(self.gpu, self.settings)?;
        // With one splat, the pairs are those that the tiles of a photograph ask for.
        let pacing = Pacing { splat_capacity: 1, ..Pacing::default() };
        let plan = MemoryPlan::of(self.gpu, &outline, self.settings, variants, pacing, 1)?;
        let (capacity, pairs) = plan.capacities;
        let splats = splats + self.background as f64;
        let more_pairs = (PAIRS * splats - f64::from(pairs)).max(0.0);
        let more = plan.per_splat * (splats - f64::from(capacity)).max(0.0) + plan.per_pair * more_pairs;
        Ok(plan.at_start.saturating_add(more as u64))
    }
}
