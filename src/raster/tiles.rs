//! From projected splats to the depth-ordered list of splats of every tile.

use super::memory_footprint::MemoryFootprint;
use super::pass_select;
use super::scan::{self, Extent, Scan, Summand};
use super::scratch_buffers::{Layout, ScratchBuffers, parts, words};
use super::sort::{Keys, RadixSort, Shape, Unsorted};
use crate::pass::plan::{self, Entry, NO_COUNTER};
use crate::pass::turns::per_turn;
use crate::pass::{alpha_min, compact, counters, emit, gather_counts, slot_sum, tile_ranges};
use crate::scene::tile::TileGrid;
use crate::vk::{Buffer, BufferRange, BufferSlice, Error, Gpu, Groups, Memory, Pipeline, Recorder, Result};

/// Bits of a depth key: depths are positive, so their sign bit is 0.
pub(crate) const DEPTH_BITS: u32 = 31;
/// Splats of a workgroup of `compact`, `gather_counts` and `emit`, pairs of one of `tile_ranges`.
const LOCAL_SIZE: u32 = 64;

/// Entries of `args` that [`TileLists`] uses, from the first one given on.
pub const ENTRIES: u32 = 13;

/// The first of these entries: they depend on the number of splats and are planned by the caller,
/// whose own entries may too.
pub const SPLAT_ENTRIES: [Entry; 3] = [scan::entry(), Entry::items(LOCAL_SIZE), Entry::fixed(1)];

// Offsets into those entries.
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

// Counters.
const SPLATS: u32 = counters::SPLATS as u32;
const VISIBLE: u32 = counters::VISIBLE as u32;
const PAIRS: u32 = counters::PAIRS as u32;

/// Sizes that the buffers hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capacities {
    /// Splats.
    pub splats: u64,
    /// (splat, tile) pairs, less than 2^32.
    pub pairs: u64,
    /// Tiles of the largest image.
    pub tiles: u64,
}

/// The buffers and passes of the tile lists.
pub struct TileLists {
    gpu: Gpu,
    capacities: Capacities,
    shape: Shape,
    depth_bits: u32,
    plan: Pipeline,
    compact: Pipeline,
    gather_counts: Pipeline,
    emit: Pipeline,
    /// Its constants.
    emission: [(&'static str, u32); 3],
    ranges: Pipeline,
    splat_scan: Scan,
    depth_sort: RadixSort,
    tile_sort: RadixSort,
    keys: [BufferRange; 2],
    vals: [BufferRange; 2],
    /// The visible splats in the order of their index, where somebody asks for them after: the optimiser,
    /// or the sums of slots.
    listed: Option<BufferRange>,
    /// Whether the optimiser does.
    optimised: bool,
    pair_keys: [BufferRange; 2],
    pair_vals: [BufferRange; 2],
    /// Without, pairs carry the splat and not the slot.
    slots: Option<SlotBuffers>,
    tile_ranges: Buffer,
}

/// What slots need beyond the pairs.
struct SlotBuffers {
    splat: BufferRange,
    offsets: BufferRange,
}

/// What the passes before have written.
#[derive(Clone, Copy)]
pub struct Inputs<'a> {
    /// Rows of 12 floats per splat.
    pub splat2d: &'a Buffer,
    /// Tiles touched, per splat.
    pub tile_counts: &'a Buffer,
    /// The frame's counters.
    pub counters: &'a Buffer,
    /// The frame's workgroup numbers.
    pub args: &'a Buffer,
    /// First of the [`ENTRIES`] entries to use; the first of them are planned: [`SPLAT_ENTRIES`].
    pub first_entry: u32,
    /// Entries in `args`: all become zero when the pairs do not fit.
    pub entries: u32,
    /// A splat is listed only in tiles where its alpha is at least 1 / this somewhere, where that is not 255.
    pub alpha_cutoff: Option<u32>,
}

/// The lists of one recorded frame.
#[derive(Clone, Copy)]
pub struct Lists<'a> {
    /// What sums by slots need; where there are none these bytes are used again before the lists are complete.
    pub slots: Option<Slots<'a>>,
    /// Splat of each pair in (tile, depth) order.
    pub sorted_splats: BufferSlice<'a>,
    /// [begin, end) of each tile's pairs.
    pub tile_ranges: BufferSlice<'a>,
    /// Workgroups of `slot_sum` for the visible splats; none when the pairs do not fit.
    pub slot_sums: Groups<'a>,
}

