//! Barrier inference: computes the barriers between commands from the declared uses of buffers.
//!
//! The tracker keeps state per byte range of each buffer, across submits. All work runs on one queue, and submission
//! order on that queue extends the scope of a barrier over all earlier command buffers.

use std::collections::HashMap;
use std::ops::Range;

use ash::vk::{AccessFlags2 as A, PipelineStageFlags2 as S};

use super::kernel::Access;

/// How a command uses a byte range of a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Use {
    /// Read by a compute shader.
    ShaderRead,
    /// Written by a compute shader.
    ShaderWrite,
    /// Read and written by a compute shader.
    ShaderReadWrite,
    /// Workgroup counts of an indirect dispatch.
    Indirect,
    /// Source of a copy.
    CopyRead,
    /// Destination of a copy or fill.
    CopyWrite,
    /// Read by the host after the submit's ticket.
    HostRead,
}

impl Use {
    pub(super) fn stage(self) -> S {
        match self {
            Use::ShaderRead | Use::ShaderWrite | Use::ShaderReadWrite => S::COMPUTE_SHADER,
            Use::Indirect => S::DRAW_INDIRECT,
            Use::CopyRead | Use::CopyWrite => S::ALL_TRANSFER,
            Use::HostRead => S::HOST,
        }
    }

    pub(super) fn access(self) -> A {
        match self {
            Use::ShaderRead => A::SHADER_STORAGE_READ,
            Use::ShaderWrite => A::SHADER_STORAGE_WRITE,
            Use::ShaderReadWrite => A::SHADER_STORAGE_READ | A::SHADER_STORAGE_WRITE,
            Use::Indirect => A::INDIRECT_COMMAND_READ,
            Use::CopyRead => A::TRANSFER_READ,
            Use::CopyWrite => A::TRANSFER_WRITE,
            Use::HostRead => A::HOST_READ,
        }
    }

    /// The access of a binding with this use.
    pub(super) fn as_access(self) -> Access {
        match self {
            Use::ShaderReadWrite => Access::ReadWrite,
            _ if self.writes() => Access::Write,
            _ => Access::Read,
        }
    }

    /// True when the command may change the bytes.
    pub(super) fn writes(self) -> bool {
        matches!(self, Use::ShaderWrite | Use::ShaderReadWrite | Use::CopyWrite)
    }
}

/// A declared use of a range of the buffer with number `buffer`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct BufferUse {
    /// Number of the buffer, unique in its device.
    pub(super) buffer: u64,
    /// Bytes.
    pub(super) range: Range<u64>,
    /// Kind of use.
    pub(super) kind: Use,
}

/// A buffer barrier in front of a command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Barrier {
    /// Number of the buffer.
    pub(super) buffer: u64,
    /// Bytes.
    pub(super) range: Range<u64>,
    /// Stages that must have run.
    pub(super) src_stage: S,
    /// Writes that must be available.
    pub(super) src_access: A,
    /// Stages that wait.
    pub(super) dst_stage: S,
    /// Accesses that see the writes.
    pub(super) dst_access: A,
    /// Number of the last command that the barrier waits for, counted over the life of the tracker. The barrier may
    /// stand anywhere after that command.
    pub(super) after: u64,
}

/// The last accesses to a byte range. Each access flag used here belongs to one stage, so a flag stands for a (stage,
/// access) pair.
#[derive(Clone, Debug, PartialEq)]
struct Segment {
    start: u64,
    end: u64,
    write_stage: S,
    write_access: A,
    /// Accesses that already see the last write.
    visible: A,
    /// Stages that read since the last write.
    readers: S,
    /// Number of the last command that wrote the range, and of the last that read the range.
    written: u64,
    read: u64,
}

