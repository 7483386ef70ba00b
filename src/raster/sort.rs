//! Stable radix sort of (key, value) words on the device, least significant digit first.

use std::fmt;

use super::scan::{BLOCK as SCAN_BLOCK, Extent, Scan, Summand};
use crate::pass::Pass;
use crate::pass::plan::{Entry, NO_COUNTER};
use crate::pass::radix::{self as pass, Push};
use crate::vk::{
    Buffer, BufferRange, BufferSlice, Caps, DeviceKind, Gpu, Groups, Memory, Pipeline, Recorder, Result, Subgroup,
};

/// How the passes split their work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// A thread owns a run of keys: for CPU devices, where shared memory and barriers are dear,
    /// and where there is little of it.
    Runs,
    /// A workgroup owns a block of keys: for GPUs.
    Groups,
    /// The same with blocks twice as long, for many keys.
    LongGroups,
}

/// Keys from which blocks are long: with fewer, more workgroups are worth more than longer stretches to write to.
const MANY: u64 = 4 << 20;

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Shape::Runs => "runs",
            Shape::Groups => "groups",
            Shape::LongGroups => "long groups",
        })
    }
}

impl Shape {
    /// The shape for a device and up to `most` keys.
    pub fn of(caps: &Caps, most: u64) -> Shape {
        let room = |shape: Shape| {
            let Kernels { scatter, width, .. } = Kernels::of(shape, caps.subgroup);
            let given = [&shape.items(), width.as_slice()].concat();
            caps.limits.workgroup_size >= pass::GROUPS_LOCAL_SIZE && scatter.kernel.fits(&caps.limits, &given)
        };
        if caps.kind == DeviceKind::Cpu || !room(Shape::Groups) {
            Shape::Runs
        } else if most < MANY || !room(Shape::LongGroups) {
            Shape::Groups
        } else {
            Shape::LongGroups
        }
    }

    /// Keys in a block, a column of the table of digit counts.
    pub const fn block(self) -> u32 {
        match self {
            Shape::Runs => pass::RUNS_BLOCK,
            Shape::Groups => pass::GROUPS_LOCAL_SIZE * pass::GROUPS_ITEMS,
            Shape::LongGroups => pass::GROUPS_LOCAL_SIZE * pass::GROUPS_ITEMS_OF_MANY,
        }
    }

    /// The constant of keys per thread, where it is not its default.
    fn items(self) -> Vec<(&'static str, u32)> {
        if self == Shape::LongGroups { vec![("ITEMS", pass::GROUPS_ITEMS_OF_MANY)] } else { Vec::new() }
    }

    /// Keys covered by one workgroup.
    pub const fn keys_per_group(self) -> u32 {
        match self {
            Shape::Runs => pass::RUNS_BLOCK * pass::RUNS_LOCAL_SIZE,
            Shape::Groups | Shape::LongGroups => self.block(),
        }
    }

    /// The digits of a sort by the lowest `bits` bits: as few as the shape allows, all of the same width but for the
    /// bits that the last one leaves out.
    pub fn digits(self, bits: u32) -> Digits {
        let bits = bits.min(32);
        let passes = bits.div_ceil(pass::MOST_BITS);
        Digits { bits, passes, width: bits.div_ceil(passes.max(1)) }
    }

    /// Words of the table that sorts of up to `most` keys by up to `bits` bits need.
    pub(crate) fn table_words(self, most: u64, bits: u32) -> u64 {
        // Fewer bits may mean wider digits: 17 are three of 6, 16 are two of 8.
        let rows = (0..=bits).map(|bits| self.digits(bits).rows()).max().unwrap_or(1);
        let sums = if self == Shape::Runs { 0 } else { rows };
        most.div_ceil(u64::from(self.block())).max(1) * u64::from(rows) + u64::from(sums)
    }

    /// The entries of `args` for a sort by `bits` bits of as many keys as a counter says: the passes,
    /// the prefix sums of the table.
    pub fn entries(self, bits: u32) -> [Entry; 2] {
        let rows = self.digits(bits).rows();
        let table = match self {
            Shape::Runs => Entry { divide: self.block(), multiply: rows, items: SCAN_BLOCK },
            Shape::Groups | Shape::LongGroups => Entry::fixed(rows),
        };
        [Entry::items(self.keys_per_group()), table]
    }
}

/// The digits of a sort.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Digits {
    bits: u32,
    /// Number of digits.
    pub passes: u32,
    /// Bits of a digit.
    pub width: u32,
}

impl Digits {
    /// Values of a digit: rows of the table.
    pub fn rows(self) -> u32 {
        1 << self.width
    }

    /// The ping-pong side that holds the result when side 0 held the input.
    pub fn side(self) -> usize {
        (self.passes % 2) as usize
    }

