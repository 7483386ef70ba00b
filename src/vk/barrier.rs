//! Barrier inference: from the declared uses of buffers, command by command, to the barriers between them.
//!
//! State is kept per byte range of each buffer and outlives a submit: everything runs on one queue, whose submission order
//! extends the scope of a barrier over all earlier command buffers.

use std::collections::HashMap;
use std::ops::Range;

use ash::vk::{AccessFlags2 as A, PipelineStageFlags2 as S};

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
}

/// What happened last to a range. An access flag belongs to one stage only here, so flags stand for (stage, access) pairs.
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
}

impl Segment {
    /// What has to be waited for before `kind`: stages and writes.
    fn pending(&self, kind: Use) -> Option<(S, A)> {
        if kind.writes() {
            let stages = self.write_stage | self.readers;
            (!stages.is_empty()).then_some((stages, self.write_access))
        } else {
            let unseen = !self.write_stage.is_empty() && !self.visible.contains(kind.access());
            unseen.then_some((self.write_stage, self.write_access))
        }
    }
}

/// The state of every buffer on the queue.
#[derive(Clone, Debug, Default)]
pub(super) struct Tracker {
    buffers: HashMap<u64, Vec<Segment>>,
}

impl Tracker {
    /// The barriers needed in front of a command that uses `uses`, and the state after it.
    pub(super) fn step(&mut self, uses: &[BufferUse]) -> Vec<Barrier> {
        let mut barriers: Vec<Barrier> = Vec::new();
        for used in uses {
            let mut src = (S::empty(), A::empty());
            for segment in self.split(used) {
                if let Some((stages, access)) = segment.pending(used.kind) {
                    src = (src.0 | stages, src.1 | access);
                }
            }
            if !src.0.is_empty() {
                let barrier = Barrier {
                    buffer: used.buffer,
                    range: used.range.clone(),
                    src_stage: src.0,
                    src_access: src.1,
                    dst_stage: used.kind.stage(),
                    dst_access: used.kind.access(),
                };
                if !barriers.contains(&barrier) {
                    barriers.push(barrier);
                }
            }
        }
        // Three passes, so that a command that uses one buffer in several ways is left with all of its uses recorded.
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
            }
        }
        for used in uses.iter().filter(|used| !used.kind.writes()) {
            self.split(used).for_each(|segment| segment.readers |= used.kind.stage());
        }
        for used in uses {
            self.merge(used.buffer);
        }
        barriers
    }

    /// Forgets a buffer that no longer exists.
    pub(super) fn forget(&mut self, buffer: u64) {
        self.buffers.remove(&buffer);
    }

    /// Forgets everything, after a barrier over everything.
    pub(super) fn clear(&mut self) {
        self.buffers.clear();
    }

    /// The segments of exactly the used range, after cutting those that reach over its ends.
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
                let same = Segment { start: kept.start, end: kept.end, ..next.clone() } == *kept;
                if same {
                    kept.end = next.end;
                }
                same
            });
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