impl Segment {
    /// What a use of `kind` has to wait for: stages, writes, and the number of the last command among them.
    fn pending(&self, kind: Use) -> Option<(S, A, u64)> {
        if kind.writes() {
            let stages = self.write_stage | self.readers;
            (!stages.is_empty()).then_some((stages, self.write_access, self.written.max(self.read)))
        } else {
            let unseen = !self.write_stage.is_empty() && !self.visible.contains(kind.access());
            unseen.then_some((self.write_stage, self.write_access, self.written))
        }
    }
}

/// The access state of every buffer on the queue.
#[derive(Clone, Debug, Default)]
pub(super) struct Tracker {
    buffers: HashMap<u64, Vec<Segment>>,
    commands: u64,
}

impl Tracker {
    /// Returns the barriers needed in front of a command with `uses`, and advances the state past the command.
    pub(super) fn step(&mut self, uses: &[BufferUse]) -> Vec<Barrier> {
        self.commands += 1;
        let number = self.commands;
        let mut barriers: Vec<Barrier> = Vec::new();
        for used in uses {
            // Only over the bytes that need a barrier: a barrier moved next to another must not cover bytes a second
            // time.
            let mut runs: Vec<Barrier> = Vec::new();
            for segment in self.split(used) {
                let Some((stages, access, after)) = segment.pending(used.kind) else { continue };
                match runs.last_mut().filter(|run| run.range.end == segment.start) {
                    Some(run) => {
                        run.range.end = segment.end;
                        run.src_stage |= stages;
                        run.src_access |= access;
                        run.after = run.after.max(after);
                    }
                    None => runs.push(Barrier {
                        buffer: used.buffer,
                        range: segment.start..segment.end,
                        src_stage: stages,
                        src_access: access,
                        dst_stage: used.kind.stage(),
                        dst_access: used.kind.access(),
                        after,
                    }),
                }
            }
            runs.retain(|run| !barriers.contains(run));
            barriers.append(&mut runs);
        }
        // Three passes, so that all uses are recorded when a command uses one buffer in several ways.
        for barrier in &barriers {
            let seen = BufferUse { buffer: barrier.buffer, range: barrier.range.clone(), kind: Use::ShaderRead };
            self.split(&seen).for_each(|segment| segment.visible |= barrier.dst_access);
        }
        for used in uses.iter().filter(|used| used.kind.writes()) {
            for segment in self.split(used) {
                segment.write_stage = used.kind.stage();
                segment.write_access = used.kind.access();
                segment.visible = A::empty();
                segment.readers = S::empty();
                (segment.written, segment.read) = (number, 0);
            }
        }
        for used in uses.iter().filter(|used| !used.kind.writes()) {
            self.split(used).for_each(|segment| {
                segment.readers |= used.kind.stage();
                segment.read = number;
            });
        }
        for used in uses {
            self.merge(used.buffer);
        }
        barriers
    }

    /// Number of the last command that [`Self::step`] has seen.
    pub(super) fn commands(&self) -> u64 {
        self.commands
    }

    /// Forgets a buffer that no longer exists.
    pub(super) fn forget(&mut self, buffer: u64) {
        self.buffers.remove(&buffer);
    }

    /// Forgets everything, after a barrier over everything.
    pub(super) fn clear(&mut self) {
        self.buffers.clear();
    }

    /// The segments of exactly the used range. Cuts segments that cross an end of the range.
    fn split(&mut self, used: &BufferUse) -> impl Iterator<Item = &mut Segment> {
        let (start, end) = (used.range.start, used.range.end);
        let segments = self.buffers.entry(used.buffer).or_insert_with(|| {
            vec![Segment {
                start: 0,
                end: u64::MAX,
                write_stage: S::empty(),
                write_access: A::empty(),
                visible: A::empty(),
                readers: S::empty(),
                written: 0,
                read: 0,
            }]
        });
        for cut in [start, end] {
            if let Some(i) = segments.iter().position(|s| s.start < cut && cut < s.end) {
                let mut tail = segments[i].clone();
                segments[i].end = cut;
                tail.start = cut;
                segments.insert(i + 1, tail);
            }
        }
        segments.iter_mut().filter(move |s| start <= s.start && s.end <= end)
    }

