//! From projected splats to the depth-ordered list of splats of every tile.

use super::scan::{self, Extent, Scan, Summand};
use super::sort::{Keys, RadixSort, Shape};
use crate::pass::plan::{self, Entry};
use crate::pass::{compact, counters, emit, gather_counts, slot_sum, tile_ranges};
use crate::twin::tile::TileGrid;
use crate::vk::{Buffer, Gpu, Groups, Memory, Pipeline, Recorder, Result};

/// Bits of a depth key: depths are positive, so their sign bit is 0.
pub(crate) const DEPTH_BITS: u32 = 31;
/// Splats of a workgroup of `compact`, `gather_counts` and `emit`, pairs of one of `tile_ranges`.
const LOCAL_SIZE: u32 = 64;

/// Entries of `args` that [`TileLists`] uses, from the first one given on.
pub const ENTRIES: u32 = 13;

/// The first of these entries: they depend on the number of splats and are planned by the caller, whose own entries may too.
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
    capacities: Capacities,
    shape: Shape,
    plan: Pipeline,
    compact: Pipeline,
    gather_counts: Pipeline,
    emit: Pipeline,
    ranges: Pipeline,
    splat_scan: Scan,
    depth_sort: RadixSort,
    tile_sort: RadixSort,
    keys: [Buffer; 2],
    vals: [Buffer; 2],
    visible_counts: Buffer,
    pair_offsets: Buffer,
    pair_keys: [Buffer; 2],
    pair_vals: [Buffer; 2],
    slot_splat: Buffer,
    sorted_splats: Buffer,
    tile_ranges: Buffer,
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
}

/// The lists of one recorded frame.
#[derive(Clone, Copy)]
pub struct Lists<'a> {
    /// Visible splats in depth order (the first `counters.visible`).
    pub order: &'a Buffer,
    /// First slot of each visible splat in depth order.
    pub pair_offsets: &'a Buffer,
    /// Splat of each slot.
    pub slot_splat: &'a Buffer,
    /// Slot of each pair in (tile, depth) order.
    pub sorted_slots: &'a Buffer,
    /// Splat of each pair in (tile, depth) order.
    pub sorted_splats: &'a Buffer,
    /// [begin, end) of each tile's pairs.
    pub tile_ranges: &'a Buffer,
    /// Workgroups of `slot_sum` for the visible splats; none when the pairs do not fit.
    pub slot_sums: Groups<'a>,
}

impl TileLists {
    /// Allocates for the given sizes.
    pub fn new(gpu: &Gpu, capacities: Capacities) -> Result<TileLists> {
        TileLists::with_shape(gpu, capacities, Shape::of(gpu.caps()))
    }

    /// The same with the sort's shape given.
    pub fn with_shape(gpu: &Gpu, capacities: Capacities, shape: Shape) -> Result<TileLists> {
        let Capacities { splats, pairs, tiles } = capacities;
        let words = |name: &str, count: u64| gpu.buffer(name, 4 * count.max(1), Memory::Device);
        Ok(TileLists {
            capacities,
            shape,
            plan: gpu.pipeline(&plan::PASS.kernel, &[])?,
            compact: gpu.pipeline(&compact::PASS.kernel, &[])?,
            gather_counts: gpu.pipeline(&gather_counts::PASS.kernel, &[])?,
            emit: gpu.pipeline(&emit::PASS.kernel, &[])?,
            ranges: gpu.pipeline(&tile_ranges::PASS.kernel, &[])?,
            splat_scan: Scan::new(gpu, "splat_scan", splats)?,
            depth_sort: RadixSort::new(gpu, "depth_sort", shape, splats, DEPTH_BITS)?,
            tile_sort: RadixSort::new(gpu, "tile_sort", shape, pairs, tile_bits(tiles))?,
            keys: [words("keys0", splats)?, words("keys1", splats)?],
            vals: [words("vals0", splats)?, words("vals1", splats)?],
            visible_counts: words("visible_counts", splats)?,
            pair_offsets: words("pair_offsets", splats)?,
            pair_keys: [words("pair_keys0", pairs)?, words("pair_keys1", pairs)?],
            pair_vals: [words("pair_vals0", pairs)?, words("pair_vals1", pairs)?],
            slot_splat: words("slot_splat", pairs)?,
            sorted_splats: words("sorted_splats", pairs)?,
            tile_ranges: words("tile_ranges", 2 * tiles)?,
        })
    }

    /// What was allocated for.
    pub fn capacities(&self) -> Capacities {
        self.capacities
    }

