//! Which form of each pass runs: fixed when an engine is opened, printed, and written into settings and checkpoints.

use serde::{Deserialize, Serialize};

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

impl Variants {
    /// What suits the device; `deterministic` allows only bit-reproducible forms.
    pub fn choose(gpu: &Gpu, deterministic: bool) -> Self {
        let caps = gpu.caps();
        let cpu = caps.kind == DeviceKind::Cpu;
        let tile = if cpu { TileShape::Column } else { TileShape::Pixel };
        // On CPU devices slots are also the faster form: atomics there are compare-and-swap loops per lane.
        let slots = Self { tile, gradients: GradientSum::Slots };
        if deterministic || cpu { slots } else { slots.without_slots(gpu) }
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
