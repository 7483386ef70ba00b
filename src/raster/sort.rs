//! Stable radix sort of (key, value) words on the device, least significant digit first.

use std::fmt;

use super::scan::{BLOCK as SCAN_BLOCK, Scan, ScanExtent, Summand};
use crate::pass::Pass;
use crate::pass::plan::{Entry, NO_COUNTER};
use crate::pass::radix::{self as pass, Push};
use crate::vk::{
    Buffer, BufferRange, BufferSlice, Caps, DeviceKind, Gpu, Groups, Memory, Pipeline, Recorder, Result, Subgroup,
};

/// How the passes divide the keys among threads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SortShape {
    /// A thread owns a run of keys. For CPU devices, where shared memory and barriers are slow, and for devices with
    /// little shared memory.
    Runs,
    /// A workgroup owns a block of keys. For GPUs.
    Groups,
}

impl fmt::Display for SortShape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            SortShape::Runs => "runs",
            SortShape::Groups => "groups",
        })
    }
}

impl SortShape {
    /// The best shape for a device.
    pub fn of(caps: &Caps) -> SortShape {
        let Kernels { scatter, width, .. } = Kernels::of(SortShape::Groups, caps.subgroup);
        let room = caps.limits.workgroup_size >= pass::GROUPS_LOCAL_SIZE
            && scatter.kernel.fits(&caps.limits, width.as_slice());
        if caps.kind == DeviceKind::Cpu || !room { SortShape::Runs } else { SortShape::Groups }
    }

    /// Keys in a block. Each block has a column in the table of digit counts.
    pub const fn block(self) -> u32 {
        match self {
            SortShape::Runs => pass::RUNS_BLOCK,
            SortShape::Groups => pass::GROUPS_LOCAL_SIZE * pass::GROUPS_ITEMS,
        }
    }

    /// Keys covered by one workgroup.
    pub const fn keys_per_group(self) -> u32 {
        match self {
            SortShape::Runs => pass::RUNS_BLOCK * pass::RUNS_LOCAL_SIZE,
            SortShape::Groups => self.block(),
        }
    }

    /// The digits of a sort by the lowest `bits` bits: as few digits as possible, of equal width; the last digit may
    /// have unused bits.
    pub fn digits(self, bits: u32) -> Digits {
        let bits = bits.min(32);
        let passes = bits.div_ceil(pass::MOST_BITS);
        Digits { bits, passes, width: bits.div_ceil(passes.max(1)) }
    }

    /// Words of the digit-count table for sorts of up to `most` keys by up to `bits` bits.
    pub(crate) fn table_words(self, most: u64, bits: u32) -> u64 {
        // Fewer bits may mean wider digits: 17 bits are three digits of 6 bits, 16 bits are two digits of 8 bits.
        let rows = (0..=bits).map(|bits| self.digits(bits).rows()).max().unwrap_or(1);
        let sums = if self == SortShape::Runs { 0 } else { rows };
        most.div_ceil(u64::from(self.block())).max(1) * u64::from(rows) + u64::from(sums)
    }