    fn shift_and_mask(self, digit: u32) -> (u32, u32) {
        let shift = digit * self.width;
        (shift, (1 << self.width.min(self.bits - shift)) - 1)
    }
}

/// How many keys there are.
#[derive(Clone, Copy, Debug)]
pub enum Keys<'a> {
    /// A number that the host knows.
    Host(u32),
    /// As many as a counter says.
    Counted {
        /// The counter.
        counter: u32,
        /// Workgroup numbers.
        args: &'a Buffer,
        /// The entry of the two of [`Shape::entries`].
        first: u32,
        /// An entry of [`Entry::fixed`]`(1)`.
        once: u32,
    },
}

/// What a sort works in: two sides each, of which the first holds the input.
#[derive(Clone, Copy)]
pub(crate) struct SortMemory<'a> {
    /// Digit counts, and their places: [`Shape::table_words`] each.
    pub(crate) tables: [BufferSlice<'a>; 2],
    /// Keys.
    pub(crate) keys: [BufferSlice<'a>; 2],
    /// Values.
    pub(crate) vals: [BufferSlice<'a>; 2],
    /// The values of the input, where these are to stay.
    pub(crate) apart: Option<BufferSlice<'a>>,
}

/// The passes of a sort, for tables of digit counts that somebody lends.
pub(crate) struct SortPasses {
    shape: Shape,
    count: Pipeline,
    sums: Sums,
    scatter: Pipeline,
}

/// What makes places of digit counts.
enum Sums {
    /// The prefix sum of the table.
    Whole(Scan),
    /// Those of its rows.
    Rows(Pipeline),
}

impl SortPasses {
    /// For up to `most` keys of up to `bits` bits. `name` is the owner's, for the buffer of the prefix sum.
    pub(crate) fn new(gpu: &Gpu, name: &str, shape: Shape, most: u64, bits: u32) -> Result<SortPasses> {
        let Kernels { count, rows, scatter, width } = Kernels::of(shape, gpu.caps().subgroup);
        let (items, width) = (shape.items(), width.as_slice());
        let sums = match rows {
            None => Sums::Whole(Scan::new(gpu, name, shape.table_words(most, bits))?),
            Some((rows, width)) => Sums::Rows(gpu.pipeline(&rows.kernel, &[&items, width.as_slice()].concat())?),
        };
        Ok(SortPasses {
            shape,
            count: gpu.pipeline(&count.kernel, &items)?,
            sums,
            scatter: gpu.pipeline(&scatter.kernel, &[&items, width].concat())?,
        })
    }

    /// Bytes of its own buffers.
    pub(crate) fn bytes(&self) -> u64 {
        match &self.sums {
            Sums::Whole(scan) => scan.bytes(),
            Sums::Rows(_) => 0,
        }
    }

    /// Sorts `keys[0]` and `vals[0]` by the lowest `bits` bits of the keys; returns the side that holds the result.
    /// Values that are given apart take the place of `vals[0]` and stay as they are.
    pub(crate) fn record(
        &self,
        rec: &mut Recorder,
        memory: SortMemory<'_>,
        counters: &Buffer,
        extent: Keys<'_>,
        bits: u32,
    ) -> Result<usize> {
        let SortMemory { tables: [table_words, places], keys, vals, apart } = memory;
        let digits = self.shape.digits(bits);
        let block = self.shape.block();
        let (source, number, groups, rows, table) = match extent {
            Keys::Host(n) => {
                let groups = Groups::Workgroups(u64::from(n.div_ceil(self.shape.keys_per_group())));
                let words = n.div_ceil(block).saturating_mul(digits.rows());
                (NO_COUNTER, n, groups, Groups::Workgroups(u64::from(digits.rows())), Extent::host(words))
            }
            Keys::Counted { counter, args, first, once } => {
                let table = Extent {
                    divide: block,
                    multiply: digits.rows(),
                    ..Extent::counted(counter, args, first + 1, once)
                };
                let at = |entry| Groups::Indirect(args, Entry::offset(entry));
                (counter, 0, at(first), at(first + 1), table)
            }
        };
        let counts: BufferSlice<'_> = counters.into();
        for digit in 0..digits.passes {
            let (from, to) = ((digit % 2) as usize, (digit as usize + 1) % 2);
            let (shift, mask) = digits.shift_and_mask(digit);
            let push = Push { source, count: number, shift, mask, digits: digits.rows() };
            rec.dispatch(&self.count, &[keys[from], counts, table_words], &push, groups)?;
            match &self.sums {
                Sums::Whole(scan) => {
                    scan.record(rec, [table_words, places], counters, table, Summand::Words, NO_COUNTER)?;
                }
                Sums::Rows(pass) => rec.dispatch(pass, &[counts, table_words, places], &push, rows)?,
            }
            let given = apart.filter(|_| digit == 0).unwrap_or(vals[from]);
            let bound = [keys[from], given, counts, places, keys[to], vals[to]];
            rec.dispatch(&self.scatter, &bound, &push, groups)?;
        }
        Ok(digits.side())
    }
}

/// The passes of a shape, with what is given for their constants beside [`Shape::items`].
struct Kernels {
    count: &'static Pass,
    /// Of the groups shape.
    rows: Option<(&'static Pass, Option<(&'static str, u32)>)>,
    scatter: &'static Pass,
    width: Option<(&'static str, u32)>,
}

impl Kernels {
    fn of(shape: Shape, subgroup: Subgroup) -> Kernels {
        match (shape, subgroup) {
            (Shape::Runs, _) => {
                Kernels { count: &pass::COUNT_RUNS, rows: None, scatter: &pass::SCATTER_RUNS, width: None }
            }
            (_, Subgroup::Hardware(width)) => Kernels {
                count: &pass::COUNT_GROUPS,
                rows: Some((&pass::ROWS, None)),
                scatter: &pass::SCATTER_GROUPS,
                width: Some(("WIDTH", width)),
            },
            (_, Subgroup::Emulated(width)) => {
                let width = Some(("EMULATED_WIDTH", width));
                let rows = Some((&pass::ROWS_EMULATED, width));
                Kernels { count: &pass::COUNT_GROUPS, rows, scatter: &pass::SCATTER_GROUPS_EMULATED, width }
            }
        }
    }
}

/// The passes with tables of their own.
pub struct RadixSort {
    passes: SortPasses,
    /// Digit counts, and their places.
    tables: [BufferRange; 2],
}

impl RadixSort {
    /// For up to `most` keys of up to `bits` bits. `name` is the owner's, for the buffers.
    pub fn new(gpu: &Gpu, name: &str, shape: Shape, most: u64, bits: u32) -> Result<RadixSort> {
        let words = shape.table_words(most, bits);
        let table =
            |what: &str| gpu.buffer(&format!("{name}.{what}"), 4 * words, Memory::Device).map(BufferRange::whole);
        RadixSort::within(gpu, name, shape, most, bits, [table("table")?, table("places")?])
    }

    /// The same with the memory of the tables given: [`Shape::table_words`] each.
    pub(super) fn within(
        gpu: &Gpu,
        name: &str,
        shape: Shape,
        most: u64,
        bits: u32,
        tables: [BufferRange; 2],
    ) -> Result<RadixSort> {
        Ok(RadixSort { passes: SortPasses::new(gpu, name, shape, most, bits)?, tables })
    }

    /// Bytes of its own buffers, the tables aside.
    pub(super) fn bytes(&self) -> u64 {
        self.passes.bytes()
    }

    /// Sorts `keys[0]` and `vals[0]` by the lowest `bits` bits of the keys; returns the side that holds the result.
    pub fn record<'b, B: Into<BufferSlice<'b>>>(
        &self,
        rec: &mut Recorder,
        keys: [B; 2],
        vals: [B; 2],
        counters: &Buffer,
        extent: Keys<'_>,
        bits: u32,
    ) -> Result<usize> {
        let of = Unsorted { keys: keys.map(Into::into), vals: vals.map(Into::into), apart: None };
        self.record_from(rec, of, counters, extent, bits)
    }

    /// The same of what is given together, whose values may be apart.
    pub(super) fn record_from(
        &self,
        rec: &mut Recorder,
        of: Unsorted<'_>,
        counters: &Buffer,
        extent: Keys<'_>,
        bits: u32,
    ) -> Result<usize> {
        let Unsorted { keys, vals, apart } = of;
        let tables = [self.tables[0].slice(), self.tables[1].slice()];
        self.passes.record(rec, SortMemory { tables, keys, vals, apart }, counters, extent, bits)
    }
}

/// Keys and values to be sorted, with as much room beside each.
#[derive(Clone, Copy)]
pub(super) struct Unsorted<'a> {
    pub(super) keys: [BufferSlice<'a>; 2],
    pub(super) vals: [BufferSlice<'a>; 2],
    /// The values of the input, where they are not in `vals[0]`: they stay as they are.
    pub(super) apart: Option<BufferSlice<'a>>,
}

#[cfg(test)]
mod tests {
    use super::Shape;

    #[test]
    fn digits_cover_every_bit_once() {
        for shape in [Shape::Runs, Shape::Groups, Shape::LongGroups] {
            for bits in 0..=32 {
                let digits = shape.digits(bits);
                let covered = (0..digits.passes).fold(0u64, |seen, digit| {
                    let (shift, mask) = digits.shift_and_mask(digit);
                    assert!(mask < digits.rows() && seen & (u64::from(mask) << shift) == 0, "{shape:?} {bits}");
                    seen | u64::from(mask) << shift
                });
                assert_eq!(covered, (1u64 << bits) - 1, "{shape:?} {bits}");
            }
        }
    }
}
