//! Tile lists: for every tile, the splats on the tile in depth order.

use super::memory_footprint::MemoryFootprint;
use super::pass_select;
use super::scan::{self, Scan, ScanExtent, Summand};
use super::scratch_buffers::{ScratchBuffers, ScratchLayout, parts, words};
use super::sort::{KeyCount, RadixSort, SortShape, Unsorted};
use crate::pass::plan::{self, Entry, NO_COUNTER};
use crate::pass::turns::per_turn;
use crate::pass::{alpha_min, compact, counters, emit, slot_sum, tile_ranges};
use crate::scene::tile::TileGrid;
use crate::vk::{Buffer, BufferRange, BufferSlice, Error, Gpu, Groups, Memory, Pipeline, Recorder, Result};

/// Bits of a depth key. Depths are positive, so the sign bit is always 0.
pub(crate) const DEPTH_BITS: u32 = 31;
/// Workgroup size: splats for `compact`, `gather_counts` and `emit`, pairs for `tile_ranges`.
const LOCAL_SIZE: u32 = 64;

/// Number of consecutive entries of `args` that [`TileLists`] uses.
pub const ENTRIES: u32 = 13;

/// The first entries. They depend on the number of splats, and the caller plans them together with its own entries.
pub const SPLAT_ENTRIES: [Entry; 3] = [scan::entry(), Entry::items(LOCAL_SIZE), Entry::fixed(1)];

// Offsets into the entries of the tile lists.
const SPLAT_SCAN: u32 = 0;
const SPLAT_ITEMS: u32 = 1;
const SPLAT_ONCE: u32 = 2;
const VISIBLE_SORT: u32 = 3;
const VISIBLE_SCAN: u32 = 5;
const VISIBLE_ITEMS: u32 = 6;
const VISIBLE_ONCE: u32 = 7;
const VISIBLE_SLOTS: u32 = 8;
const PAIR_SORT: u32 = 9;
const PAIR_ITEMS: u32 = 11;
const PAIR_ONCE: u32 = 12;

// Indices of counters.
const SPLATS: u32 = counters::SPLATS as u32;
const VISIBLE: u32 = counters::VISIBLE as u32;
const PAIRS: u32 = counters::PAIRS as u32;

/// Capacities of the buffers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capacities {
    /// Most splats.
    pub splats: u64,
    /// Most (splat, tile) pairs; less than 2^32.
    pub pairs: u64,
    /// Most tiles of an image.
    pub tiles: u64,
}

/// The buffers and passes of the tile lists.
pub struct TileLists {
    gpu: Gpu,
    capacities: Capacities,
    shape: SortShape,
    depth_bits: u32,
    plan: Pipeline,
    compact: Pipeline,
    gather_counts: Pipeline,
    emit: Pipeline,
    /// Constants of the emission pass.
    emission: [(&'static str, u32); 3],
    ranges: Pipeline,
    splat_scan: Scan,
    depth_sort: RadixSort,
    tile_sort: RadixSort,
    keys: [BufferRange; 2],
    vals: [BufferRange; 2],
    /// The visible splats in index order, if used later by the optimiser or the sums of slots.
    listed: Option<BufferRange>,
    /// Whether the optimiser uses `listed`.
    optimised: bool,
    pair_keys: [BufferRange; 2],
    pair_vals: [BufferRange; 2],
    /// `None` without slots: pairs then carry the splat instead of the slot.
    slots: Option<SlotBuffers>,
    tile_ranges: Buffer,
}

/// Buffers of slots.
struct SlotBuffers {
    splat: BufferRange,
    offsets: BufferRange,
}

/// Outputs of earlier passes.
#[derive(Clone, Copy)]
pub struct TileListInputs<'a> {
    /// Rows of 12 floats per splat.
    pub splat2d: &'a Buffer,
    /// Number of touched tiles per splat.
    pub tile_counts: &'a Buffer,
    /// The frame's counters.
    pub counters: &'a Buffer,
    /// The frame's indirect workgroup counts.
    pub args: &'a Buffer,
    /// Index of the first of the [`ENTRIES`] entries to use. The caller has planned the first of them,
    /// [`SPLAT_ENTRIES`].
    pub first_entry: u32,
    /// Number of entries in `args`. All entries become zero when the pairs do not fit.
    pub entries: u32,
    /// Alpha cutoff n: a splat is listed only in tiles where its alpha reaches 1 / n. `None` stands for 255.
    pub alpha_cutoff: Option<u32>,
}

/// The lists of one recorded frame.
#[derive(Clone, Copy)]
pub struct FrameLists<'a> {
    /// Slot data; `None` without slots, when the memory is reused before the lists are complete.
    pub slots: Option<Slots<'a>>,
    /// Splat of each pair, in (tile, depth) order.
    pub sorted_splats: BufferSlice<'a>,
    /// Range [begin, end) of each tile's pairs.
    pub tile_ranges: BufferSlice<'a>,
    /// Workgroups of `slot_sum` for the visible splats; zero when the pairs do not fit.
    pub slot_sums: Groups<'a>,
}

