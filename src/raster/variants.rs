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

/// How the splats of a tile come into depth order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum ListSort {
    /// All splats are sorted by depth, then all (splat, tile) pairs by tile. For CPU devices.
    #[default]
    Global,
    /// Pairs are put into the lists of their tiles, and each list is sorted in shared memory: a quarter of the dispatches.
    /// For GPUs.
    Tiles,
}

/// How the blend backward pass walks along a list.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Chunks {
    /// From its end to its beginning.
    #[default]
    Whole,
    /// In up to eight chunks at a time, where the tiles of an image are too few for a large device. Only pixel tiles.
    ByNeed,
}

/// The variant set of an engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Variants {
    /// Tile shape.
    pub tile: TileShape,
    /// Gradient summation.
    pub gradients: GradientSum,
    /// Order of tile lists.
    #[serde(default)]
    pub lists: ListSort,
    /// Walk of the blend backward pass.
    #[serde(default)]
    pub chunks: Chunks,
}

/// Parts of a variant set that a user names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NamedVariants {
    /// See [`Variants::tile`].
    pub tile: Option<TileShape>,
    /// See [`Variants::gradients`].
    pub gradients: Option<GradientSum>,
    /// See [`Variants::lists`].
    pub lists: Option<ListSort>,
    /// See [`Variants::chunks`].
    pub chunks: Option<Chunks>,
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
        write!(f, "{tile} tiles, gradients by {gradients}")?;
        // What goes without saying is not said.
        let usual = Self::new(self.tile, self.gradients);
        if self.lists != usual.lists {
            f.write_str(match self.lists {
                ListSort::Global => ", lists sorted as one",
                ListSort::Tiles => ", lists sorted in tiles",
            })?;
        }
        if self.chunks != usual.chunks {
            f.write_str(match self.chunks {
                Chunks::Whole => ", lists whole",
                Chunks::ByNeed => ", lists in chunks",
            })?;
        }
        Ok(())
    }
}

impl Variants {
    /// Variants with this tile shape and gradient sum, and the usual lists of the tile shape.
    pub const fn new(tile: TileShape, gradients: GradientSum) -> Self {
        match tile {
            TileShape::Column => Self { tile, gradients, lists: ListSort::Global, chunks: Chunks::Whole },
            TileShape::Pixel => Self { tile, gradients, lists: ListSort::Tiles, chunks: Chunks::ByNeed },
        }
    }

    /// Every tile shape and gradient sum that the device can run with the usual lists, and the other lists of pixel tiles
    /// with slots.
    pub fn possible(gpu: &Gpu) -> Vec<Self> {
        let mut found = Vec::new();
        for tile in [TileShape::Column, TileShape::Pixel] {
            for gradients in [GradientSum::Slots, GradientSum::CompareAndSwap, GradientSum::Atomic] {
                found.push(Self::new(tile, gradients));
            }
        }
        found.extend(Self::new(TileShape::Pixel, GradientSum::Slots).with_other_lists());
        found.retain(|variants| variants.runs_on(gpu));
        found
    }

    /// The variants that differ from these only in the lists; none for column tiles.
    pub fn with_other_lists(self) -> Vec<Self> {
        let lists = if self.lists == ListSort::Global { ListSort::Tiles } else { ListSort::Global };
        let chunks = if self.chunks == Chunks::Whole { Chunks::ByNeed } else { Chunks::Whole };
        match self.tile {
            TileShape::Column => Vec::new(),
            TileShape::Pixel => vec![Self { lists, ..self }, Self { chunks, ..self }],
        }
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
        let there = there && (self.chunks == Chunks::Whole || self.tile == TileShape::Pixel);
        there && self.fits(gpu)
    }

    /// Whether the variant's shared memory fits into the device's limit. Also true when the device cannot run the
    /// variant for another reason.
    pub(crate) fn fits(self, gpu: &Gpu) -> bool {
        let limits = &gpu.caps().limits;
        pass_select::blend_backward(gpu, self).map_or(true, |chosen| chosen.pass.kernel.fits(limits, &[]))
            && pass_select::blend_forward(gpu, self).pass.kernel.fits(limits, &[])
            && (self.lists == ListSort::Global || pass_select::list_passes(gpu).sort.pass.kernel.fits(limits, &[]))
    }

    /// The best variants for the device; `deterministic` allows only bit-reproducible variants.
    pub fn choose(gpu: &Gpu, deterministic: bool) -> Self {
        let caps = gpu.caps();
        let cpu = caps.kind == DeviceKind::Cpu;
        let tile = if cpu { TileShape::Column } else { TileShape::Pixel };
        // On CPU devices slots are also the faster variant: atomics there are compare-and-swap loops per lane.
        let slots = Self::new(tile, GradientSum::Slots).with(gpu, NamedVariants::default());
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
        let same = caps.subgroup == Subgroup::Hardware(COLUMN_WIDTH) || self.tile == TileShape::Pixel;
        let usual = Self::new(TileShape::Pixel, gradients);
        if same { Self { gradients, ..self } } else { usual.with(gpu, NamedVariants::default()) }
    }

    /// These variants with the named parts, and with lists that suit the tile shape and the device unless named.
    pub fn with(self, gpu: &Gpu, named: NamedVariants) -> Self {
        let tile = named.tile.unwrap_or(self.tile);
        let usual = Self::new(tile, named.gradients.unwrap_or(self.gradients));
        // CPU devices end the loops of a thread after 65,535 turns, which the sort of a very long list may pass.
        let suits = gpu.caps().kind != DeviceKind::Cpu && usual.fits(gpu);
        let lists = named.lists.unwrap_or(if suits { usual.lists } else { ListSort::Global });
        Self { lists, chunks: named.chunks.unwrap_or(usual.chunks), ..usual }
    }
}
