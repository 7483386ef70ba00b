//! What the forward pass keeps for the backward pass in the PIXEL shape: which splats show in which blocks of pixels, and
//! states at the ends of chunks of long lists.

use crate::pass::blend_forward::{mask_words, state_floats};
use crate::raster::memory_footprint::MemoryFootprint;
use crate::raster::pass_select;
use crate::raster::size::Size;
use crate::raster::variants::{Chunks, TileShape, Variants};
use crate::vk::{Buffer, BufferSlice, Error, Gpu, Memory, Subgroup};

/// Workgroups of a backward pass that fill a large device. Fewer tiles are cut into chunks.
const ENOUGH: u32 = 8192;
/// Most chunks of a list.
const MOST_CHUNKS: u32 = 8;

/// Buffers between forward and backward pass.
pub(super) struct Kept {
    pub(super) masks: Buffer,
    pub(super) states: Buffer,
    /// Bytes of `masks` that grow with pairs.
    of_pairs: u64,
    form: KeptForm,
}

/// What is kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct KeptForm {
    /// Whether the shape has blocks and chunks.
    pub(super) pixel: bool,
    /// Whether the backward pass reads the masks: not where subgroups are emulated.
    pub(super) read: bool,
    chunks: u32,
}

impl KeptForm {
    /// For images of up to so many tiles.
    fn new(gpu: &Gpu, variants: Variants, size: &Size) -> Self {
        let pixel = variants.tile == TileShape::Pixel;
        let by_need = size.train && variants.chunks == Chunks::ByNeed;
        let chunks = if pixel && by_need { (ENOUGH / size.tiles.max(1)).clamp(1, MOST_CHUNKS) } else { 1 };
        let read = pixel && size.train && matches!(gpu.caps().subgroup, Subgroup::Hardware(_));
        Self { pixel, read, chunks }
    }

    /// Constants of the forward pass.
    pub(super) fn of_forward(self) -> Vec<(&'static str, u32)> {
        if self.pixel { vec![("MASKS", u32::from(self.read)), self.chunks()] } else { Vec::new() }
    }

    /// Constants of the backward pass.
    pub(super) fn of_backward(self) -> Option<(&'static str, u32)> {
        self.pixel.then(|| self.chunks())
    }

    fn chunks(self) -> (&'static str, u32) {
        ("CHUNKS", self.chunks.max(1))
    }

    /// Workgroups of the backward pass for each tile.
    pub(super) fn groups_per_tile(self) -> u64 {
        u64::from(self.chunks.max(1))
    }
}

impl Kept {
    pub(super) fn new(gpu: &Gpu, variants: Variants, size: &Size) -> Result<Self, Error> {
        let form = KeptForm::new(gpu, variants, size);
        let (pairs, tiles) = (u64::from(size.pairs), u64::from(size.tiles));
        let (_, block) = pass_select::block(gpu);
        let words = |pairs| if form.read { 4 * mask_words(pairs, tiles, block) } else { 0 };
        let states = 4 * state_floats(tiles, form.chunks, size.aux);
        Ok(Self {
            masks: gpu.buffer("masks", words(pairs), Memory::Device)?,
            states: gpu.buffer("states", states, Memory::Device)?,
            of_pairs: words(pairs) - words(0),
            form,
        })
    }

    /// The buffers that the backward pass reads, in the order of its bindings.
    pub(super) fn for_backward(&self) -> Vec<BufferSlice<'_>> {
        match self.form {
            KeptForm { pixel: false, .. } => Vec::new(),
            KeptForm { read: false, .. } => vec![(&self.states).into()],
            KeptForm { .. } => vec![(&self.masks).into(), (&self.states).into()],
        }
    }

    pub(super) fn form(&self) -> KeptForm {
        self.form
    }

    pub(super) fn held(&self) -> MemoryFootprint {
        MemoryFootprint {
            pairs: self.of_pairs,
            pixels: self.masks.size() - self.of_pairs + self.states.size(),
            ..MemoryFootprint::default()
        }
    }
}
