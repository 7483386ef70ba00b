//! Tile lists: for every tile, the splats on the tile in depth order.

mod global;
mod in_tiles;

use global::GlobalLists;
use in_tiles::ListsInTiles;

use super::memory_footprint::MemoryFootprint;
use super::scan::{self, Scan, ScanExtent, Summand};
use super::scratch_buffers::{ScratchBuffers, ScratchLayout};
use super::sort::SortShape;
use super::variants::ListSort;
use crate::pass::plan::{self, Entry, NO_COUNTER};
use crate::pass::{compact, counters};
use crate::scene::tile::TileGrid;
use crate::vk::{Buffer, BufferRange, BufferSlice, Error, Gpu, Groups, Memory, Pipeline, Recorder, Result};

/// Bits of a depth key. Depths are positive, so the sign bit is always 0.
pub(crate) const DEPTH_BITS: u32 = 31;
/// Workgroup size: splats, or pairs for `tile_ranges`.
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
const VISIBLE_SLOTS: u32 = 7;
const VISIBLE_ONCE: u32 = 8;
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
    plan: Pipeline,
    visible: VisibleSplats,
    order: Order,
    /// Most (splat, tile) pairs. The largest word is reserved for counts that overflow a word.
    pairs_that_fit: u32,
    depth_bits: u32,
    capacities: Capacities,
    tile_ranges: BufferRange,
}

/// How lists come into order.
enum Order {
    Global(Box<GlobalLists>),
    Tiles(Box<ListsInTiles>),
}

/// The list of the visible splats.
struct VisibleSplats {
    scan: Scan,
    compact: Pipeline,
    /// In index order, if used later by the optimiser or the sums of slots.
    listed: Option<BufferRange>,
    /// Whether the optimiser uses `listed`.
    optimised: bool,
    /// `None` without slots: pairs then carry the splat instead of the slot.
    slots: Option<SlotBuffers>,
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
    /// Slot data; `None` without slots.
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

/// Scratch memory for the list of the visible splats.
#[derive(Clone, Copy)]
struct VisibleScratch<'a> {
    /// Depth keys.
    keys: BufferSlice<'a>,
    /// The splats, unless they are kept in `listed`.
    splats: BufferSlice<'a>,
    places: BufferSlice<'a>,
}

impl TileLists {
    /// Allocates tile lists of the given capacities, with slots.
    pub fn new(gpu: &Gpu, capacities: Capacities, lists: ListSort) -> Result<TileLists> {
        TileLists::with_shape(gpu, capacities, lists, SortShape::of(gpu.caps()))
    }

    /// Like [`Self::new`], with a given shape of global sorts.
    pub fn with_shape(gpu: &Gpu, capacities: Capacities, lists: ListSort, shape: SortShape) -> Result<TileLists> {
        let early = gpu.buffer("lists", ScratchLayout::new(gpu, &capacities, lists, shape).bytes(), Memory::Device)?;
        let slot_splat = gpu.buffer("slot_splat", 4 * capacities.pairs.max(1), Memory::Device)?;
        let slot_splat = Some(BufferRange::whole(slot_splat));
        TileLists::within(gpu, capacities, lists, shape, ScratchBuffers { early: &early, slot_splat }, false)
    }

    /// Like [`Self::with_shape`], in lent scratch memory: see [`ScratchLayout`]. `listed` keeps the visible splats in
    /// index order for the optimiser.
    pub(super) fn within(
        gpu: &Gpu,
        capacities: Capacities,
        lists: ListSort,
        shape: SortShape,
        loan: ScratchBuffers<'_>,
        listed: bool,
    ) -> Result<TileLists> {
        let layout = ScratchLayout::new(gpu, &capacities, lists, shape);
        let with_slots = loan.slot_splat.is_some();
        let (order, tile_ranges) = match lists {
            ListSort::Global => {
                let ranges =
                    BufferRange::whole(gpu.buffer("tile_ranges", 8 * capacities.tiles.max(1), Memory::Device)?);
                let lists = GlobalLists::new(gpu, &capacities, shape, &layout, loan.early, with_slots)?;
                (Order::Global(Box::new(lists)), ranges)
            }
            ListSort::Tiles => {
                let (lists, ranges) = ListsInTiles::new(gpu, &capacities, &layout, loan.early, with_slots)?;
                (Order::Tiles(Box::new(lists)), ranges)
            }
        };
        Ok(TileLists {
            plan: gpu.pipeline(&plan::PASS.kernel, &[])?,
            visible: VisibleSplats::new(gpu, capacities.splats, loan.slot_splat, listed)?,
            order,
            pairs_that_fit: u32::try_from(capacities.pairs).unwrap_or(u32::MAX).min(u32::MAX - 1),
            depth_bits: DEPTH_BITS,
            capacities,
            tile_ranges,
        })
    }

