//! Submits recorded commands, and reclaims their objects after the ticket has passed.

use super::barrier_plan::BarrierPlan;
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::atomic::Ordering;

use ash::vk;

use super::barrier::{Barrier, BufferUse, Tracker, Use, gather};
use super::buffer::Buffer;
use super::device::Device;
use super::encode::{QueueHandover, encode, enqueue};
use super::error::{Error, Result};
use super::hazard::{Hazard, HazardChecker};
use super::host_allocator::Memory;
use super::profile::{PassTime, Stats};
use super::recorder::{Command, Recorder};
use super::slot::Slot;
use super::submit_sync::SubmitSync;

/// Size in bytes of a reusable staging buffer.
pub(super) const STAGING: u64 = 256 << 10;
/// Most unread timings kept.
const TIMINGS: usize = 4096;

pub(super) struct InFlight {
    pub(super) ticket: u64,
    pub(super) label: String,
    /// Number of the first command, counted over all submits, for breadcrumbs.
    pub(super) first_command: u32,
    slot: Slot,
    commands: Vec<Command>,
    staging: Vec<(Buffer, u64)>,
    profiled: bool,
    /// Ranges of read-back buffers that the submit uses.
    landings: Vec<BufferUse>,
}

impl InFlight {
    pub(super) fn command_name(&self, number: u32) -> Option<&str> {
        self.commands.get(number.wrapping_sub(self.first_command) as usize).map(Command::name)
    }
}

/// State of the queue, behind one lock.
#[derive(Default)]
pub(super) struct State {
    /// Ticket of the last submit.
    pub(super) last: u64,
    pub(super) stats: Stats,
    pub(super) in_flight: VecDeque<InFlight>,
    pub(super) timings: VecDeque<(u64, Vec<PassTime>)>,
    pub(super) staging: Vec<Buffer>,
    tracker: Tracker,
    pub(super) checker: Option<HazardChecker>,
    /// Buffer for breadcrumbs.
    pub(super) crumbs: Option<Buffer>,
    commands: u32,
    slots: Vec<Slot>,
    /// Whether barriers of an earlier submit may not have reached the device. The next submit then begins with a full
    /// barrier.
    unsure: bool,
}

impl State {
    /// Reclaims the objects of submits up to ticket `completed`. Returns commands that the caller drops outside the
    /// lock.
    pub(super) fn retire(
        &mut self,
        device: &Device,
        completed: u64,
        period_ns: f64,
        mask: u64,
    ) -> Result<Vec<Command>> {
        let mut done = Vec::new();
        while self.in_flight.front().is_some_and(|f| f.ticket <= completed) {
            let Some(mut flight) = self.in_flight.pop_front() else { break };
            if flight.profiled {
                let ticks = flight.slot.timestamps(device, flight.commands.len() + 1)?;
                let passes = flight.commands.iter().zip(ticks.windows(2)).map(|(command, pair)| PassTime {
                    pass: command.name().to_owned(),
                    ns: (pair[1].wrapping_sub(pair[0]) & mask) as f64 * period_ns,
                });
                self.timings.push_back((flight.ticket, passes.collect()));
                if self.timings.len() > TIMINGS {
                    self.timings.pop_front();
                }
            }
            // SAFETY: the ticket has passed.
            unsafe { flight.slot.reset(device) }?;
            self.slots.push(flight.slot);
            for (chunk, _) in flight.staging {
                if chunk.size() == STAGING && self.staging.len() < 64 {
                    self.staging.push(chunk);
                }
            }
            done.append(&mut flight.commands);
        }
        Ok(done)
    }