    /// Records the passes for an image of `grid`, with at most as many tiles as were allocated for.
    /// `counters.splats` says how many splats there are; `visible` and `pairs` are written. With more pairs than fit, `status`
    /// gets its bit and nothing is emitted.
    pub fn record<'a>(&'a self, rec: &mut Recorder, inputs: Inputs<'a>, grid: &TileGrid) -> Result<Lists<'a>> {
        let Inputs { splat2d, tile_counts, counters: counts, args, first_entry, entries } = inputs;
        let [columns, rows] = grid.counts();
        let tiles = columns * rows;
        let at = |entry: u32| first_entry + entry;
        let indirect = |entry: u32| Groups::Indirect(args, Entry::offset(at(entry)));
        let plan = |rec: &mut Recorder, push: plan::Push| {
            rec.dispatch(&self.plan, &[counts, args], &push, Groups::Workgroups(1))
        };
        let (splats, visible, pairs) = (counters::SPLATS as u32, counters::VISIBLE as u32, counters::PAIRS as u32);
        let once = Entry::fixed(1);
        let items = Entry::items(LOCAL_SIZE);

        // Visible splats in the order of their index; pair_offsets serves as scratch for their places.
        let extent = Extent::counted(splats, args, at(SPLAT_SCAN), at(SPLAT_ONCE));
        let places = &self.pair_offsets;
        self.splat_scan.record(rec, [tile_counts, places], counts, extent, Summand::NonZero, visible)?;
        let bound = [splat2d, tile_counts, places, counts, &self.keys[0], &self.vals[0]];
        rec.dispatch(&self.compact, &bound, &(), indirect(SPLAT_ITEMS))?;

        // In the order of their depth, with the first slot of each.
        let [sort, table] = self.shape.entries(DEPTH_BITS);
        let slot_sums = Entry::items(slot_sum::SPLATS_PER_WORKGROUP);
        let of_visible = [sort, table, scan::entry(), items, once, slot_sums];
        plan(rec, plan::Push::unlimited(visible, at(VISIBLE_SORT), &of_visible))?;
        let extent = Keys::Counted { counter: visible, args, first: at(VISIBLE_SORT), once: at(VISIBLE_ONCE) };
        let side = self.depth_sort.record(rec, both(&self.keys), both(&self.vals), counts, extent, DEPTH_BITS)?;
        let order = &self.vals[side];
        let bound = [order, tile_counts, counts, &self.visible_counts];
        rec.dispatch(&self.gather_counts, &bound, &(), indirect(VISIBLE_ITEMS))?;
        let extent = Extent::counted(visible, args, at(VISIBLE_SCAN), at(VISIBLE_ONCE));
        let sides = [&self.visible_counts, &self.pair_offsets];
        self.splat_scan.record(rec, sides, counts, extent, Summand::Words, pairs)?;

        // Pairs, if they fit. If not, everything planned so far is void too: what follows must not run on them.
        let bits = tile_bits(u64::from(tiles));
        let [sort, table] = self.shape.entries(bits);
        let capacity = u32::try_from(self.capacities.pairs).unwrap_or(u32::MAX);
        let push = plan::Push::unlimited(pairs, at(PAIR_SORT), &[sort, table, items, once]);
        let push = push.limited(capacity, counters::PAIRS_BIT, counters::WANT_PAIRS as u32);
        plan(rec, push.voiding(entries))?;
        let push = emit::Push {
            width: grid.image[0],
            height: grid.image[1],
            tile_width: grid.tile[0],
            tile_height: grid.tile[1],
            capacity,
        };
        let bound = [
            splat2d,
            tile_counts,
            order,
            &self.pair_offsets,
            counts,
            &self.pair_keys[0],
            &self.pair_vals[0],
            &self.slot_splat,
        ];
        rec.dispatch(&self.emit, &bound, &push, indirect(VISIBLE_ITEMS))?;

        // In the order of their tile; the sort is stable, so by depth within each.
        let extent = Keys::Counted { counter: pairs, args, first: at(PAIR_SORT), once: at(PAIR_ONCE) };
        let (keys, vals) = (both(&self.pair_keys), both(&self.pair_vals));
        let side = self.tile_sort.record(rec, keys, vals, counts, extent, bits)?;
        rec.fill(&self.tile_ranges, 0)?;
        let bound = [keys[side], vals[side], &self.slot_splat, counts, &self.sorted_splats, &self.tile_ranges];
        rec.dispatch(&self.ranges, &bound, &tile_ranges::Push { tiles }, indirect(PAIR_ITEMS))?;
        Ok(Lists {
            order,
            pair_offsets: &self.pair_offsets,
            slot_splat: &self.slot_splat,
            sorted_slots: vals[side],
            sorted_splats: &self.sorted_splats,
            tile_ranges: &self.tile_ranges,
            slot_sums: indirect(VISIBLE_SLOTS),
        })
    }
}

/// Bits of a pair's key: of the numbers of all tiles and of the one after the last (see `emit`).
pub(crate) fn tile_bits(tiles: u64) -> u32 {
    (64 - tiles.leading_zeros()).min(32)
}

fn both(buffers: &[Buffer; 2]) -> [&Buffer; 2] {
    [&buffers[0], &buffers[1]]
}