    /// Bytes of the lists' own buffers, without lent memory.
    pub(super) fn held(&self) -> MemoryFootprint {
        let pixels = self.tile_ranges.slice().bytes();
        let of_order = match &self.order {
            Order::Global(lists) => lists.held(),
            Order::Tiles(lists) => lists.held(),
        };
        of_order + self.visible.held() + MemoryFootprint { pixels, ..MemoryFootprint::default() }
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
        self.visible.listed.as_ref().filter(|_| self.visible.optimised).map(|part| (part.slice(), groups))
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
        let sorted = match &self.order {
            Order::Global(lists) => lists.record(rec, self, &inputs, grid)?,
            Order::Tiles(lists) => lists.record(rec, self, &inputs, grid)?,
        };
        let slots = self.visible.slots.as_ref().zip(self.visible.listed.as_ref());
        Ok(FrameLists {
            slots: slots.map(|(slots, listed)| Slots {
                listed: listed.slice(),
                slot_offsets: slots.offsets.slice(),
                slot_splat: slots.splat.slice(),
                sorted_slots: sorted.slots,
            }),
            sorted_splats: sorted.splats,
            tile_ranges: self.tile_ranges.slice(),
            slot_sums: inputs.groups(VISIBLE_SLOTS),
        })
    }

    /// Plans passes over pairs if the pairs fit. Otherwise voids every planned dispatch, so that no later pass runs on
    /// incomplete lists.
    fn record_plan_of_pairs(&self, rec: &mut Recorder, inputs: &TileListInputs<'_>, of_pairs: &[Entry]) -> Result<()> {
        let push = plan::Push::unlimited(PAIRS, inputs.at(PAIR_SORT), of_pairs);
        let push = push.limited(self.pairs_that_fit, counters::PAIRS_BIT, counters::WANT_PAIRS as u32);
        self.record_plan(rec, inputs, push.voiding(inputs.entries))
    }

    fn record_plan(&self, rec: &mut Recorder, inputs: &TileListInputs<'_>, push: plan::Push) -> Result<()> {
        rec.dispatch(&self.plan, &[inputs.counters, inputs.args], &push, Groups::Workgroups(1))
    }
}

/// Pairs in (tile, depth) order.
struct SortedPairs<'a> {
    splats: BufferSlice<'a>,
    /// Meaningful only with slots.
    slots: BufferSlice<'a>,
}

impl VisibleSplats {
    fn new(gpu: &Gpu, splats: u64, slot_splat: Option<BufferRange>, optimised: bool) -> Result<Self> {
        let of_splats = |name| gpu.buffer(name, 4 * splats.max(1), Memory::Device).map(BufferRange::whole);
        Ok(Self {
            scan: Scan::new(gpu, "splat_scan", splats)?,
            compact: gpu.pipeline(&compact::PASS.kernel, &[])?,
            listed: (optimised || slot_splat.is_some()).then(|| of_splats("listed")).transpose()?,
            optimised,
            slots: slot_splat
                .map(|splat| Ok::<_, Error>(SlotBuffers { splat, offsets: of_splats("slot_offsets")? }))
                .transpose()?,
        })
    }

    fn held(&self) -> MemoryFootprint {
        let listed = self.listed.as_ref().map_or(0, |part| part.slice().bytes());
        let (of_optimiser, of_slots) = if self.optimised { (listed, 0) } else { (0, listed) };
        MemoryFootprint {
            splats: self.scan.bytes() + of_optimiser,
            slot_splats: of_slots + self.slots.as_ref().map_or(0, |slots| slots.offsets.slice().bytes()),
            ..MemoryFootprint::default()
        }
    }

    /// Lists the visible splats in index order, with the highest `depth_bits` bits of their depths, and computes the
    /// first slot of each splat.
    fn record(
        &self,
        rec: &mut Recorder,
        inputs: &TileListInputs<'_>,
        scratch: VisibleScratch<'_>,
        depth_bits: u32,
    ) -> Result<()> {
        let [splat2d, tile_counts, count_words] = inputs.slices();
        let extent = ScanExtent::counted(SPLATS, inputs.args, inputs.at(SPLAT_SCAN), inputs.at(SPLAT_ONCE));
        let (counts, to) = (inputs.counters, [tile_counts, scratch.places]);
        self.scan.record(rec, to, counts, extent, Summand::NonZero, VISIBLE)?;
        if let Some(slots) = &self.slots {
            let to = [tile_counts, slots.offsets.slice()];
            self.scan.record(rec, to, counts, extent, Summand::Words, NO_COUNTER)?;
        }
        let listed = self.listed.as_ref().map_or(scratch.splats, BufferRange::slice);
        let bound = [splat2d, tile_counts, scratch.places, count_words, scratch.keys, listed];
        let push = compact::Push { shift: DEPTH_BITS - depth_bits };
        rec.dispatch(&self.compact, &bound, &push, inputs.groups(SPLAT_ITEMS))
    }
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