/// The slots of pairs. The slots of a splat are consecutive, and slots follow the order of splats. With splats in
/// Morton order, the slots of a tile lie close together.
#[derive(Clone, Copy)]
pub struct Slots<'a> {
    /// Visible splats in index order; the first `counters.visible` entries.
    pub listed: BufferSlice<'a>,
    /// First slot of each splat.
    pub slot_offsets: BufferSlice<'a>,
    /// Splat of each slot. In training valid only until the blend backward pass.
    pub slot_splat: BufferSlice<'a>,
    /// Slot of each pair, in (tile, depth) order.
    pub sorted_slots: BufferSlice<'a>,
}

impl TileLists {
    /// Allocates tile lists of the given capacities, with slots.
    pub fn new(gpu: &Gpu, capacities: Capacities) -> Result<TileLists> {
        TileLists::with_shape(gpu, capacities, SortShape::of(gpu.caps(), capacities.pairs))
    }

    /// Like [`Self::new`], with a given shape of the sorts.
    pub fn with_shape(gpu: &Gpu, capacities: Capacities, shape: SortShape) -> Result<TileLists> {
        let early = gpu.buffer("lists", ScratchLayout::new(gpu, &capacities, shape).bytes(), Memory::Device)?;
        let slot_splat = gpu.buffer("slot_splat", 4 * capacities.pairs.max(1), Memory::Device)?;
        let slot_splat = Some(BufferRange::whole(slot_splat));
        TileLists::within(gpu, capacities, shape, ScratchBuffers { early: &early, slot_splat }, false)
    }

    /// Like [`Self::with_shape`], in lent scratch memory: see [`ScratchLayout`]. `listed` keeps the visible splats in
    /// index order for the optimiser.
    pub(super) fn within(
        gpu: &Gpu,
        capacities: Capacities,
        shape: SortShape,
        loan: ScratchBuffers<'_>,
        listed: bool,
    ) -> Result<TileLists> {
        let Capacities { splats, pairs, tiles } = capacities;
        let layout = ScratchLayout::new(gpu, &capacities, shape);
        let [depth_tables, tile_tables, keys, vals] =
            [&layout.depth_tables, &layout.tile_tables, &layout.keys, &layout.vals]
                .map(|ranges| parts(loan.early, ranges));
        let of_splats = |name| gpu.buffer(name, 4 * splats.max(1), Memory::Device).map(BufferRange::whole);
        let carried = ("CARRIED", u32::from(loan.slot_splat.is_none()));
        let emission = [carried, per_turn(tiles), alpha_min::constant(None)];
        Ok(TileLists {
            gpu: gpu.clone(),
            capacities,
            shape,
            depth_bits: DEPTH_BITS,
            plan: gpu.pipeline(&plan::PASS.kernel, &[])?,
            compact: gpu.pipeline(&compact::PASS.kernel, &[])?,
            gather_counts: gpu.pipeline(&compact::GATHER_COUNTS.kernel, &[])?,
            emit: gpu.pipeline(&pass_select::emission(gpu).kernel, &emission)?,
            emission,
            ranges: gpu.pipeline(&tile_ranges::PASS.kernel, &[carried])?,
            splat_scan: Scan::new(gpu, "splat_scan", splats)?,
            depth_sort: RadixSort::within(gpu, "depth_sort", shape, splats, DEPTH_BITS, depth_tables)?,
            tile_sort: RadixSort::within(gpu, "tile_sort", shape, pairs, tile_bits(tiles), tile_tables)?,
            keys,
            vals,
            listed: (listed || loan.slot_splat.is_some()).then(|| of_splats("listed")).transpose()?,
            optimised: listed,
            pair_keys: words(gpu, ["pair_keys0", "pair_keys1"], pairs)?,
            pair_vals: words(gpu, ["pair_vals0", "pair_vals1"], pairs)?,
            slots: loan
                .slot_splat
                .map(|splat| Ok::<_, Error>(SlotBuffers { splat, offsets: of_splats("slot_offsets")? }))
                .transpose()?,
            tile_ranges: gpu.buffer("tile_ranges", 8 * tiles.max(1), Memory::Device)?,
        })
    }