/// The slots of pairs: a splat's are consecutive, in the order of the splats.
/// With splats in Morton order those of a tile lie near one another.
#[derive(Clone, Copy)]
pub struct Slots<'a> {
    /// Visible splats in the order of their index (the first `counters.visible`).
    pub listed: BufferSlice<'a>,
    /// First slot of each splat.
    pub slot_offsets: BufferSlice<'a>,
    /// Splat of each slot; in training until the blend backward.
    pub slot_splat: BufferSlice<'a>,
    /// Slot of each pair in (tile, depth) order.
    pub sorted_slots: BufferSlice<'a>,
}

impl TileLists {
    /// Allocates for the given sizes, with slots.
    pub fn new(gpu: &Gpu, capacities: Capacities) -> Result<TileLists> {
        TileLists::with_shape(gpu, capacities, Shape::of(gpu.caps(), capacities.pairs))
    }

    /// The same with the sort's shape given.
    pub fn with_shape(gpu: &Gpu, capacities: Capacities, shape: Shape) -> Result<TileLists> {
        let early = gpu.buffer("lists", Layout::new(gpu, &capacities, shape).bytes(), Memory::Device)?;
        let slot_splat = gpu.buffer("slot_splat", 4 * capacities.pairs.max(1), Memory::Device)?;
        let slot_splat = Some(BufferRange::whole(slot_splat));
        TileLists::within(gpu, capacities, shape, ScratchBuffers { early: &early, slot_splat }, false)
    }

    /// The same in memory that is the lists' until they are complete, see [`Layout`]. `listed`: the visible splats are
    /// kept in the order of their index.
    pub(super) fn within(
        gpu: &Gpu,
        capacities: Capacities,
        shape: Shape,
        loan: ScratchBuffers<'_>,
        listed: bool,
    ) -> Result<TileLists> {
        let Capacities { splats, pairs, tiles } = capacities;
        let layout = Layout::new(gpu, &capacities, shape);
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
            gather_counts: gpu.pipeline(&gather_counts::PASS.kernel, &[])?,
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

    /// Bytes of its own buffers, what was lent aside.
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

    /// Sorts by so many of the highest bits of a depth, at most all 31, which is what happens without: splats whose
    /// depths agree in these are drawn in the order of their index.
    pub fn sort_depths_by(&mut self, bits: u32) {
        self.depth_bits = bits.clamp(1, DEPTH_BITS);
    }

    /// The visible splats of the frame that was recorded last in the order of their index (the first
    /// `counters.visible`), where they are kept for the optimiser, and workgroups of 64 threads for one each;
    /// none when the pairs do not fit.
    pub(super) fn listed<'a>(&'a self, args: &'a Buffer, first_entry: u32) -> Option<(BufferSlice<'a>, Groups<'a>)> {
        let groups = Groups::Indirect(args, Entry::offset(first_entry + VISIBLE_ITEMS));
        self.listed.as_ref().filter(|_| self.optimised).map(|part| (part.slice(), groups))
    }

    /// What was allocated for.
    pub fn capacities(&self) -> Capacities {
        self.capacities
    }

    /// Records the passes for an image of `grid`, with at most as many tiles as were allocated for.
    /// `counters.splats` says how many splats there are; `visible` and `pairs` are written. With more pairs than fit,
    /// `status` gets its bit and nothing is emitted.
    pub fn record<'a>(&'a self, rec: &mut Recorder, inputs: Inputs<'a>, grid: &TileGrid) -> Result<Lists<'a>> {
        let [columns, rows] = grid.counts();
        let tiles = columns * rows;
        self.record_visible(rec, &inputs)?;
        let nearest_first = self.record_depth_order(rec, &inputs)?;
        self.record_plan_of_pairs(rec, &inputs, tiles)?;
        self.record_pairs(rec, &inputs, grid, nearest_first)?;
        self.record_tile_order(rec, &inputs, tiles)
    }

