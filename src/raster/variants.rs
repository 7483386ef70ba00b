//! Which variant of each pass runs: fixed when an engine is opened, printed, and written into settings and checkpoints.

use serde::{Deserialize, Serialize};

use super::pass_select;
use crate::vk::{DeviceKind, FloatAtomics, Gpu, Subgroup};

/// The column shape is written for subgroups of this width.
pub(super) const COLUMN_WIDTH: u32 = 8;

/// How the blending passes share a tile among threads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum TileShape {
    /// 8x8 tiles, a thread owns a column of 8 pixels: for devices that run a workgroup as one vector (CPU drivers).
    Column,
    /// 16x16 tiles, a thread owns a pixel, splats staged in shared memory: for GPUs.
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

/// Where the blend backward leaves its gradients.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum GradientSum {
    /// Native float atomics; the order of additions is the device's.
    Atomic,
    /// Compare-and-swap loops, where the device has no float atomics.
    CompareAndSwap,
    /// One slot per (splat, tile), summed in order afterwards: bit-reproducible.
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
    /// Of tiles and sums.
    pub const fn new(tile: TileShape, gradients: GradientSum) -> Self {
        Self { tile, gradients }
    }

    /// Every variant that the device can run, whichever is best.
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

    /// Whether the device can run this variant: slots always, other sums of column tiles with subgroups of 8 only,
    /// float atomics where there are some and subgroup operations too;
    /// and what takes no more shared memory than there is.
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

    /// Whether a workgroup has as much shared memory as this form takes;
    /// also where the form is not there for other reasons.
    pub(crate) fn fits(self, gpu: &Gpu) -> bool {
        let limits = &gpu.caps().limits;
        pass_select::blend_backward(gpu, self).map_or(true, |chosen| chosen.pass.kernel.fits(limits, &[]))
            && pass_select::blend_forward(gpu, self).pass.kernel.fits(limits, &[])
    }

    /// What suits the device; `deterministic` allows only bit-reproducible variants.
    pub fn choose(gpu: &Gpu, deterministic: bool) -> Self {
        let caps = gpu.caps();
        let cpu = caps.kind == DeviceKind::Cpu;
        let tile = if cpu { TileShape::Column } else { TileShape::Pixel };
        // On CPU devices slots are also the faster variant: atomics there are compare-and-swap loops per lane.
        let slots = Self::new(tile, GradientSum::Slots);
        let best = if deterministic || cpu { slots } else { slots.without_slots(gpu) };
        // Column tiles need next to no shared memory.
        if best.runs_on(gpu) { best } else { Self::new(TileShape::Column, GradientSum::Slots) }
    }

    /// The same with sums by atomics, which need no memory per pair; in the tiles for which the device can do them.
    pub fn without_slots(self, gpu: &Gpu) -> Self {
        let caps = gpu.caps();
        let gradients = match (caps.buffer_floats, caps.subgroup) {
            (FloatAtomics::Native, Subgroup::Hardware(_)) => GradientSum::Atomic,
            _ => GradientSum::CompareAndSwap,
        };
        let tile = if caps.subgroup == Subgroup::Hardware(COLUMN_WIDTH) { self.tile } else { TileShape::Pixel };
        Self { tile, gradients }
    }

    /// The same with some forms given.
    pub fn with(self, tile: Option<TileShape>, gradients: Option<GradientSum>) -> Self {
        Self { tile: tile.unwrap_or(self.tile), gradients: gradients.unwrap_or(self.gradients) }
    }
}