    fn merge(&mut self, buffer: u64) {
        if let Some(segments) = self.buffers.get_mut(&buffer) {
            segments.dedup_by(|next, kept| {
                let (written, read) = (kept.written.max(next.written), kept.read.max(next.read));
                let same = Segment { start: kept.start, end: kept.end, written, read, ..next.clone() }
                    == Segment { written, read, ..kept.clone() };
                if same {
                    *kept = Segment { end: next.end, written, read, ..kept.clone() };
                }
                same
            });
        }
    }
}

impl Barrier {
    /// Whether `self` makes `other` redundant.
    fn covers(&self, other: &Barrier) -> bool {
        self.buffer == other.buffer
            && self.range.start <= other.range.start
            && other.range.end <= self.range.end
            && self.src_stage.contains(other.src_stage)
            && self.src_access.contains(other.src_access)
            && self.dst_stage.contains(other.dst_stage)
            && self.dst_access.contains(other.dst_access)
    }
}

/// Groups barriers to reduce barrier calls. If every barrier in front of a command may stand in front of an earlier
/// command that already has barriers, all of them move there. A moved barrier replaces the barriers that it covers.
/// `barriers[i]` stand in front of command `first + i`.
pub(super) fn gather(barriers: &mut [Vec<Barrier>], first: u64) {
    for i in 1..barriers.len() {
        let home = |barrier: &Barrier| {
            let earliest = (barrier.after + 1).saturating_sub(first) as usize;
            (earliest..i).rev().find(|&j| !barriers[j].is_empty())
        };
        let Some(homes) = barriers[i].iter().map(home).collect::<Option<Vec<usize>>>() else { continue };
        for (j, barrier) in homes.into_iter().zip(std::mem::take(&mut barriers[i])) {
            barriers[j].retain(|other| !barrier.covers(other));
            barriers[j].push(barrier);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn used(buffer: u64, range: Range<u64>, kind: Use) -> BufferUse {
        BufferUse { buffer, range, kind }
    }

    #[test]
    fn readers_and_strangers_need_no_barrier() {
        let mut tracker = Tracker::default();
        assert!(tracker.step(&[used(1, 0..64, Use::ShaderWrite)]).is_empty());
        assert!(tracker.step(&[used(2, 0..64, Use::ShaderWrite)]).is_empty());
        assert_eq!(tracker.step(&[used(1, 0..64, Use::ShaderRead)]).len(), 1);
        assert!(tracker.step(&[used(1, 0..64, Use::ShaderRead)]).is_empty());
        assert!(tracker.step(&[used(1, 0..32, Use::ShaderRead)]).is_empty());
    }

    #[test]
    fn write_waits_for_readers_of_every_stage() {
        let mut tracker = Tracker::default();
        tracker.step(&[used(1, 0..64, Use::ShaderWrite)]);
        tracker.step(&[used(1, 0..64, Use::Indirect)]);
        tracker.step(&[used(1, 0..64, Use::CopyRead)]);
        let barriers = tracker.step(&[used(1, 0..64, Use::ShaderWrite)]);
        assert_eq!(barriers.len(), 1);
        assert!(barriers[0].src_stage.contains(S::DRAW_INDIRECT | S::ALL_TRANSFER | S::COMPUTE_SHADER));
    }

    #[test]
    fn disjoint_ranges_are_apart_and_overlaps_are_not() {
        let mut tracker = Tracker::default();
        tracker.step(&[used(1, 0..16, Use::CopyWrite)]);
        assert!(tracker.step(&[used(1, 16..32, Use::CopyWrite)]).is_empty());
        assert_eq!(tracker.step(&[used(1, 8..24, Use::CopyWrite)]).len(), 1);
        assert_eq!(tracker.step(&[used(1, 0..u64::MAX, Use::ShaderRead)]).len(), 1);
        assert!(tracker.step(&[used(1, 4..5, Use::ShaderRead)]).is_empty());
    }
}
