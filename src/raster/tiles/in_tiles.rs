//! Lists by a histogram of tiles: pairs go into the lists of their tiles in no order, and each list is sorted by itself.

use super::{
    Capacities, DEPTH_BITS, LOCAL_SIZE, SPLAT_ITEMS, SortedPairs, TileListInputs, TileLists, VISIBLE_ITEMS,
    VisibleScratch,
};
use crate::pass::{alpha_min, emit_tiles, slot_sum, tile_edges, tile_offsets, tile_sort};
use crate::raster::memory_footprint::MemoryFootprint;
use crate::raster::pass_select::{self, ListPasses};
use crate::raster::scratch_buffers::{ScratchLayout, parts};
use crate::scene::tile::TileGrid;
use crate::vk::{Buffer, BufferRange, Gpu, Groups, Memory, Pipeline, Recorder, Result};

/// Passes and buffers of the lists.
pub(super) struct ListsInTiles {
    gpu: Gpu,
    edge: Pipeline,
    offsets: Pipeline,
    emit: Pipeline,
    /// Constants of the emission pass but the alpha cutoff.
    emission: Vec<(&'static str, u32)>,
    sort: Pipeline,
    /// Ranges and edges of tiles, cleared together.
    cleared: Buffer,
    edges: BufferRange,
    /// Depth, and splat or slot.
    pairs: BufferRange,
    sorted_splats: BufferRange,
    /// Only with slots.
    sorted_slots: Option<BufferRange>,
    /// Scratch for the list of the visible splats.
    keys: [BufferRange; 2],
    vals: [BufferRange; 2],
}

impl ListsInTiles {
    /// Also returns the memory of the tiles' ranges.
    pub(super) fn new(
        gpu: &Gpu,
        capacities: &Capacities,
        layout: &ScratchLayout,
        early: &Buffer,
        with_slots: bool,
    ) -> Result<(Self, BufferRange)> {
        let &Capacities { pairs, tiles, .. } = capacities;
        let buffer = |name, bytes: u64| gpu.buffer(name, bytes.max(8), Memory::Device).map(BufferRange::whole);
        let ranges = 8 * tiles.max(1);
        let edges = ranges.next_multiple_of(gpu.caps().limits.storage_alignment);
        let end = edges + 4 * tile_edges::words(tiles);
        let cleared = gpu.buffer("tile_ranges", end, Memory::Device)?;
        let ListPasses { offsets, emit, sort } = pass_select::list_passes(gpu);
        let carried = ("CARRIED", u32::from(!with_slots));
        let cutoff = alpha_min::constant(None);
        let emission = [emit.constants, vec![carried]].concat();
        let lists = Self {
            gpu: gpu.clone(),
            edge: gpu.pipeline(&tile_edges::PASS.kernel, &[cutoff])?,
            offsets: gpu
                .pipeline(&offsets.pass.kernel, &[offsets.constants, vec![tile_offsets::items(tiles)]].concat())?,
            emit: gpu.pipeline(&emit.pass.kernel, &[emission.clone(), vec![cutoff]].concat())?,
            emission,
            sort: gpu.pipeline(&sort.pass.kernel, &[sort.constants, vec![carried]].concat())?,
            edges: BufferRange::of(&cleared, edges..end),
            pairs: buffer("pairs", 8 * pairs)?,
            sorted_splats: buffer("sorted_splats", 4 * pairs)?,
            sorted_slots: with_slots.then(|| buffer("sorted_slots", 4 * pairs)).transpose()?,
            keys: parts(early, &layout.keys),
            vals: parts(early, &layout.vals),
            cleared,
        };
        let ranges = BufferRange::of(&lists.cleared, 0..ranges);
        Ok((lists, ranges))
    }

