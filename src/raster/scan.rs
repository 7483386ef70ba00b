//! Exclusive prefix sum of words on the device.

use crate::pass::plan::{Entry, NO_COUNTER};
use crate::pass::scan::{self as pass, Push};
use crate::vk::{Buffer, BufferSlice, Caps, DeviceKind, Gpu, Groups, Memory, Pipeline, Recorder, Result, Subgroup};

/// Words that one workgroup sums.
pub const BLOCK: u32 = pass::LOCAL_SIZE * pass::ITEMS;

/// Constants of [`pass::ONCE`] on GPUs.
const WIDE: [(&str, u32); 2] = [("LOCAL_SIZE", pass::WIDE_LOCAL_SIZE), ("ITEMS", 4)];

/// Number of words to sum, and the dispatches that cover them.
#[derive(Clone, Copy, Debug)]
pub struct ScanExtent<'a> {
    /// Index of the counter that holds the count, or [`NO_COUNTER`].
    pub source: u32,
    /// The count for [`NO_COUNTER`].
    pub count: u32,
    /// The number of words is `ceil(count / divide) * multiply`.
    pub divide: u32,
    /// See `divide`.
    pub multiply: u32,
    /// One workgroup per [`BLOCK`] words.
    pub blocks: Groups<'a>,
    /// One workgroup, or none when the event is void.
    pub once: Groups<'a>,
}

impl<'a> ScanExtent<'a> {
    /// An extent whose number of words the host knows.
    pub fn host(count: u32) -> ScanExtent<'a> {
        let blocks = Groups::Workgroups(u64::from(count.div_ceil(BLOCK)));
        ScanExtent { source: NO_COUNTER, count, divide: 1, multiply: 1, blocks, once: Groups::Workgroups(1) }
    }

    /// An extent of as many words as counter `source`. Entry `blocks` of `args` was planned by [`entry`], entry `once`
    /// by [`Entry::fixed`]`(1)`.
    pub fn counted(source: u32, args: &'a Buffer, blocks: u32, once: u32) -> ScanExtent<'a> {
        ScanExtent {
            source,
            count: 0,
            divide: 1,
            multiply: 1,
            blocks: Groups::Indirect(args, Entry::offset(blocks)),
            once: Groups::Indirect(args, Entry::offset(once)),
        }
    }
}

/// The entry of `args` for a prefix sum over a counter.
pub const fn entry() -> Entry {
    Entry::items(BLOCK)
}

/// The summand of each word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Summand {
    /// The word itself.
    Words,
    /// 1 for a nonzero word, else 0.
    NonZero,
}

/// Most words that one workgroup sums alone. Above roughly this number three dispatches are faster; on a CPU device a
/// dispatch costs the time of about ten thousand words.
pub(crate) fn most_at_once(caps: &Caps) -> u64 {
    match caps.kind {
        DeviceKind::Cpu if in_runs(caps) => 1 << 18,
        DeviceKind::Cpu => 1 << 16,
        _ => 1 << 14,
    }
}

/// Whether a single subgroup does the sum, with a run of words per thread.
fn in_runs(caps: &Caps) -> bool {
    caps.kind == DeviceKind::Cpu && caps.subgroup == Subgroup::Hardware(8)
}

/// The passes of a prefix sum.
pub struct Scan {
    form: ScanPasses,
}

enum ScanPasses {
    /// One workgroup.
    Once(Pipeline),
    /// Three passes, with the sums of blocks between them.
    Blocks { reduce: Pipeline, spine: Pipeline, add: Pipeline, sums: Buffer },
}

impl Scan {
    /// Creates a prefix sum of up to `most` words. `name` begins the buffer's name.
    pub fn new(gpu: &Gpu, name: &str, most: u64) -> Result<Scan> {
        let (kernels, once, width) = match gpu.caps().subgroup {
            Subgroup::Hardware(_) => ([&pass::REDUCE, &pass::SPINE, &pass::ADD], &pass::ONCE, None),
            Subgroup::Emulated(width) => (
                [&pass::REDUCE_EMULATED, &pass::SPINE_EMULATED, &pass::ADD_EMULATED],
                &pass::ONCE_EMULATED,
                Some(("EMULATED_WIDTH", width)),
            ),
        };
        let caps = gpu.caps();
        if most <= most_at_once(caps) {
            let wide = caps.kind != DeviceKind::Cpu
                && width.is_none()
                && caps.limits.workgroup_size >= pass::WIDE_LOCAL_SIZE
                && pass::ONCE.kernel.fits(&caps.limits, &WIDE);
            let once = if in_runs(caps) {
                gpu.pipeline(&pass::ONCE_RUNS.kernel, &[])?
            } else if wide {
                gpu.pipeline(&pass::ONCE.kernel, &WIDE)?
            } else {
                gpu.pipeline(&once.kernel, width.as_slice())?
            };
            return Ok(Scan { form: ScanPasses::Once(once) });
        }
        let [reduce, spine, add] = kernels.map(|pass| gpu.pipeline(&pass.kernel, width.as_slice()));
        let bytes = 4 * most.div_ceil(u64::from(BLOCK)).max(1);
        let sums = gpu.buffer(&format!("{name}.sums"), bytes, Memory::Device)?;
        Ok(Scan { form: ScanPasses::Blocks { reduce: reduce?, spine: spine?, add: add?, sums } })
    }

    /// Bytes of the intermediate buffer.
    pub fn bytes(&self) -> u64 {
        match &self.form {
            ScanPasses::Once(_) => 0,
            ScanPasses::Blocks { sums, .. } => sums.size(),
        }
    }

    /// Writes the sum of words 0..i of the first buffer to word i of the second buffer, and the sum of all words to
    /// counter `total` (unless [`NO_COUNTER`]).
    pub fn record<'b, B: Into<BufferSlice<'b>>>(
        &self,
        rec: &mut Recorder,
        [source, target]: [B; 2],
        counters: &Buffer,
        extent: ScanExtent<'_>,
        summand: Summand,
        total: u32,
    ) -> Result<()> {
        let (source, target, counters): (BufferSlice<'_>, BufferSlice<'_>, BufferSlice<'_>) =
            (source.into(), target.into(), counters.into());
        let push = Push {
            source: extent.source,
            count: extent.count,
            divide: extent.divide,
            multiply: extent.multiply,
            predicate: u32::from(summand == Summand::NonZero),
            total,
        };
        match &self.form {
            ScanPasses::Once(once) => rec.dispatch(once, &[source, counters, target], &push, extent.once),
            ScanPasses::Blocks { reduce, spine, add, sums } => {
                let sums: BufferSlice<'_> = sums.into();
                rec.dispatch(reduce, &[source, counters, sums], &push, extent.blocks)?;
                rec.dispatch(spine, &[counters, sums], &push, extent.once)?;
                rec.dispatch(add, &[source, counters, sums, target], &push, extent.blocks)
            }
        }
    }
}
