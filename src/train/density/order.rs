//! Sorts new rows into Morton order, so that splats that are neighbours in space are neighbours in memory.

use std::ops::Range;

use super::{DensityModel, Scratch};
use crate::pass::densify_order::{self as pass, CODE_BITS, CodesPush, Push};
use crate::pass::plan::Entry;
use crate::pass::{Pass, counters};
use crate::raster::sort::{KeyCount, SortMemory, SortPasses, SortShape};
use crate::vk::{BufferSlice, Gpu, Groups, Pipeline, Recorder, Result, slices};

/// Bits of an identity.
const ID_BITS: u32 = 32;

/// Passes that sort splats by birth (identity) and into Morton order.
pub(super) struct Ordering {
    shape: SortShape,
    sort: SortPasses,
    births: Pipeline,
    flags: Pipeline,
    codes: Pipeline,
    order: Pipeline,
    scale: f32,
    capacity: u32,
    alignment: u64,
}

/// The splats of a model in the order of birth, and memory for later passes; all of it in [`Scratch::rows`], which is
/// otherwise used only when planes are moved:
///
/// | bytes of `rows`, per splat | until the flags are in order | later |
/// |---|---|---|
/// | 8 | sort by identity: keys | identities by birth, and one side of the ranks by birth |
/// | 8 | sort by identity: rows | rows by birth, and the other side |
/// | 2 (with digits of 8 bits) | tables of both sorts | tables of both sorts |
/// | 16 | flags by row | map and identities of the new rows by birth; codes, two sides |
#[derive(Clone, Copy)]
pub(super) struct ByBirth<'a> {
    /// Identities, ascending.
    pub(super) ids: BufferSlice<'a>,
    /// Row of each identity.
    row_of: BufferSlice<'a>,
    /// Flags by row.
    pub(super) flags: BufferSlice<'a>,
    /// Map of the new rows in the order of birth. Sources are ranks in the order of birth.
    pub(super) map: BufferSlice<'a>,
    /// Identities of the new rows.
    pub(super) new_ids: BufferSlice<'a>,
    codes: [BufferSlice<'a>; 2],
    births: [BufferSlice<'a>; 2],
    tables: [BufferSlice<'a>; 2],
}

/// Byte ranges of the parts.
struct OrderLayout {
    keys: [Range<u64>; 2],
    vals: [Range<u64>; 2],
    tables: [Range<u64>; 2],
    flags: Range<u64>,
    map: Range<u64>,
    new_ids: Range<u64>,
    codes: [Range<u64>; 2],
}

impl OrderLayout {
    fn new(shape: SortShape, capacity: u32, alignment: u64) -> Self {
        let word = 4 * u64::from(capacity);
        let table = 4 * shape.table_words(u64::from(capacity), ID_BITS);
        let place = |end: &mut u64, bytes: u64| {
            let begin = end.next_multiple_of(alignment);
            *end = begin + bytes;
            begin..*end
        };
        let two = |end: &mut u64, bytes: u64| [place(end, bytes), place(end, bytes)];
        let mut end = 0;
        let (keys, vals, tables) = (two(&mut end, word), two(&mut end, word), two(&mut end, table));
        // The flags by row are no longer needed when the parts that share their memory are written.
        let mut over = end;
        let flags = place(&mut end, 4 * word);
        let (map, new_ids, codes) = (place(&mut over, word), place(&mut over, word), two(&mut over, word));
        Self { keys, vals, tables, flags, map, new_ids, codes }
    }
}

impl Ordering {
    /// For models with room for `capacity` splats in a scene of the given extent.
    pub(super) fn new(gpu: &Gpu, capacity: u32, extent: f64, shape: SortShape) -> Result<Self> {
        let pipeline = |pass: &Pass| gpu.pipeline(&pass.kernel, &[]);
        Ok(Self {
            shape,
            sort: SortPasses::new(gpu, "densify_order", shape, u64::from(capacity), ID_BITS)?,
            births: pipeline(&pass::BIRTHS)?,
            flags: pipeline(&pass::FLAGS)?,
            codes: pipeline(&pass::CODES)?,
            order: pipeline(&pass::ORDER)?,
            // Cells are smallest within 2 scene units of the centre (cameras are within 5), and reach to 30.
            scale: (2.5 / extent) as f32,
            capacity,
            alignment: gpu.caps().limits.storage_alignment,
        })
    }

    /// Bytes of the buffers, without lent memory.
    pub(super) fn bytes(&self) -> u64 {
        self.sort.bytes()
    }

    /// The entries of `args` for the sort of the new rows: two that follow the counter of rows, and one of one
    /// workgroup.
    pub(super) fn entries(shape: SortShape) -> [Entry; 3] {
        let [sort, table] = shape.entries(CODE_BITS);
        [sort, table, Entry::fixed(1)]
    }

    /// Records the sort of the model's splats by identity.
    pub(super) fn record_births<'a>(&self, rec: &mut Recorder, model: &DensityModel<'a>) -> Result<ByBirth<'a>> {
        let Scratch { rows, .. } = model.scratch;
        let layout = OrderLayout::new(self.shape, self.capacity, self.alignment);
        let [keys, vals, tables, codes] =
            [layout.keys, layout.vals, layout.tables, layout.codes].map(|two| two.map(|range| rows.slice(range)));
        let [flags, map, new_ids] = [layout.flags, layout.map, layout.new_ids].map(|range| rows.slice(range));
        let [counts, ids] = slices([model.counters, model.ids]);
        let push = Push { stride: self.capacity };
        rec.dispatch(&self.births, &[counts, ids, keys[0], vals[0]], &push, self.all())?;
        let memory = SortMemory { tables, keys, vals, apart: None };
        let side = self.sort.record(rec, memory, model.counters, KeyCount::Host(self.capacity), ID_BITS)?;
        Ok(ByBirth {
            ids: keys[side],
            row_of: vals[side],
            flags,
            map,
            new_ids,
            codes,
            births: [keys[1 - side], vals[1 - side]],
            tables,
        })
    }

    /// Records the permutation of flags from the order of rows to the order of birth.
    pub(super) fn record_flags(&self, rec: &mut Recorder, sorted: &ByBirth<'_>, flags: BufferSlice<'_>) -> Result<()> {
        let push = Push { stride: self.capacity };
        rec.dispatch(&self.flags, &[sorted.row_of, sorted.flags, flags], &push, self.all())
    }

    /// Records the sort of the new rows into Morton order: the map and identities of the new rows are permuted from the
    /// order of birth to that of rows. Expects planned workgroups at entry `first` of `args` and [`Self::entries`]
    /// after it.
    pub(super) fn record_rows(
        &self,
        rec: &mut Recorder,
        sorted: &ByBirth<'_>,
        model: &DensityModel<'_>,
        map: BufferSlice<'_>,
        first: u32,
    ) -> Result<()> {
        let [counts, means, ids]: [BufferSlice<'_>; 3] =
            slices([model.counters, &model.planes[super::MEANS], model.ids]);
        let rows = Groups::Indirect(model.args, Entry::offset(first));
        let bound = [counts, sorted.row_of, means, sorted.map, sorted.codes[0], sorted.births[0]];
        rec.dispatch(&self.codes, &bound, &CodesPush { scale: self.scale }, rows)?;
        let counter = counters::SCAN_TOTAL as u32;
        let extent = KeyCount::Counted { counter, args: model.args, first: first + 1, once: first + 3 };
        let memory = SortMemory { tables: sorted.tables, keys: sorted.codes, vals: sorted.births, apart: None };
        let side = self.sort.record(rec, memory, model.counters, extent, CODE_BITS)?;
        let bound = [counts, sorted.births[side], sorted.map, sorted.new_ids, map, ids];
        rec.dispatch(&self.order, &bound, &(), rows)
    }

    fn all(&self) -> Groups<'static> {
        Groups::Items(u64::from(self.capacity))
    }
}

#[cfg(test)]
mod tests {
    use super::super::{SCRATCH_BYTES, SCRATCH_LEAST};
    use super::*;

    #[test]
    fn everything_fits_the_lent_memory() {
        for shape in [SortShape::Runs, SortShape::Groups] {
            for alignment in [4, 16, 64, 256] {
                let around = [1_023, 1_024, 1_025, 2_049, 100_000, 5_000_001, 80_000_000];
                for capacity in (1..600).chain(around) {
                    let OrderLayout { keys, vals, tables, flags, map, new_ids, codes } =
                        OrderLayout::new(shape, capacity, alignment);
                    let lent = (SCRATCH_BYTES * u64::from(capacity)).max(SCRATCH_LEAST);
                    let fixed = keys.iter().chain(&vals).chain(&tables);
                    let after = [&map, &new_ids, &codes[0], &codes[1]];
                    for range in fixed.clone().chain([&flags]).chain(after) {
                        assert!(range.end <= lent && range.start.is_multiple_of(alignment), "{capacity}: {range:?}");
                    }
                    let begins = fixed.map(|r| r.end).max().unwrap();
                    assert!(flags.start >= begins && map.start >= begins && map.end <= new_ids.start);
                }
            }
        }
    }
}