    /// Lists the visible splats in the order of their index, with their depths, and sums up the slots before those of
    /// each splat.
    fn record_visible(&self, rec: &mut Recorder, inputs: &Inputs<'_>) -> Result<()> {
        let [splat2d, tile_counts, count_words] = inputs.slices();
        let [keys, vals] = [both(&self.keys), both(&self.vals)];
        let extent = Extent::counted(SPLATS, inputs.args, inputs.at(SPLAT_SCAN), inputs.at(SPLAT_ONCE));
        // The other side of the values serves as scratch for the places of the visible splats.
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

    /// Sorts the visible splats by their depth, and sums up the pairs before those of each splat.
    fn record_depth_order<'a>(&'a self, rec: &mut Recorder, inputs: &Inputs<'_>) -> Result<NearestFirst<'a>> {
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
        let extent = Keys::Counted { counter: VISIBLE, args, first: inputs.at(VISIBLE_SORT), once };
        let side = self.depth_sort.record_from(rec, sorted, inputs.counters, extent, self.depth_bits)?;
        // The keys have done their work, and so has the other side of the values.
        let (order, pair_offsets, visible_counts) = (vals[side], vals[1 - side], keys[0]);
        let bound = [order, tile_counts, count_words, visible_counts];
        rec.dispatch(&self.gather_counts, &bound, &(), inputs.groups(VISIBLE_ITEMS))?;
        let extent = Extent::counted(VISIBLE, args, inputs.at(VISIBLE_SCAN), once);
        let sides = [visible_counts, pair_offsets];
        self.splat_scan.record(rec, sides, inputs.counters, extent, Summand::Words, PAIRS)?;
        Ok(NearestFirst { order, pair_offsets })
    }

    /// Plans the passes over pairs, if the pairs fit. If not, everything planned so far is void too: what follows must
    /// not run on them.
    fn record_plan_of_pairs(&self, rec: &mut Recorder, inputs: &Inputs<'_>, tiles: u32) -> Result<()> {
        let [sort, table] = self.shape.entries(tile_bits(u64::from(tiles)));
        let of_pairs = [sort, table, Entry::items(LOCAL_SIZE), Entry::fixed(1)];
        let push = plan::Push::unlimited(PAIRS, inputs.at(PAIR_SORT), &of_pairs);
        let push = push.limited(self.pairs_that_fit(), counters::PAIRS_BIT, counters::WANT_PAIRS as u32);
        self.record_plan(rec, inputs, push.voiding(inputs.entries))
    }

    /// Emits the pairs, those of a splat one after the other.
    fn record_pairs(
        &self,
        rec: &mut Recorder,
        inputs: &Inputs<'_>,
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
        // Where there are no slots other buffers stand for theirs, which are neither read nor written then.
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

    /// Sorts the pairs by their tile, and finds those of each tile. The sort is stable, so pairs of a tile are in the
    /// order of their depth.
    fn record_tile_order<'a>(&'a self, rec: &mut Recorder, inputs: &Inputs<'a>, tiles: u32) -> Result<Lists<'a>> {
        let [_, _, count_words] = inputs.slices();
        let (keys, vals) = (both(&self.pair_keys), both(&self.pair_vals));
        let (args, once) = (inputs.args, inputs.at(PAIR_ONCE));
        let extent = Keys::Counted { counter: PAIRS, args, first: inputs.at(PAIR_SORT), once };
        let bits = tile_bits(u64::from(tiles));
        let side = self.tile_sort.record(rec, keys, vals, inputs.counters, extent, bits)?;
        rec.fill(&self.tile_ranges, 0)?;
        let ranges: BufferSlice<'_> = (&self.tile_ranges).into();
        // The other side of the keys is free again.
        let slot_splat = self.slots.as_ref().map_or(vals[1 - side], |slots| slots.splat.slice());
        let bound = [keys[side], vals[side], slot_splat, count_words, keys[1 - side], ranges];
        rec.dispatch(&self.ranges, &bound, &tile_ranges::Push { tiles }, inputs.groups(PAIR_ITEMS))?;
        Ok(Lists {
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

    fn record_plan(&self, rec: &mut Recorder, inputs: &Inputs<'_>, push: plan::Push) -> Result<()> {
        rec.dispatch(&self.plan, &[inputs.counters, inputs.args], &push, Groups::Workgroups(1))
    }

    /// Pairs at most. The largest word stands for a count that is more than a word holds.
    fn pairs_that_fit(&self) -> u32 {
        u32::try_from(self.capacities.pairs).unwrap_or(u32::MAX).min(u32::MAX - 1)
    }
}

/// The visible splats in the order of their depth, and how many pairs the splats before each of them have.
#[derive(Clone, Copy)]
struct NearestFirst<'a> {
    order: BufferSlice<'a>,
    pair_offsets: BufferSlice<'a>,
}

impl<'a> Inputs<'a> {
    /// Splats, counts of tiles and counters.
    fn slices(&self) -> [BufferSlice<'a>; 3] {
        [self.splat2d, self.tile_counts, self.counters].map(Into::into)
    }

    /// The place in `args` of one of the entries.
    fn at(&self, entry: u32) -> u32 {
        self.first_entry + entry
    }

    /// The workgroups of one of the entries.
    fn groups(&self, entry: u32) -> Groups<'a> {
        Groups::Indirect(self.args, Entry::offset(self.at(entry)))
    }
}

/// Bits of a pair's key: of the numbers of all tiles and of the one after the last (see `emit`).
pub(crate) fn tile_bits(tiles: u64) -> u32 {
    (64 - tiles.leading_zeros()).min(32)
}

fn both(parts: &[BufferRange; 2]) -> [BufferSlice<'_>; 2] {
    [parts[0].slice(), parts[1].slice()]
}