    /// Bytes of the lists' own buffers, without lent memory.
    pub(super) fn held(&self) -> MemoryFootprint {
        let bytes = |parts: &[BufferRange; 2]| parts.iter().map(|part| part.slice().bytes()).sum::<u64>();
        let listed = self.listed.as_ref().map_or(0, |part| part.slice().bytes());
        let (of_optimiser, of_slots) = if self.optimised { (listed, 0) } else { (0, listed) };
        MemoryFootprint {
            splats: self.splat_scan.bytes() + self.depth_sort.bytes() + of_optimiser,
            pairs: bytes(&self.pair_keys) + bytes(&self.pair_vals) + self.tile_sort.bytes(),
            pixels: self.tile_ranges.size(),
            slot_splats: of_slots + self.slots.as_ref().map_or(0, |slots| slots.offsets.slice().bytes()),
            ..MemoryFootprint::default()
        }
    }

    /// Sorts splats by only the highest `bits` bits of their depth, at most 31 (the default). Splats with equal depth
    /// bits are drawn in index order.
    pub fn sort_depths_by(&mut self, bits: u32) {
        self.depth_bits = bits.clamp(1, DEPTH_BITS);
    }

    /// The visible splats of the last recorded frame in index order (the first `counters.visible` entries), and
    /// workgroups of 64 threads with one thread per splat (zero when the pairs do not fit). `None` unless the list is
    /// kept for the optimiser.
    pub(super) fn listed<'a>(&'a self, args: &'a Buffer, first_entry: u32) -> Option<(BufferSlice<'a>, Groups<'a>)> {
        let groups = Groups::Indirect(args, Entry::offset(first_entry + VISIBLE_ITEMS));
        self.listed.as_ref().filter(|_| self.optimised).map(|part| (part.slice(), groups))
    }

    /// The capacities given at construction.
    pub fn capacities(&self) -> Capacities {
        self.capacities
    }

    /// Records the passes for an image of `grid`, with at most [`Capacities::tiles`] tiles. Reads the number of splats
    /// from `counters.splats`; writes `counters.visible` and `counters.pairs`. When the pairs do not fit, sets
    /// [`counters::PAIRS_BIT`] in `counters.status` and emits nothing.
    pub fn record<'a>(
        &'a self,
        rec: &mut Recorder,
        inputs: TileListInputs<'a>,
        grid: &TileGrid,
    ) -> Result<FrameLists<'a>> {
        let [columns, rows] = grid.counts();
        let tiles = columns * rows;
        self.record_visible(rec, &inputs)?;
        let nearest_first = self.record_depth_order(rec, &inputs)?;
        self.record_plan_of_pairs(rec, &inputs, tiles)?;
        self.record_pairs(rec, &inputs, grid, nearest_first)?;
        self.record_tile_order(rec, &inputs, tiles)
    }

    /// Lists the visible splats in index order, with their depths, and computes the first slot of each splat.
    fn record_visible(&self, rec: &mut Recorder, inputs: &TileListInputs<'_>) -> Result<()> {
        let [splat2d, tile_counts, count_words] = inputs.slices();
        let [keys, vals] = [both(&self.keys), both(&self.vals)];
        let extent = ScanExtent::counted(SPLATS, inputs.args, inputs.at(SPLAT_SCAN), inputs.at(SPLAT_ONCE));
        // Side 1 of the values serves as scratch for the positions of the visible splats.
        let places = vals[1];
        let (counts, to) = (inputs.counters, [tile_counts, places]);
        self.splat_scan.record(rec, to, counts, extent, Summand::NonZero, VISIBLE)?;
        if let Some(slots) = &self.slots {
            let to = [tile_counts, slots.offsets.slice()];
            self.splat_scan.record(rec, to, counts, extent, Summand::Words, NO_COUNTER)?;
        }
        let listed = self.listed.as_ref().map_or(vals[0], BufferRange::slice);
        let bound = [splat2d, tile_counts, places, count_words, keys[0], listed];
        let push = compact::Push { shift: DEPTH_BITS - self.depth_bits };
        rec.dispatch(&self.compact, &bound, &push, inputs.groups(SPLAT_ITEMS))
    }

    /// Sorts the visible splats by depth, and computes the first pair of each splat.
    fn record_depth_order<'a>(&'a self, rec: &mut Recorder, inputs: &TileListInputs<'_>) -> Result<NearestFirst<'a>> {
        let [_, tile_counts, count_words] = inputs.slices();
        let [sort, table] = self.shape.entries(self.depth_bits);
        let slot_sums = Entry::items(slot_sum::SPLATS_PER_WORKGROUP);
        let of_visible = [sort, table, scan::entry(), Entry::items(LOCAL_SIZE), Entry::fixed(1), slot_sums];
        self.record_plan(rec, inputs, plan::Push::unlimited(VISIBLE, inputs.at(VISIBLE_SORT), &of_visible))?;
        let sorted = Unsorted {
            keys: both(&self.keys),
            vals: both(&self.vals),
            apart: self.listed.as_ref().map(BufferRange::slice),
        };
        let Unsorted { keys, vals, .. } = sorted;
        let (args, once) = (inputs.args, inputs.at(VISIBLE_ONCE));
        let extent = KeyCount::Counted { counter: VISIBLE, args, first: inputs.at(VISIBLE_SORT), once };
        let side = self.depth_sort.record_from(rec, sorted, inputs.counters, extent, self.depth_bits)?;
        // The keys and the other side of the values are free again.
        let (order, pair_offsets, visible_counts) = (vals[side], vals[1 - side], keys[0]);
        let bound = [order, tile_counts, count_words, visible_counts];
        rec.dispatch(&self.gather_counts, &bound, &(), inputs.groups(VISIBLE_ITEMS))?;
        let extent = ScanExtent::counted(VISIBLE, args, inputs.at(VISIBLE_SCAN), once);
        let sides = [visible_counts, pair_offsets];
        self.splat_scan.record(rec, sides, inputs.counters, extent, Summand::Words, PAIRS)?;
        Ok(NearestFirst { order, pair_offsets })
    }

    /// Plans the passes over pairs if the pairs fit. Otherwise voids every planned dispatch, so that no later pass runs
    /// on incomplete lists.
    fn record_plan_of_pairs(&self, rec: &mut Recorder, inputs: &TileListInputs<'_>, tiles: u32) -> Result<()> {
        let [sort, table] = self.shape.entries(tile_bits(u64::from(tiles)));
        let of_pairs = [sort, table, Entry::items(LOCAL_SIZE), Entry::fixed(1)];
        let push = plan::Push::unlimited(PAIRS, inputs.at(PAIR_SORT), &of_pairs);
        let push = push.limited(self.pairs_that_fit(), counters::PAIRS_BIT, counters::WANT_PAIRS as u32);
        self.record_plan(rec, inputs, push.voiding(inputs.entries))
    }

    /// Emits the pairs; the pairs of a splat are consecutive.
    fn record_pairs(
        &self,
        rec: &mut Recorder,
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
            capacity: self.pairs_that_fit(),
        };
        let (keys, vals) = (both(&self.pair_keys), both(&self.pair_vals));
        // Without slots, placeholders are bound, which the pass neither reads nor writes.
        let slots = self.slots.as_ref().map(|slots| (slots.splat.slice(), slots.offsets.slice()));
        let (slot_splat, slot_offsets) = slots.unwrap_or((vals[1], pair_offsets));
        let pairs_of = [count_words, keys[0], vals[0], slot_splat, slot_offsets];
        let bound = [splat2d, tile_counts, order, pair_offsets].into_iter().chain(pairs_of).collect::<Vec<_>>();
        let emit = match inputs.alpha_cutoff {
            cutoff @ Some(_) => {
                let [carried, per_turn, _] = self.emission;
                let constants = [carried, per_turn, alpha_min::constant(cutoff)];
                self.gpu.pipeline(&pass_select::emission(&self.gpu).kernel, &constants)?
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
        inputs: &TileListInputs<'a>,
        tiles: u32,
    ) -> Result<FrameLists<'a>> {
        let [_, _, count_words] = inputs.slices();
        let (keys, vals) = (both(&self.pair_keys), both(&self.pair_vals));
        let (args, once) = (inputs.args, inputs.at(PAIR_ONCE));
        let extent = KeyCount::Counted { counter: PAIRS, args, first: inputs.at(PAIR_SORT), once };
        let bits = tile_bits(u64::from(tiles));
        let side = self.tile_sort.record(rec, keys, vals, inputs.counters, extent, bits)?;
        rec.fill(&self.tile_ranges, 0)?;
        let ranges: BufferSlice<'_> = (&self.tile_ranges).into();
        // The other side of the keys is free again.
        let slot_splat = self.slots.as_ref().map_or(vals[1 - side], |slots| slots.splat.slice());
        let bound = [keys[side], vals[side], slot_splat, count_words, keys[1 - side], ranges];
        rec.dispatch(&self.ranges, &bound, &tile_ranges::Push { tiles }, inputs.groups(PAIR_ITEMS))?;
        Ok(FrameLists {
            slots: self.slots.as_ref().zip(self.listed.as_ref()).map(|(slots, listed)| Slots {
                listed: listed.slice(),
                slot_offsets: slots.offsets.slice(),
                slot_splat: slots.splat.slice(),
                sorted_slots: vals[side],
            }),
            sorted_splats: if self.slots.is_some() { keys[1 - side] } else { vals[side] },
            tile_ranges: ranges,
            slot_sums: inputs.groups(VISIBLE_SLOTS),
        })
    }

    fn record_plan(&self, rec: &mut Recorder, inputs: &TileListInputs<'_>, push: plan::Push) -> Result<()> {
        rec.dispatch(&self.plan, &[inputs.counters, inputs.args], &push, Groups::Workgroups(1))
    }

    /// Most pairs. The largest word is reserved for counts that overflow a word.
    fn pairs_that_fit(&self) -> u32 {
        u32::try_from(self.capacities.pairs).unwrap_or(u32::MAX).min(u32::MAX - 1)
    }
}

/// The visible splats in depth order, and for each splat the number of pairs of all splats before.
#[derive(Clone, Copy)]
struct NearestFirst<'a> {
    order: BufferSlice<'a>,
    pair_offsets: BufferSlice<'a>,
}

impl<'a> TileListInputs<'a> {
    /// Projected splats, tile counts and counters.
    fn slices(&self) -> [BufferSlice<'a>; 3] {
        [self.splat2d, self.tile_counts, self.counters].map(Into::into)
    }

    /// Index in `args` of an entry of the tile lists.
    fn at(&self, entry: u32) -> u32 {
        self.first_entry + entry
    }

    /// Workgroups of an entry of the tile lists.
    fn groups(&self, entry: u32) -> Groups<'a> {
        Groups::Indirect(self.args, Entry::offset(self.at(entry)))
    }
}

/// Bits of a pair's key, for tile numbers 0 to `tiles` inclusive (`emit` uses the number `tiles` for padding).
pub(crate) fn tile_bits(tiles: u64) -> u32 {
    (64 - tiles.leading_zeros()).min(32)
}

fn both(parts: &[BufferRange; 2]) -> [BufferSlice<'_>; 2] {
    [parts[0].slice(), parts[1].slice()]
}
