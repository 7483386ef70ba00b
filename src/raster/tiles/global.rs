//! Lists by sorts of all splats by depth and of all pairs by tile.

use super::{
    Capacities, DEPTH_BITS, LOCAL_SIZE, PAIR_ITEMS, PAIR_ONCE, PAIR_SORT, PAIRS, SortedPairs, TileListInputs,
    TileLists, VISIBLE, VISIBLE_ITEMS, VISIBLE_ONCE, VISIBLE_SCAN, VISIBLE_SORT, VisibleScratch, tile_bits,
};
use crate::pass::plan::{self, Entry};
use crate::pass::turns::per_turn;
use crate::pass::{alpha_min, compact, emit, slot_sum, tile_ranges};
use crate::raster::memory_footprint::MemoryFootprint;
use crate::raster::scan::{self, ScanExtent, Summand};
use crate::raster::scratch_buffers::{ScratchLayout, parts, words};
use crate::raster::sort::{KeyCount, RadixSort, SortShape, Unsorted};
use crate::scene::tile::TileGrid;
use crate::vk::{Buffer, BufferRange, BufferSlice, Gpu, Pipeline, Recorder, Result};

/// Passes and buffers of the sorts.
pub(super) struct GlobalLists {
    gpu: Gpu,
    shape: SortShape,
    gather_counts: Pipeline,
    emit: Pipeline,
    /// Constants of the emission pass.
    emission: [(&'static str, u32); 3],
    ranges: Pipeline,
    depth_sort: RadixSort,
    tile_sort: RadixSort,
    keys: [BufferRange; 2],
    vals: [BufferRange; 2],
    pair_keys: [BufferRange; 2],
    pair_vals: [BufferRange; 2],
}

/// The visible splats in depth order, and for each splat the number of pairs of all splats before.
#[derive(Clone, Copy)]
struct NearestFirst<'a> {
    order: BufferSlice<'a>,
    pair_offsets: BufferSlice<'a>,
}

impl GlobalLists {
    pub(super) fn new(
        gpu: &Gpu,
        capacities: &Capacities,
        shape: SortShape,
        layout: &ScratchLayout,
        early: &Buffer,
        with_slots: bool,
    ) -> Result<Self> {
        let &Capacities { splats, pairs, tiles } = capacities;
        let [depth_tables, tile_tables, keys, vals] =
            [&layout.depth_tables, &layout.tile_tables, &layout.keys, &layout.vals].map(|ranges| parts(early, ranges));
        let carried = ("CARRIED", u32::from(!with_slots));
        let emission = [carried, per_turn(tiles), alpha_min::constant(None)];
        Ok(Self {
            gpu: gpu.clone(),
            shape,
            gather_counts: gpu.pipeline(&compact::GATHER_COUNTS.kernel, &[])?,
            emit: gpu.pipeline(&emit::PASS.kernel, &emission)?,
            emission,
            ranges: gpu.pipeline(&tile_ranges::PASS.kernel, &[carried])?,
            depth_sort: RadixSort::within(gpu, "depth_sort", shape, splats, DEPTH_BITS, depth_tables)?,
            tile_sort: RadixSort::within(gpu, "tile_sort", shape, pairs, tile_bits(tiles), tile_tables)?,
            keys,
            vals,
            pair_keys: words(gpu, ["pair_keys0", "pair_keys1"], pairs)?,
            pair_vals: words(gpu, ["pair_vals0", "pair_vals1"], pairs)?,
        })
    }

