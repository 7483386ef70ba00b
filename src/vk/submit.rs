//! From recorded commands to a submitted command buffer, and back when its ticket has passed.

use std::collections::VecDeque;
use std::sync::atomic::Ordering;

use ash::vk;

use super::barrier::{Barrier, BufferUse, Tracker, Use};
use super::buffer::Buffer;
use super::canary;
use super::device::Device;
use super::error::{Error, Named, Result};
use super::hazard::{Hazard, HazardChecker};
use super::memory::Memory;
use super::profile::{PassTime, Stats};
use super::recorder::{Command, Counts, Recorder};
use super::slot::Slot;

/// Size of a staging buffer that is kept for reuse.
pub(super) const STAGING: u64 = 256 << 10;
/// Unread timings kept.
const TIMINGS: usize = 4096;

pub(super) struct InFlight {
    pub(super) ticket: u64,
    pub(super) label: String,
    /// Number of the first command among all that were ever submitted, for breadcrumbs.
    pub(super) first_command: u32,
    slot: Slot,
    commands: Vec<Command>,
    staging: Vec<(Buffer, u64)>,
    profiled: bool,
}

impl InFlight {
    pub(super) fn command_name(&self, number: u32) -> Option<&str> {
        self.commands.get(number.wrapping_sub(self.first_command) as usize).map(Command::name)
    }
}

/// What the queue remembers, behind one lock.
#[derive(Default)]
pub(super) struct State {
    /// Ticket of the last submit.
    pub(super) last: u64,
    pub(super) stats: Stats,
    pub(super) in_flight: VecDeque<InFlight>,
    pub(super) timings: VecDeque<(u64, Vec<PassTime>)>,
    pub(super) staging: Vec<Buffer>,
    pub(super) tracker: Tracker,
    pub(super) checker: Option<HazardChecker>,
    /// Where breadcrumbs go.
    pub(super) crumbs: Option<Buffer>,
    commands: u32,
    slots: Vec<Slot>,
    /// The barriers of an earlier submit did not reach the device: begin with one over everything.
    unsure: bool,
}

/// Semaphores of a host to wait for and to signal, with values.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct External<'a> {
    pub(super) wait: &'a [(vk::Semaphore, u64)],
    pub(super) signal: &'a [(vk::Semaphore, u64)],
}

/// The barriers in front of every command, and those at the end for the host.
struct Plan {
    commands: Vec<Vec<Barrier>>,
    end: Vec<Barrier>,
}

impl State {
    /// Takes back what submits up to `completed` used. Returns what is to be dropped outside the lock.
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

    /// Submits a recording; the ticket is `self.last` afterwards.
    pub(super) fn submit(
        &mut self,
        device: &Device,
        timeline: vk::Semaphore,
        recorder: Recorder,
        external: External<'_>,
    ) -> Result<()> {
        for id in std::mem::take(&mut *super::device::lock(&device.freed)) {
            self.tracker.forget(id);
            self.checker.iter_mut().for_each(|c| c.forget(id));
        }
        if self.unsure {
            self.tracker.clear();
            self.checker.iter_mut().for_each(HazardChecker::clear);
        }
        let mut slot = match self.slots.pop() {
            Some(slot) => slot,
            None => Slot::new(device)?,
        };
        let first = self.commands;
        let done = self
            .plan(&recorder)
            .and_then(|plan| {
                encode(device, &mut slot, &recorder, &plan, self.unsure, self.crumbs.as_ref().map(|b| (b, first)))?;
                Ok(plan)
            })
            .and_then(|plan| {
                enqueue(device, slot.commands, timeline, self.last + 1, external)?;
                Ok(plan)
            });
        let plan = match done {
            Ok(plan) => plan,
            Err(error) => {
                self.unsure = true;
                // SAFETY: nothing was submitted from the slot.
                unsafe { slot.destroy(device) };
                return Err(error);
            }
        };
        self.unsure = false;
        self.last += 1;
        self.commands = self.commands.wrapping_add(recorder.commands.len() as u32);
        self.stats.submits += 1;
        for (command, barriers) in recorder.commands.iter().zip(&plan.commands) {
            self.stats.dispatches += u64::from(matches!(command, Command::Dispatch { .. }));
            self.stats.transfers += u64::from(!matches!(command, Command::Dispatch { .. }));
            self.stats.barriers += u64::from(!barriers.is_empty());
            self.stats.buffer_barriers += barriers.len() as u64;
            for buffer in command.buffers() {
                buffer.inner.last_use.store(self.last, Ordering::Release);
                buffer.inner.armed.store(true, Ordering::Release);
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
        });
        Ok(())
    }