    /// Submits a recording; afterwards the ticket is `self.last`. Returns a panic of the host's callbacks, which the
    /// caller resumes after releasing the lock on the state. After a panic in `lock` nothing was submitted; after a
    /// panic in `unlock` the device has the commands.
    pub(super) fn submit(
        &mut self,
        device: &Device,
        timeline: vk::Semaphore,
        recorder: Recorder,
        order: SubmitSync<'_>,
    ) -> Result<std::thread::Result<()>> {
        for id in std::mem::take(&mut *super::lock::lock(&device.freed)) {
            self.tracker.forget(id);
            self.checker.iter_mut().for_each(|c| c.forget(id));
        }
        // Until the device has the commands, the inferred state is unsure: an error or a panic would make the state
        // wrong.
        let unsure = std::mem::replace(&mut self.unsure, true);
        if unsure {
            self.tracker.clear();
            self.checker.iter_mut().for_each(HazardChecker::clear);
        }
        let mut slot = match self.slots.pop() {
            Some(slot) => slot,
            None => Slot::new(device)?,
        };
        let first = self.commands;
        let done = plan(&mut self.tracker, &mut self.checker, &recorder)
            .and_then(|plan| {
                encode(device, &mut slot, &recorder, &plan, unsure, self.crumbs.as_ref().map(|b| (b, first)))?;
                Ok(plan)
            })
            .and_then(|plan| Ok((plan, enqueue(device, slot.commands, timeline, self.last + 1, order)?)));
        let (plan, unlocked) = match done {
            Ok((plan, QueueHandover::Over(unlocked))) => (plan, unlocked),
            Ok((_, QueueHandover::Not(panic))) => {
                // SAFETY: nothing was submitted from the slot.
                unsafe { slot.destroy(device) };
                return Ok(Err(panic));
            }
            Err(error) => {
                // SAFETY: as above.
                unsafe { slot.destroy(device) };
                return Err(error);
            }
        };
        self.unsure = false;
        self.last += 1;
        self.commands = self.commands.wrapping_add(recorder.commands.len() as u32);
        self.stats.submits += 1;
        self.stats.barriers += u64::from(unsure);
        for (command, barriers) in recorder.commands.iter().zip(&plan.commands) {
            self.stats.dispatches += u64::from(matches!(command, Command::Dispatch { .. }));
            self.stats.by_address += u64::from(matches!(command, Command::Dispatch { table: Some(_), .. }));
            self.stats.transfers += u64::from(!matches!(command, Command::Dispatch { .. }));
            self.stats.barriers += u64::from(!barriers.is_empty());
            self.stats.buffer_barriers += barriers.len() as u64;
            for buffer in command.buffers() {
                buffer.inner.last_use.store(self.last, Ordering::Release);
                buffer.inner.armed.store(true, Ordering::Release);
                buffer.inner.filled.store(true, Ordering::Release);
            }
        }
        self.stats.barriers += u64::from(!plan.end.is_empty());
        self.stats.buffer_barriers += plan.end.len() as u64;
        self.in_flight.push_back(InFlight {
            ticket: self.last,
            label: recorder.label,
            first_command: first,
            slot,
            commands: recorder.commands,
            staging: recorder.staging,
            profiled: recorder.profile,
            landings: plan.landings,
        });
        Ok(unlocked)
    }

    /// The access state of every buffer after all submits; empty when the state is unsure.
    pub(super) fn tracker(&self) -> Tracker {
        if self.unsure { Tracker::default() } else { self.tracker.clone() }
    }

    /// Whether a submit after ticket `completed` uses `range` of a read-back buffer.
    pub(super) fn lands_later(&self, completed: u64, buffer: u64, range: &Range<u64>) -> bool {
        let later = self.in_flight.iter().rev().take_while(|flight| flight.ticket > completed);
        later
            .flat_map(|flight| &flight.landings)
            .any(|used| used.buffer == buffer && used.range.start < range.end && range.start < used.range.end)
    }

    /// A slot that no submit holds.
    pub(super) fn free_slot(&mut self) -> Option<Slot> {
        self.slots.pop()
    }

    /// Keeps a slot, already reset, for a later submit.
    pub(super) fn keep_slot(&mut self, slot: Slot) {
        self.slots.push(slot);
    }

