//! Exclusive prefix sum of words on the device.

use crate::pass::plan::{Entry, NO_COUNTER};
use crate::pass::scan::{self as pass, Push};
use crate::vk::{Buffer, BufferSlice, Caps, DeviceKind, Gpu, Groups, Memory, Pipeline, Recorder, Result, Subgroup};

/// Words that one workgroup sums.
pub const BLOCK: u32 = pass::LOCAL_SIZE * pass::ITEMS;

/// Words of a thread of the wide form in a turn.
const WIDE_ITEMS: u32 = 4;

/// How many words there are, and the dispatches that cover them.
#[derive(Clone, Copy, Debug)]
pub struct Extent<'a> {
    /// Counter that holds the count, or [`NO_COUNTER`].
    pub source: u32,
    /// The count when there is no counter.
    pub count: u32,
    /// The words are `ceil(count / divide) * multiply`.
    pub divide: u32,
    /// See `divide`.
    pub multiply: u32,
    /// One workgroup per [`BLOCK`] words.
    pub blocks: Groups<'a>,
    /// One workgroup, or none when the event is void.
    pub once: Groups<'a>,
}

impl<'a> Extent<'a> {
    /// A number of words that the host knows.
    pub fn host(count: u32) -> Extent<'a> {
        let blocks = Groups::Workgroups(u64::from(count.div_ceil(BLOCK)));
        Extent { source: NO_COUNTER, count, divide: 1, multiply: 1, blocks, once: Groups::Workgroups(1) }
    }

    /// As many words as a counter says. Entry `blocks` of `args` was planned by [`entry`], entry `once` by
    /// [`Entry::fixed`]`(1)`.
    pub fn counted(source: u32, args: &'a Buffer, blocks: u32, once: u32) -> Extent<'a> {
        Extent {
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

/// What is summed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Summand {
    /// The words.
    Words,
    /// 1 for every word that is not 0.
    NonZero,
}

/// Most words that one workgroup sums by itself: about as many as are faster so than by three dispatches, each of which
/// a processor pays with the time of some ten thousand words.
pub(crate) fn most_at_once(caps: &Caps) -> u64 {
    match caps.kind {
        DeviceKind::Cpu if in_runs(caps) => 1 << 18,
        DeviceKind::Cpu => 1 << 16,
        _ => 1 << 14,
    }
}

/// Whether one subgroup sums by itself, a run of words to each thread.
fn in_runs(caps: &Caps) -> bool {
    caps.kind == DeviceKind::Cpu && caps.subgroup == Subgroup::Hardware(8)
}

/// The passes of a prefix sum.
pub struct Scan {
    form: Form,
}

enum Form {
    /// One workgroup.
    Once(Pipeline),
    /// Three passes, and the sums between them.
    Blocks { reduce: Pipeline, spine: Pipeline, add: Pipeline, sums: Buffer },
}

impl Scan {
    /// For up to `most` words at a time. `name` is the owner's, for the buffer.
    pub fn new(gpu: &Gpu, name: &str, most: u64) -> Result<Scan> {
        let (kernels, once, width) = match gpu.caps().subgroup {
            Subgroup::Hardware(_) if gpu.caps().kind != DeviceKind::Cpu => {
                ([&pass::REDUCE, &pass::SPINE, &pass::ADD_ROWS], &pass::ONCE, None)
            }
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
                && pass::ONCE_WIDE.kernel.fits(&caps.limits, &[]);
            let once = if in_runs(caps) {
                gpu.pipeline(&pass::ONCE_RUNS.kernel, &[])?
            } else if wide {
                gpu.pipeline(&pass::ONCE_WIDE.kernel, &[("ITEMS", WIDE_ITEMS)])?
            } else {
                gpu.pipeline(&once.kernel, width.as_slice())?
            };
            return Ok(Scan { form: Form::Once(once) });
        }
        let [reduce, spine, add] = kernels.map(|pass| gpu.pipeline(&pass.kernel, width.as_slice()));
        let bytes = 4 * most.div_ceil(u64::from(BLOCK)).max(1);
        let sums = gpu.buffer(&format!("{name}.sums"), bytes, Memory::Device)?;
        Ok(Scan { form: Form::Blocks { reduce: reduce?, spine: spine?, add: add?, sums } })
    }

    /// Bytes of its own buffer.
    pub fn bytes(&self) -> u64 {
        match &self.form {
            Form::Once(_) => 0,
            Form::Blocks { sums, .. } => sums.size(),
        }
    }

    /// Writes to word i of the second buffer the sum of words 0..i of the first, and the sum of all to counter `total`
    /// (or nowhere: [`NO_COUNTER`]).
    pub fn record<'b, B: Into<BufferSlice<'b>>>(
        &self,
        rec: &mut Recorder,
        [source, target]: [B; 2],
        counters: &Buffer,
        extent: Extent<'_>,
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
            Form::Once(once) => rec.dispatch(once, &[source, counters, target], &push, extent.once),
            Form::Blocks { reduce, spine, add, sums } => {
                let sums: BufferSlice<'_> = sums.into();
                rec.dispatch(reduce, &[source, counters, sums], &push, extent.blocks)?;
                rec.dispatch(spine, &[counters, sums], &push, extent.once)?;
                rec.dispatch(add, &[source, counters, sums, target], &push, extent.blocks)
            }
        }
    }
}
