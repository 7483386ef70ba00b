//! The hazard checker: finds conflicting accesses without a barrier between them, given commands, their declared uses
//! and their barriers. The checker shares no logic with the inference in `barrier.rs`: the checker keeps every past
//! access and tests each pair.
//!
//! Two accesses conflict when their bytes overlap and at least one access writes. A barrier on the overlapping bytes,
//! or a chain of barriers, must order the second access after the first. After a write the barrier must also make the
//! write available, and visible to the second access.

use std::collections::HashMap;
use std::ops::Range;

use ash::vk::{AccessFlags2 as A, PipelineStageFlags2 as S};

use super::barrier::{Barrier, BufferUse, Use};

/// Two conflicting accesses without a barrier between them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Hazard {
    /// Number of the buffer.
    pub(super) buffer: u64,
    /// Name and use of the earlier command.
    pub(super) first: (String, Use),
    /// Name and use of the later command.
    pub(super) second: (String, Use),
}

#[derive(Clone, Debug)]
struct PastAccess {
    range: Range<u64>,
    kind: Use,
    command: String,
    /// Stages that run after this access.
    ordered: S,
    /// Whether a barrier has made the write available.
    available: bool,
    /// Accesses that see the write.
    visible: A,
    /// `ordered` and `available` before the barriers in front of the current command: barriers of one call do not
    /// chain.
    before: (S, bool),
}

/// Every access that a later access could conflict with.
#[derive(Clone, Debug, Default)]
pub(super) struct HazardChecker {
    buffers: HashMap<u64, Vec<PastAccess>>,
}

impl HazardChecker {
    /// Checks the next command of the queue and the barriers recorded in front of the command.
    pub(super) fn command(&mut self, name: &str, barriers: &[Barrier], uses: &[BufferUse]) -> Result<(), Hazard> {
        for barrier in barriers {
            let pasts = self.buffers.get_mut(&barrier.buffer);
            pasts.into_iter().flatten().for_each(|past| past.before = (past.ordered, past.available));
        }
        for barrier in barriers {
            self.apply(barrier);
        }
        for used in uses {
            let pasts = self.buffers.get(&used.buffer).map_or(&[][..], Vec::as_slice);
            if let Some(past) = pasts.iter().find(|past| unordered(past, used)) {
                return Err(Hazard {
                    buffer: used.buffer,
                    first: (past.command.clone(), past.kind),
                    second: (name.to_owned(), used.kind),
                });
            }
        }
        // An access that a write covers is ordered before the write and need not be kept. Of equal reads, only the
        // latest is kept.
        for used in uses {
            if let Some(pasts) = self.buffers.get_mut(&used.buffer) {
                pasts.retain(|past| {
                    let replaced =
                        if used.kind.writes() { contains(&used.range, &past.range) } else { past.range == used.range };
                    !(replaced && (used.kind.writes() || past.kind == used.kind))
                });
            }
        }
        for used in uses {
            self.buffers.entry(used.buffer).or_default().push(PastAccess {
                range: used.range.clone(),
                kind: used.kind,
                command: name.to_owned(),
                ordered: S::empty(),
                available: false,
                visible: A::empty(),
                before: (S::empty(), false),
            });
        }
        Ok(())
    }

    /// Forgets a buffer that no longer exists.
    pub(super) fn forget(&mut self, buffer: u64) {
        self.buffers.remove(&buffer);
    }

    /// Forgets everything, after a barrier over everything.
    pub(super) fn clear(&mut self) {
        self.buffers.clear();
    }

    fn apply(&mut self, barrier: &Barrier) {
        let Some(pasts) = self.buffers.get_mut(&barrier.buffer) else { return };
        let mut rest = Vec::new();
        for past in pasts.iter_mut() {
            let reached =
                past.kind.stage().intersects(barrier.src_stage) || past.before.0.intersects(barrier.src_stage);
            let inside = past.range.start.max(barrier.range.start)..past.range.end.min(barrier.range.end);
            if !reached || inside.is_empty() {
                continue;
            }
            for outside in [past.range.start..inside.start, inside.end..past.range.end] {
                if !outside.is_empty() {
                    rest.push(PastAccess { range: outside, ..past.clone() });
                }
            }
            past.range = inside;
            if past.kind.writes() {
                let write = past.kind.access() & (A::SHADER_STORAGE_WRITE | A::TRANSFER_WRITE);
                let flushed = barrier.src_stage.contains(past.kind.stage()) && barrier.src_access.contains(write);
                past.available |= flushed;
                if flushed || past.before.1 {
                    past.visible |= barrier.dst_access;
                }
            }
            past.ordered |= barrier.dst_stage;
        }
        pasts.append(&mut rest);
    }
}

fn contains(outer: &Range<u64>, inner: &Range<u64>) -> bool {
    outer.start <= inner.start && inner.end <= outer.end
}