    /// Infers the barriers of a recording and has the checker look at them.
    fn plan(&mut self, recorder: &Recorder) -> Result<Plan> {
        let mut number = 0;
        let mut plan = Plan { commands: Vec::with_capacity(recorder.commands.len()), end: Vec::new() };
        for (name, uses) in steps(recorder) {
            let mut barriers = self.tracker.step(&uses);
            if let Some(omitted) = recorder.omit_barrier {
                barriers.retain(|_| {
                    number += 1;
                    number - 1 != omitted
                });
            }
            if let Some(checker) = &mut self.checker {
                checker.command(&name, &barriers, &uses).map_err(|hazard| hazard_error(recorder, &hazard))?;
            }
            plan.commands.push(barriers);
        }
        plan.end = plan.commands.pop().unwrap_or_default();
        Ok(plan)
    }

    /// For every barrier of a recording: would the checker miss it? Returns their number and descriptions of those not missed.
    pub(super) fn missed_barriers(&self, recorder: &Recorder) -> (usize, Vec<String>) {
        let mut tracker = self.tracker.clone();
        let steps = steps(recorder);
        let barriers: Vec<Vec<Barrier>> = steps.iter().map(|(_, uses)| tracker.step(uses)).collect();
        let (mut total, mut unmissed) = (0, Vec::new());
        for i in 0..steps.len() {
            for j in 0..barriers[i].len() {
                total += 1;
                let mut fewer = barriers.clone();
                let gone = fewer[i].remove(j);
                let mut checker = self.checker.clone().unwrap_or_default();
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

/// Name and uses of every command, and last what the host reads.
fn steps(recorder: &Recorder) -> Vec<(String, Vec<BufferUse>)> {
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

fn everything() -> vk::MemoryBarrier2<'static> {
    vk::MemoryBarrier2::default()
        .src_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
        .src_access_mask(vk::AccessFlags2::MEMORY_WRITE)
        .dst_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
        .dst_access_mask(vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE)
}

/// Records a barrier over all memory.
///
/// # Safety
/// `commands` is being recorded.
pub(super) unsafe fn full_barrier(device: &Device, commands: vk::CommandBuffer) {
    let all = [everything()];
    let info = vk::DependencyInfo::default().memory_barriers(&all);
    // SAFETY: the caller's promise; synchronization2 is enabled.
    unsafe { device.raw.cmd_pipeline_barrier2(commands, &info) };
}

fn encode(
    device: &Device,
    slot: &mut Slot,
    recorder: &Recorder,
    plan: &Plan,
    unsure: bool,
    crumbs: Option<(&Buffer, u32)>,
) -> Result<()> {
    let raw = &device.raw;
    let commands = slot.commands;
    device.name(commands, &recorder.label);
    let queries = if recorder.profile { Some(slot.queries(device, recorder.commands.len() as u32 + 1)?) } else { None };
    let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
    // SAFETY: the slot is not in flight and was reset; every object recorded below is kept alive by the commands, which are
    // kept until the ticket has passed.
    unsafe {
        raw.begin_command_buffer(commands, &begin).named("vkBeginCommandBuffer")?;
        if unsure {
            full_barrier(device, commands);
        }
        canary::arm(device, commands, recorder.commands.iter().flat_map(Command::buffers));
        if let Some(pool) = queries {
            raw.cmd_reset_query_pool(commands, pool, 0, recorder.commands.len() as u32 + 1);
            raw.cmd_write_timestamp2(commands, vk::PipelineStageFlags2::ALL_COMMANDS, pool, 0);
        }
        for (i, command) in recorder.commands.iter().enumerate() {
            if let Some((crumbs, first)) = crumbs {
                full_barrier(device, commands);
                raw.cmd_fill_buffer(commands, crumbs.inner.raw, 0, 4, first.wrapping_add(i as u32));
                full_barrier(device, commands);
            }
            barrier(device, commands, recorder, &plan.commands[i]);
            begin_label(device, commands, command.name());
            one(device, slot, command)?;
            end_label(device, commands);
            if let Some(pool) = queries {
                raw.cmd_write_timestamp2(commands, vk::PipelineStageFlags2::ALL_COMMANDS, pool, i as u32 + 1);
            }
        }
        barrier(device, commands, recorder, &plan.end);
        raw.end_command_buffer(commands).named("vkEndCommandBuffer")
    }
}

/// # Safety
/// `commands` is being recorded and the buffers named by the barriers are among the recorder's.
unsafe fn barrier(device: &Device, commands: vk::CommandBuffer, recorder: &Recorder, barriers: &[Barrier]) {
    if barriers.is_empty() {
        return;
    }
    let find = |id: u64| recorder.commands.iter().flat_map(Command::buffers).find(|b| b.inner.id == id);
    let list: Vec<vk::BufferMemoryBarrier2<'_>> = barriers
        .iter()
        .filter_map(|b| {
            let buffer = find(b.buffer)?;
            Some(
                vk::BufferMemoryBarrier2::default()
                    .buffer(buffer.inner.raw)
                    .offset(b.range.start)
                    .size(b.range.end - b.range.start)
                    .src_stage_mask(b.src_stage)
                    .src_access_mask(b.src_access)
                    .dst_stage_mask(b.dst_stage)
                    .dst_access_mask(b.dst_access)
                    .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                    .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED),
            )
        })
        .collect();
    let info = vk::DependencyInfo::default().buffer_memory_barriers(&list);
    // SAFETY: the caller's promise; synchronization2 is enabled.
    unsafe { device.raw.cmd_pipeline_barrier2(commands, &info) };
}

/// # Safety
/// As [`encode`].
unsafe fn one(device: &Device, slot: &mut Slot, command: &Command) -> Result<()> {
    let raw = &device.raw;
    let commands = slot.commands;
    match command {
        Command::Dispatch { pipeline, buffers, push, counts } => {
            let pipeline = &pipeline.inner;
            let set = slot.set(device, pipeline.set_layout)?;
            let infos: Vec<vk::DescriptorBufferInfo> = buffers
                .iter()
                .map(|b| vk::DescriptorBufferInfo { buffer: b.buffer.inner.raw, offset: b.offset, range: b.bytes })
                .collect();
            let writes: Vec<vk::WriteDescriptorSet<'_>> = infos
                .iter()
                .enumerate()
                .map(|(i, info)| {
                    vk::WriteDescriptorSet::default()
                        .dst_set(set)
                        .dst_binding(i as u32)
                        .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                        .buffer_info(std::slice::from_ref(info))
                })
                .collect();
            // SAFETY: ranges were checked against buffers and limits when the command was recorded.
            unsafe {
                raw.update_descriptor_sets(&writes, &[]);
                raw.cmd_bind_pipeline(commands, vk::PipelineBindPoint::COMPUTE, pipeline.raw);
                let point = vk::PipelineBindPoint::COMPUTE;
                raw.cmd_bind_descriptor_sets(commands, point, pipeline.layout, 0, &[set], &[]);
                if !push.is_empty() {
                    raw.cmd_push_constants(commands, pipeline.layout, vk::ShaderStageFlags::COMPUTE, 0, push);
                }
                match counts {
                    Counts::Fixed(x, y) => raw.cmd_dispatch(commands, *x, *y, 1),
                    Counts::Indirect(buffer, offset) => raw.cmd_dispatch_indirect(commands, buffer.inner.raw, *offset),
                }
            }
        }
        Command::Fill { buffer, offset, bytes, value } => {
            // SAFETY: as above.
            unsafe { raw.cmd_fill_buffer(commands, buffer.inner.raw, *offset, *bytes, *value) };
        }
        Command::Copy { from, from_offset, to, to_offset, bytes, .. } => {
            let region = [vk::BufferCopy { src_offset: *from_offset, dst_offset: *to_offset, size: *bytes }];
            // SAFETY: as above; ranges within one buffer do not overlap.
            unsafe { raw.cmd_copy_buffer(commands, from.inner.raw, to.inner.raw, &region) };
        }
    }
    Ok(())
}

/// Hands a command buffer to the queue, inside the host's lock where there is one.
pub(super) fn enqueue(
    device: &Device,
    commands: vk::CommandBuffer,
    timeline: vk::Semaphore,
    ticket: u64,
    external: External<'_>,
) -> Result<()> {
    let point = |&(semaphore, value): &(vk::Semaphore, u64)| {
        vk::SemaphoreSubmitInfo::default()
            .semaphore(semaphore)
            .value(value)
            .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
    };
    let wait: Vec<_> = external.wait.iter().map(point).collect();
    let mut signal: Vec<_> = external.signal.iter().map(point).collect();
    signal.push(point(&(timeline, ticket)));
    let buffers = [vk::CommandBufferSubmitInfo::default().command_buffer(commands)];
    let info = vk::SubmitInfo2::default()
        .wait_semaphore_infos(&wait)
        .command_buffer_infos(&buffers)
        .signal_semaphore_infos(&signal);
    if let Some(host) = &device.host_lock {
        (host.lock)();
    }
    // SAFETY: the queue is ours, guarded by the caller's lock on the state, or the host's, guarded by its callbacks.
    let result = unsafe { device.raw.queue_submit2(device.queue, &[info], vk::Fence::null()) };
    if let Some(host) = &device.host_lock {
        (host.unlock)();
    }
    result.named("vkQueueSubmit2")
}

fn begin_label(device: &Device, commands: vk::CommandBuffer, name: &str) {
    if let (Some(debug), Ok(name)) = (&device.debug, std::ffi::CString::new(name)) {
        // SAFETY: `commands` is being recorded.
        unsafe {
            debug.cmd_begin_debug_utils_label(commands, &vk::DebugUtilsLabelEXT::default().label_name(&name));
        }
    }
}

fn end_label(device: &Device, commands: vk::CommandBuffer) {
    if let Some(debug) = &device.debug {
        // SAFETY: `commands` is being recorded, and a label was begun with every command.
        unsafe { debug.cmd_end_debug_utils_label(commands) };
    }
}

impl State {
    /// Destroys everything the queue holds.
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