    pub(super) fn held(&self) -> MemoryFootprint {
        let bytes = |parts: &[BufferRange; 2]| parts.iter().map(|part| part.slice().bytes()).sum::<u64>();
        MemoryFootprint {
            splats: self.depth_sort.bytes(),
            pairs: bytes(&self.pair_keys) + bytes(&self.pair_vals) + self.tile_sort.bytes(),
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
        let [columns, rows] = grid.counts();
        let tiles = columns * rows;
        let [keys, vals] = [both(&self.keys), both(&self.vals)];
        // Side 1 of the values serves as scratch for the positions of the visible splats.
        let scratch = VisibleScratch { keys: keys[0], splats: vals[0], places: vals[1] };
        lists.visible.record(rec, inputs, scratch, lists.depth_bits)?;
        let nearest_first = self.record_depth_order(rec, lists, inputs)?;
        let [sort, table] = self.shape.entries(tile_bits(u64::from(tiles)));
        lists.record_plan_of_pairs(rec, inputs, &[sort, table, Entry::items(LOCAL_SIZE), Entry::fixed(1)])?;
        self.record_pairs(rec, lists, inputs, grid, nearest_first)?;
        self.record_tile_order(rec, lists, inputs, tiles)
    }

    /// Sorts the visible splats by depth, and computes the first pair of each splat.
    fn record_depth_order<'a>(
        &'a self,
        rec: &mut Recorder,
        lists: &'a TileLists,
        inputs: &TileListInputs<'_>,
    ) -> Result<NearestFirst<'a>> {
        let [_, tile_counts, count_words] = inputs.slices();
        let [sort, table] = self.shape.entries(lists.depth_bits);
        let slot_sums = Entry::items(slot_sum::SPLATS_PER_WORKGROUP);
        let of_visible = [sort, table, scan::entry(), Entry::items(LOCAL_SIZE), slot_sums, Entry::fixed(1)];
        lists.record_plan(rec, inputs, plan::Push::unlimited(VISIBLE, inputs.at(VISIBLE_SORT), &of_visible))?;
        let sorted = Unsorted {
            keys: both(&self.keys),
            vals: both(&self.vals),
            apart: lists.visible.listed.as_ref().map(BufferRange::slice),
        };
        let Unsorted { keys, vals, .. } = sorted;
        let (args, once) = (inputs.args, inputs.at(VISIBLE_ONCE));
        let extent = KeyCount::Counted { counter: VISIBLE, args, first: inputs.at(VISIBLE_SORT), once };
        let side = self.depth_sort.record_from(rec, sorted, inputs.counters, extent, lists.depth_bits)?;
        // The keys and the other side of the values are free again.
        let (order, pair_offsets, visible_counts) = (vals[side], vals[1 - side], keys[0]);
        let bound = [order, tile_counts, count_words, visible_counts];
        rec.dispatch(&self.gather_counts, &bound, &(), inputs.groups(VISIBLE_ITEMS))?;
        let extent = ScanExtent::counted(VISIBLE, args, inputs.at(VISIBLE_SCAN), once);
        let sides = [visible_counts, pair_offsets];
        lists.visible.scan.record(rec, sides, inputs.counters, extent, Summand::Words, PAIRS)?;
        Ok(NearestFirst { order, pair_offsets })
    }

    /// Emits the pairs; the pairs of a splat are consecutive.
    fn record_pairs(
        &self,
        rec: &mut Recorder,
        lists: &TileLists,
        inputs: &TileListInputs<'_>,
        grid: &TileGrid,
        NearestFirst { order, pair_offsets }: NearestFirst<'_>,
    ) -> Result<()> {
        let [splat2d, tile_counts, count_words] = inputs.slices();
        let push = emit::Push {
            width: grid.image[0],
            height: grid.image[1],
            tile_width: grid.tile[0],
            tile_height: grid.tile[1],
            capacity: lists.pairs_that_fit,
        };
        let (keys, vals) = (both(&self.pair_keys), both(&self.pair_vals));
        // Without slots, placeholders are bound, which the pass neither reads nor writes.
        let slots = lists.visible.slots.as_ref().map(|slots| (slots.splat.slice(), slots.offsets.slice()));
        let (slot_splat, slot_offsets) = slots.unwrap_or((vals[1], pair_offsets));
        let pairs_of = [count_words, keys[0], vals[0], slot_splat, slot_offsets];
        let bound = [splat2d, tile_counts, order, pair_offsets].into_iter().chain(pairs_of).collect::<Vec<_>>();
        let emit = match inputs.alpha_cutoff {
            cutoff @ Some(_) => {
                let [carried, per_turn, _] = self.emission;
                self.gpu.pipeline(&emit::PASS.kernel, &[carried, per_turn, alpha_min::constant(cutoff)])?
            }
            None => self.emit.clone(),
        };
        rec.dispatch(&emit, &bound, &push, inputs.groups(VISIBLE_ITEMS))
    }

    /// Sorts the pairs by tile and finds the range of each tile. The sort is stable, so the pairs of a tile stay in
    /// depth order.
    fn record_tile_order<'a>(
        &'a self,
        rec: &mut Recorder,
        lists: &'a TileLists,
        inputs: &TileListInputs<'a>,
        tiles: u32,
    ) -> Result<SortedPairs<'a>> {
        let [_, _, count_words] = inputs.slices();
        let (keys, vals) = (both(&self.pair_keys), both(&self.pair_vals));
        let (args, once) = (inputs.args, inputs.at(PAIR_ONCE));
        let extent = KeyCount::Counted { counter: PAIRS, args, first: inputs.at(PAIR_SORT), once };
        let bits = tile_bits(u64::from(tiles));
        let side = self.tile_sort.record(rec, keys, vals, inputs.counters, extent, bits)?;
        let ranges = lists.tile_ranges.slice();
        rec.fill(ranges, 0)?;
        // The other side of the keys is free again.
        let slots = lists.visible.slots.as_ref();
        let slot_splat = slots.map_or(vals[1 - side], |slots| slots.splat.slice());
        let bound = [keys[side], vals[side], slot_splat, count_words, keys[1 - side], ranges];
        rec.dispatch(&self.ranges, &bound, &tile_ranges::Push { tiles }, inputs.groups(PAIR_ITEMS))?;
        let splats = if slots.is_some() { keys[1 - side] } else { vals[side] };
        Ok(SortedPairs { splats, slots: vals[side] })
    }
}

fn both(parts: &[BufferRange; 2]) -> [BufferSlice<'_>; 2] {
    [parts[0].slice(), parts[1].slice()]
}