    /// Tests for every barrier of a recording whether the checker objects to its removal. Returns the number of
    /// barriers, and descriptions of the barriers whose removal went unnoticed.
    pub(super) fn missed_barriers(&self, recorder: &Recorder) -> (usize, Vec<String>) {
        let mut tracker = self.tracker();
        let steps = steps(recorder);
        let barriers = infer(&mut tracker, &steps);
        let (mut total, mut unmissed) = (0, Vec::new());
        for i in 0..steps.len() {
            for j in 0..barriers[i].len() {
                total += 1;
                let mut fewer = barriers.clone();
                let gone = fewer[i].remove(j);
                let mut checker = self.checker.clone().filter(|_| !self.unsure).unwrap_or_default();
                let objected = steps
                    .iter()
                    .zip(&fewer)
                    .any(|((name, uses), barriers)| checker.command(name, barriers, uses).is_err());
                if !objected {
                    unmissed.push(format!("{gone:?} before {}", steps[i].0));
                }
            }
        }
        (total, unmissed)
    }
}

/// Infers the barriers of a recording and checks them with the hazard checker.
pub(super) fn plan(
    tracker: &mut Tracker,
    checker: &mut Option<HazardChecker>,
    recorder: &Recorder,
) -> Result<BarrierPlan> {
    let mut steps = steps(recorder);
    let mut commands = infer(tracker, &steps);
    if let Some(omitted) = recorder.omit_barrier {
        let mut number = 0;
        commands.iter_mut().for_each(|barriers| {
            barriers.retain(|_| {
                number += 1;
                number - 1 != omitted
            });
        });
    }
    if let Some(checker) = checker {
        for ((name, uses), barriers) in steps.iter().zip(&commands) {
            checker.command(name, barriers, uses).map_err(|hazard| hazard_error(recorder, &hazard))?;
        }
    }
    let end = commands.pop().unwrap_or_default();
    let landings = steps.pop().map(|(_, uses)| uses).unwrap_or_default();
    Ok(BarrierPlan { commands, end, landings })
}

/// The barriers in front of each of `steps`.
pub(super) fn infer(tracker: &mut Tracker, steps: &[(String, Vec<BufferUse>)]) -> Vec<Vec<Barrier>> {
    let first = tracker.commands() + 1;
    let mut barriers: Vec<Vec<Barrier>> = steps.iter().map(|(_, uses)| tracker.step(uses)).collect();
    gather(&mut barriers, first);
    barriers
}

/// Name and uses of every command; the last entry is the host's reads.
pub(super) fn steps(recorder: &Recorder) -> Vec<(String, Vec<BufferUse>)> {
    let mut steps: Vec<(String, Vec<BufferUse>)> =
        recorder.commands.iter().map(|command| (command.name().to_owned(), command.uses())).collect();
    let mut read: Vec<BufferUse> = Vec::new();
    for command in &recorder.commands {
        for buffer in command.buffers().into_iter().filter(|b| b.memory() == Memory::Readback) {
            for used in command.uses() {
                let used = BufferUse { kind: Use::HostRead, ..used };
                if used.buffer == buffer.inner.id && !read.contains(&used) {
                    read.push(used);
                }
            }
        }
    }
    steps.push(("read by the host".to_owned(), read));
    steps
}

fn hazard_error(recorder: &Recorder, hazard: &Hazard) -> Error {
    let name = recorder
        .commands
        .iter()
        .flat_map(Command::buffers)
        .find(|b| b.inner.id == hazard.buffer)
        .map_or("?", |b| b.name());
    Error::Hazard(format!(
        "recording {}: no barrier on buffer {name} between {} ({:?}) and {} ({:?})",
        recorder.label, hazard.first.0, hazard.first.1, hazard.second.0, hazard.second.1
    ))
}

impl State {
    /// Destroys all objects of the queue.
    ///
    /// # Safety
    /// Every submit has finished, or the device is lost.
    pub(super) unsafe fn close(&mut self, device: &Device) {
        for flight in self.in_flight.drain(..) {
            // SAFETY: the caller's promise.
            unsafe { flight.slot.destroy(device) };
        }
        for slot in self.slots.drain(..) {
            // SAFETY: as above.
            unsafe { slot.destroy(device) };
        }
        self.staging.clear();
    }
}
