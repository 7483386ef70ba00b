//! The device's reports at the end of each event, in a ring buffer that the host reads later.

use std::collections::VecDeque;

use super::Outcome;
use crate::pass::{counters, finish};
use crate::train::Error;
use crate::vk::{Buffer, Gpu, Groups, Memory, Pipeline, Recorder, Ticket};

/// Bytes of a slot, which holds a report of `finish`: the largest alignment of bindings of any device.
const SLOT: u64 = 256;
/// Number of slots: more than events are ever in flight.
const SLOTS: u64 = 64;

/// The ring, and the slot of each submitted recording.
pub(super) struct Reports {
    finish: Pipeline,
    ring: Buffer,
    next_slot: u64,
    slots: VecDeque<(Ticket, u64)>,
    /// Recordings submitted so far.
    recorded: u64,
}

impl Reports {
    pub(super) fn new(gpu: &Gpu) -> Result<Self, Error> {
        Ok(Self {
            finish: gpu.pipeline(&finish::PASS.kernel, &[])?,
            ring: gpu.buffer("ring", SLOT * SLOTS, Memory::Readback)?,
            next_slot: 0,
            slots: VecDeque::new(),
            recorded: 0,
        })
    }

    /// Records the report of an event.
    pub(super) fn record(
        &self,
        recorder: &mut Recorder,
        counters: &Buffer,
        loss: &Buffer,
        push: &finish::Push,
    ) -> Result<(), Error> {
        let at = SLOT * self.next_slot;
        let buffers = [counters.into(), loss.into(), self.ring.slice(at..at + SLOT)];
        Ok(recorder.dispatch(&self.finish, &buffers, push, Groups::Workgroups(1))?)
    }

    /// Notes that a recording was submitted. The next recording reports to the next slot.
    pub(super) fn submitted(&mut self, ticket: Ticket) {
        self.slots.push_back((ticket, self.next_slot));
        while self.slots.len() as u64 >= SLOTS {
            self.slots.pop_front();
        }
        self.next_slot = (self.next_slot + 1) % SLOTS;
        self.recorded += 1;
    }

    /// Number of recordings submitted so far.
    pub(super) fn recorded(&self) -> u64 {
        self.recorded
    }

    /// The report of an event. Waits until the event is done.
    pub(super) fn outcome(&self, gpu: &Gpu, ticket: Ticket) -> Result<Outcome, Error> {
        gpu.wait(ticket)?;
        let slot = self.slots.iter().find(|(t, _)| *t == ticket).map_or(0, |(_, slot)| *slot);
        let words: Vec<u32> =
            gpu.read_ready(&self.ring, SLOT * slot, finish::REPORT_WORDS, ticket)?.unwrap_or_default();
        let loss = words.get(counters::COUNT).map_or(f32::NAN, |bits| f32::from_bits(*bits));
        let counters = words.get(..counters::COUNT).map(<[u32]>::to_vec).unwrap_or(vec![0; counters::COUNT]);
        Ok(Outcome { counters, loss, ticket })
    }

    /// Bytes of the ring that count as device memory.
    pub(super) fn bytes(&self, gpu: &Gpu) -> u64 {
        gpu.counted_bytes(&self.ring)
    }
}