    /// Without the ranges of the tiles.
    pub(super) fn held(&self) -> MemoryFootprint {
        let bytes = |part: &BufferRange| part.slice().bytes();
        MemoryFootprint {
            pairs: bytes(&self.pairs) + bytes(&self.sorted_splats) + self.sorted_slots.as_ref().map_or(0, bytes),
            pixels: bytes(&self.edges),
            ..MemoryFootprint::default()
        }
    }

    pub(super) fn record<'a>(
        &'a self,
        rec: &mut Recorder,
        lists: &'a TileLists,
        inputs: &TileListInputs<'a>,
        grid: &TileGrid,
    ) -> Result<SortedPairs<'a>> {
        let [splat2d, tile_counts, count_words] = inputs.slices();
        let [columns, rows] = grid.counts();
        let ([width, height], [tile_width, tile_height]) = (grid.image, grid.tile);
        let (edges, ranges, pairs) = (self.edges.slice(), lists.tile_ranges.slice(), self.pairs.slice());
        rec.fill(&self.cleared, 0)?;
        let visible = &lists.visible;
        if let Some(listed) = &visible.listed {
            let [keys, places] = [self.keys[0].slice(), self.vals[1].slice()];
            let scratch = VisibleScratch { keys, splats: listed.slice(), places };
            visible.record(rec, inputs, scratch, lists.depth_bits)?;
        }
        let (edge, emit) = self.pipelines(inputs.alpha_cutoff)?;
        let push = tile_edges::Push { width, height, tile_width, tile_height };
        rec.dispatch(&edge, &[splat2d, tile_counts, count_words, edges], &push, inputs.groups(SPLAT_ITEMS))?;
        let push = tile_offsets::Push {
            columns,
            rows,
            capacity: lists.pairs_that_fit,
            void_entries: inputs.entries,
            first: inputs.at(VISIBLE_ITEMS),
            per_group: LOCAL_SIZE,
            per_sum: slot_sum::SPLATS_PER_WORKGROUP,
        };
        rec.dispatch(&self.offsets, &[count_words, edges, ranges, inputs.args.into()], &push, Groups::Workgroups(1))?;

        // Without slots, placeholders are bound, which the passes neither read nor write.
        let slots = visible.slots.as_ref().map(|slots| (slots.splat.slice(), slots.offsets.slice()));
        let (slot_splat, slot_offsets) = slots.unwrap_or((self.sorted_splats.slice(), edges));
        let shift = DEPTH_BITS - lists.depth_bits;
        let capacity = lists.pairs_that_fit;
        let push = emit_tiles::Push { width, height, tile_width, tile_height, shift, capacity };
        let bound = [splat2d, tile_counts, count_words, edges, ranges, pairs, slot_splat, slot_offsets];
        rec.dispatch(&emit, &bound, &push, inputs.groups(SPLAT_ITEMS))?;

        let splats = self.sorted_splats.slice();
        let sorted_slots = self.sorted_slots.as_ref().map_or(splats, BufferRange::slice);
        // The sort of lists with slots reads `slot_splat`; without slots, the placeholder must not be an output.
        let slot_splat = slots.map_or(edges, |of| of.0);
        let push = tile_sort::Push { columns, rows };
        let bound = [pairs, edges, slot_splat, splats, sorted_slots, ranges];
        rec.dispatch(&self.sort, &bound, &push, Groups::Workgroups(u64::from(columns * rows)))?;
        Ok(SortedPairs { splats, slots: sorted_slots })
    }

    /// The passes that test tiles, for an alpha cutoff.
    fn pipelines(&self, cutoff: Option<u32>) -> Result<(Pipeline, Pipeline)> {
        if cutoff.is_none() {
            return Ok((self.edge.clone(), self.emit.clone()));
        }
        let constant = alpha_min::constant(cutoff);
        let emit = pass_select::list_passes(&self.gpu).emit;
        let given = [self.emission.clone(), vec![constant]].concat();
        Ok((self.gpu.pipeline(&tile_edges::PASS.kernel, &[constant])?, self.gpu.pipeline(&emit.pass.kernel, &given)?))
    }
}