    /// The entries of `args` for a sort by `bits` bits, with the number of keys in a counter: the entry of the passes
    /// over keys, and the entry of the prefix sums of the table.
    pub fn entries(self, bits: u32) -> [Entry; 2] {
        let rows = self.digits(bits).rows();
        let table = match self {
            SortShape::Runs => Entry { divide: self.block(), multiply: rows, items: SCAN_BLOCK },
            SortShape::Groups => Entry::fixed(rows),
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
    /// Number of values of a digit: the rows of the table.
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

/// Number of keys to sort.
#[derive(Clone, Copy, Debug)]
pub enum KeyCount<'a> {
    /// Known to the host.
    Host(u32),
    /// Held by a counter on the device.
    Counted {
        /// Index of the counter.
        counter: u32,
        /// Indirect workgroup counts.
        args: &'a Buffer,
        /// Index of the first of the two entries of [`SortShape::entries`].
        first: u32,
        /// Index of an entry of [`Entry::fixed`]`(1)`.
        once: u32,
    },
}

/// Memory of a sort: two sides each for keys and values. Side 0 holds the input.
#[derive(Clone, Copy)]
pub(crate) struct SortMemory<'a> {
    /// Digit counts and their prefix sums, [`SortShape::table_words`] words each.
    pub(crate) tables: [BufferSlice<'a>; 2],
    /// Keys.
    pub(crate) keys: [BufferSlice<'a>; 2],
    /// Values.
    pub(crate) vals: [BufferSlice<'a>; 2],
    /// Input values to read instead of `vals[0]`, which the sort keeps unchanged.
    pub(crate) apart: Option<BufferSlice<'a>>,
}

/// The passes of a sort, without memory for the tables of digit counts.
pub(crate) struct SortPasses {
    shape: SortShape,
    count: Pipeline,
    sums: Sums,
    scatter: Pipeline,
}

/// How the prefix sums of digit counts are computed.
enum Sums {
    /// One prefix sum over the whole table.
    Whole(Scan),
    /// One prefix sum per row.
    Rows(Pipeline),
}

impl SortPasses {
    /// Creates passes for up to `most` keys of up to `bits` bits. `name` begins the name of the prefix sum's buffer.
    pub(crate) fn new(gpu: &Gpu, name: &str, shape: SortShape, most: u64, bits: u32) -> Result<SortPasses> {
        let Kernels { count, rows, scatter, width } = Kernels::of(shape, gpu.caps().subgroup);
        let sums = match rows {
            None => Sums::Whole(Scan::new(gpu, name, shape.table_words(most, bits))?),
            Some((rows, width)) => Sums::Rows(gpu.pipeline(&rows.kernel, width.as_slice())?),
        };
        Ok(SortPasses {
            shape,
            count: gpu.pipeline(&count.kernel, &[])?,
            sums,
            scatter: gpu.pipeline(&scatter.kernel, width.as_slice())?,
        })
    }

    /// Bytes of the prefix sum's buffer.
    pub(crate) fn bytes(&self) -> u64 {
        match &self.sums {
            Sums::Whole(scan) => scan.bytes(),
            Sums::Rows(_) => 0,
        }
    }

    /// Sorts `keys[0]` and `vals[0]` by the lowest `bits` bits of the keys. Returns the side that holds the result.
    /// With `apart`, reads the values there instead of from `vals[0]`.
    pub(crate) fn record(
        &self,
        rec: &mut Recorder,
        memory: SortMemory<'_>,
        counters: &Buffer,
        extent: KeyCount<'_>,
        bits: u32,
    ) -> Result<usize> {
        let SortMemory { tables: [table_words, places], keys, vals, apart } = memory;
        let digits = self.shape.digits(bits);
        let block = self.shape.block();
        let (source, number, groups, rows, table) = match extent {
            KeyCount::Host(n) => {
                let groups = Groups::Workgroups(u64::from(n.div_ceil(self.shape.keys_per_group())));
                let words = n.div_ceil(block).saturating_mul(digits.rows());
                (NO_COUNTER, n, groups, Groups::Workgroups(u64::from(digits.rows())), ScanExtent::host(words))
            }
            KeyCount::Counted { counter, args, first, once } => {
                let table = ScanExtent {
                    divide: block,
                    multiply: digits.rows(),
                    ..ScanExtent::counted(counter, args, first + 1, once)
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

/// The passes of a shape, with a constant for the width of subgroups.
struct Kernels {
    count: &'static Pass,
    /// Only for `Groups`.
    rows: Option<(&'static Pass, Option<(&'static str, u32)>)>,
    scatter: &'static Pass,
    width: Option<(&'static str, u32)>,
}

impl Kernels {
    fn of(shape: SortShape, subgroup: Subgroup) -> Kernels {
        match (shape, subgroup) {
            (SortShape::Runs, _) => {
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

/// A sort with its own tables of digit counts.
pub struct RadixSort {
    passes: SortPasses,
    /// Digit counts and their prefix sums.
    tables: [BufferRange; 2],
}

impl RadixSort {
    /// Creates a sort of up to `most` keys of up to `bits` bits. `name` begins the buffers' names.
    pub fn new(gpu: &Gpu, name: &str, shape: SortShape, most: u64, bits: u32) -> Result<RadixSort> {
        let words = shape.table_words(most, bits);
        let table =
            |what: &str| gpu.buffer(&format!("{name}.{what}"), 4 * words, Memory::Device).map(BufferRange::whole);
        RadixSort::within(gpu, name, shape, most, bits, [table("table")?, table("places")?])
    }

    /// Like [`Self::new`], with given memory for the two tables, [`SortShape::table_words`] words each.
    pub(super) fn within(
        gpu: &Gpu,
        name: &str,
        shape: SortShape,
        most: u64,
        bits: u32,
        tables: [BufferRange; 2],
    ) -> Result<RadixSort> {
        Ok(RadixSort { passes: SortPasses::new(gpu, name, shape, most, bits)?, tables })
    }

    /// Bytes of the prefix sum's buffer, without the tables.
    pub(super) fn bytes(&self) -> u64 {
        self.passes.bytes()
    }

    /// Sorts `keys[0]` and `vals[0]` by the lowest `bits` bits of the keys. Returns the side that holds the result.
    pub fn record<'b, B: Into<BufferSlice<'b>>>(
        &self,
        rec: &mut Recorder,
        keys: [B; 2],
        vals: [B; 2],
        counters: &Buffer,
        extent: KeyCount<'_>,
        bits: u32,
    ) -> Result<usize> {
        let of = Unsorted { keys: keys.map(Into::into), vals: vals.map(Into::into), apart: None };
        self.record_from(rec, of, counters, extent, bits)
    }

    /// Like [`Self::record`], with optional separate input values.
    pub(super) fn record_from(
        &self,
        rec: &mut Recorder,
        of: Unsorted<'_>,
        counters: &Buffer,
        extent: KeyCount<'_>,
        bits: u32,
    ) -> Result<usize> {
        let Unsorted { keys, vals, apart } = of;
        let tables = [self.tables[0].slice(), self.tables[1].slice()];
        self.passes.record(rec, SortMemory { tables, keys, vals, apart }, counters, extent, bits)
    }
}

/// Keys and values to sort: side 0 holds the input, side 1 is scratch of the same size.
#[derive(Clone, Copy)]
pub(super) struct Unsorted<'a> {
    pub(super) keys: [BufferSlice<'a>; 2],
    pub(super) vals: [BufferSlice<'a>; 2],
    /// Input values to read instead of `vals[0]`, which the sort keeps unchanged.
    pub(super) apart: Option<BufferSlice<'a>>,
}

#[cfg(test)]
mod tests {
    use super::SortShape;

    #[test]
    fn digits_cover_every_bit_once() {
        for shape in [SortShape::Runs, SortShape::Groups] {
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