fn unordered(past: &PastAccess, used: &BufferUse) -> bool {
    let overlap = past.range.start < used.range.end && used.range.start < past.range.end;
    let conflict = overlap && (past.kind.writes() || used.kind.writes());
    let ordered = past.ordered.contains(used.kind.stage());
    let seen = !past.kind.writes() || past.visible.contains(used.kind.access());
    conflict && !(ordered && seen)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vk::barrier::{Tracker, gather};

    /// Commands over three buffers with every kind of use, from a linear congruential generator.
    fn sequence(seed: u64, length: u64) -> Vec<Vec<BufferUse>> {
        let kinds = [
            Use::ShaderRead,
            Use::ShaderWrite,
            Use::ShaderReadWrite,
            Use::Indirect,
            Use::CopyRead,
            Use::CopyWrite,
            Use::HostRead,
        ];
        let mut state = seed;
        let mut draw = move |n: u64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) % n
        };
        (0..length)
            .map(|_| {
                let mut uses: Vec<BufferUse> = Vec::new();
                for _ in 0..1 + draw(3) {
                    let start = 16 * draw(4);
                    let end = if draw(3) == 0 { start + 16 } else { 64 };
                    let used = BufferUse { buffer: draw(3), range: start..end, kind: kinds[draw(7) as usize] };
                    // One use per buffer and command, because of two overlapping uses one barrier can be redundant.
                    if uses.iter().all(|u| u.buffer != used.buffer) {
                        uses.push(used);
                    }
                }
                uses
            })
            .collect()
    }

    fn infer(commands: &[Vec<BufferUse>]) -> Vec<Vec<Barrier>> {
        let mut tracker = Tracker::default();
        let mut barriers: Vec<Vec<Barrier>> = commands.iter().map(|uses| tracker.step(uses)).collect();
        let calls = |barriers: &[Vec<Barrier>]| barriers.iter().filter(|b| !b.is_empty()).count();
        let before = (calls(&barriers), barriers.concat().len());
        gather(&mut barriers, 1);
        assert!(calls(&barriers) <= before.0 && barriers.concat().len() <= before.1);
        barriers
    }

    #[test]
    fn gathered_barriers_are_fewer_calls() {
        let one = |buffer: u64, kind: Use| vec![BufferUse { buffer, range: 0..64, kind }];
        let writes = [one(0, Use::ShaderWrite), one(1, Use::ShaderWrite), one(2, Use::ShaderWrite)];
        let reads = [one(0, Use::ShaderRead), one(1, Use::ShaderRead), one(2, Use::ShaderRead)];
        let commands = [&writes[..], &reads[..]].concat();
        let barriers = infer(&commands);
        assert_eq!(barriers.iter().map(Vec::len).collect::<Vec<_>>(), [0, 0, 0, 3, 0, 0]);
        assert_eq!(check(&commands, &barriers), Ok(()));
        // The first barrier cannot wait for a write that comes later.
        let late =
            [one(0, Use::ShaderWrite), one(0, Use::ShaderRead), one(1, Use::ShaderWrite), one(1, Use::ShaderRead)];
        assert_eq!(infer(&late).iter().map(Vec::len).collect::<Vec<_>>(), [0, 1, 0, 1]);
    }

    fn check(commands: &[Vec<BufferUse>], barriers: &[Vec<Barrier>]) -> Result<(), Hazard> {
        let mut checker = HazardChecker::default();
        commands
            .iter()
            .zip(barriers)
            .enumerate()
            .try_for_each(|(i, (uses, barriers))| checker.command(&format!("command {i}"), barriers, uses))
    }

    #[test]
    fn inferred_barriers_suffice_and_none_can_go() {
        let mut removed = 0;
        for seed in 0..200 {
            let commands = sequence(seed, 40);
            let barriers = infer(&commands);
            assert_eq!(check(&commands, &barriers), Ok(()), "seed {seed}");
            for i in 0..commands.len() {
                for j in 0..barriers[i].len() {
                    let mut fewer = barriers.clone();
                    let gone = fewer[i].remove(j);
                    assert!(
                        check(&commands, &fewer).is_err(),
                        "seed {seed}: {gone:?} before command {i} was not missed"
                    );
                    removed += 1;
                }
            }
        }
        assert!(removed > 2000, "only {removed} barriers were removed");
    }

    #[test]
    fn weakened_barriers_are_objected_to() {
        let write = vec![BufferUse { buffer: 0, range: 0..64, kind: Use::ShaderWrite }];
        let read = vec![BufferUse { buffer: 0, range: 0..64, kind: Use::ShaderRead }];
        let commands = [write, read];
        let good = infer(&commands);
        let weaken = |change: &dyn Fn(&mut Barrier)| {
            let mut barriers = good.clone();
            change(&mut barriers[1][0]);
            check(&commands, &barriers)
        };
        assert!(weaken(&|_| ()).is_ok());
        assert!(weaken(&|b| b.src_access = A::empty()).is_err());
        assert!(weaken(&|b| b.dst_access = A::INDIRECT_COMMAND_READ).is_err());
        assert!(weaken(&|b| b.src_stage = S::ALL_TRANSFER).is_err());
        assert!(weaken(&|b| b.dst_stage = S::DRAW_INDIRECT).is_err());
        assert!(weaken(&|b| b.range = 0..32).is_err());
        assert!(weaken(&|b| b.buffer = 1).is_err());
    }
}
