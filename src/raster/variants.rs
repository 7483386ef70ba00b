//! Variants of the passes: chosen when an engine is opened, printed, and written into settings and checkpoints.

use serde::{Deserialize, Serialize};

use super::pass_select;
use crate::vk::{DeviceKind, FloatAtomics, Gpu, Subgroup};

/// Subgroup width that column tiles are written for.
pub(super) const COLUMN_WIDTH: u32 = 8;

/// How the blending passes share a tile among threads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum TileShape {
    /// 8x8 tiles; a thread owns a column of 8 pixels. For devices that run a workgroup as one vector (CPU drivers).
    Column,
    /// 16x16 tiles; a thread owns a pixel, and splats are staged in shared memory. For GPUs.
    Pixel,
}

impl TileShape {
    /// Width and height of a tile in pixels.
    pub fn size(self) -> u32 {
        match self {
            Self::Column => 8,
            Self::Pixel => 16,
        }
    }
}

/// How the blend backward pass sums gradients.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum GradientSum {
    /// Native float atomics, in an order that the device chooses.
    Atomic,
    /// Compare-and-swap loops, for devices without float atomics.
    CompareAndSwap,
    /// One slot per (splat, tile) pair, summed afterwards in a fixed order: bit-reproducible.
    Slots,
}

/// The variant set of an engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Variants {
    /// Tile shape.
    pub tile: TileShape,
    /// Gradient summation.
    pub gradients: GradientSum,
}

impl std::fmt::Display for Variants {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let tile = match self.tile {
            TileShape::Column => "column",
            TileShape::Pixel => "pixel",
        };
        let gradients = match self.gradients {
            GradientSum::Atomic => "atomic",
            GradientSum::CompareAndSwap => "compare-and-swap",
            GradientSum::Slots => "slots",
        };
        write!(f, "{tile} tiles, gradients by {gradients}")
    }
}

impl Variants {
    /// Variants with this tile shape and gradient sum.
    pub const fn new(tile: TileShape, gradients: GradientSum) -> Self {
        Self { tile, gradients }
    }

    /// Every variant that the device can run.
    pub fn possible(gpu: &Gpu) -> Vec<Self> {
        let mut found = Vec::new();
        for tile in [TileShape::Column, TileShape::Pixel] {
            for gradients in [GradientSum::Slots, GradientSum::CompareAndSwap, GradientSum::Atomic] {
                found.push(Self::new(tile, gradients));
            }
        }
        found.retain(|variants| variants.runs_on(gpu));
        found
    }

    /// Whether the device can run this variant. Slots always run. Other sums of column tiles need subgroups of width 8.
    /// Float atomics need native support and hardware subgroups. Every variant needs enough shared memory.
    pub fn runs_on(self, gpu: &Gpu) -> bool {
        let caps = gpu.caps();
        let atomics = caps.buffer_floats == FloatAtomics::Native && matches!(caps.subgroup, Subgroup::Hardware(_));
        let columns_sum = caps.subgroup == Subgroup::Hardware(COLUMN_WIDTH);
        let there = match (self.tile, self.gradients) {
            (_, GradientSum::Slots) => true,
            (TileShape::Column, GradientSum::CompareAndSwap) => columns_sum,
            (TileShape::Column, GradientSum::Atomic) => columns_sum && atomics,
            (TileShape::Pixel, GradientSum::CompareAndSwap) => true,
            (TileShape::Pixel, GradientSum::Atomic) => atomics,
        };
        there && self.fits(gpu)
    }

    /// Whether the variant's shared memory fits into the device's limit. Also true when the device cannot run the
    /// variant for another reason.
    pub(crate) fn fits(self, gpu: &Gpu) -> bool {
        let limits = &gpu.caps().limits;
        pass_select::blend_backward(gpu, self).map_or(true, |chosen| chosen.pass.kernel.fits(limits, &[]))
            && pass_select::blend_forward(gpu, self).pass.kernel.fits(limits, &[])
    }

    /// The best variants for the device; `deterministic` allows only bit-reproducible variants.
    pub fn choose(gpu: &Gpu, deterministic: bool) -> Self {
        let caps = gpu.caps();
        let cpu = caps.kind == DeviceKind::Cpu;
        let tile = if cpu { TileShape::Column } else { TileShape::Pixel };
        // On CPU devices slots are also the faster variant: atomics there are compare-and-swap loops per lane.
        let slots = Self::new(tile, GradientSum::Slots);
        let best = if deterministic || cpu { slots } else { slots.without_slots(gpu) };
        // Column tiles need almost no shared memory.
        if best.runs_on(gpu) { best } else { Self::new(TileShape::Column, GradientSum::Slots) }
    }

    /// These variants with atomic sums instead of slots, which need no memory per pair. Changes the tile shape if the
    /// device requires.
    pub fn without_slots(self, gpu: &Gpu) -> Self {
        let caps = gpu.caps();
        let gradients = match (caps.buffer_floats, caps.subgroup) {
            (FloatAtomics::Native, Subgroup::Hardware(_)) => GradientSum::Atomic,
            _ => GradientSum::CompareAndSwap,
        };
        let tile = if caps.subgroup == Subgroup::Hardware(COLUMN_WIDTH) { self.tile } else { TileShape::Pixel };
        Self { tile, gradients }
    }

    /// These variants with a given tile shape or gradient sum.
    pub fn with(self, tile: Option<TileShape>, gradients: Option<GradientSum>) -> Self {
        Self { tile: tile.unwrap_or(self.tile), gradients: gradients.unwrap_or(self.gradients) }
    }
}
