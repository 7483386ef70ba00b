//! From commands and their barriers to a command buffer, and from that to the queue.

use super::barrier_plan::{everything, full_barrier};
use std::any::Any;
use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};

use ash::vk;

use super::barrier::Barrier;
use super::barrier_plan::Plan;
use super::buffer::Buffer;
use super::canary;
use super::device::Device;
use super::error::{Error, Named, Result};
use super::lock::QueueLock;
use super::recorder::{Command, Counts, Recorder};
use super::slot::Slot;
use super::submit_sync::{HostSemaphore, SubmitSync};

/// As [`full_barrier`], and the host sees what was written: after a loss no semaphore makes it visible.
///
/// # Safety
/// `commands` is being recorded.
unsafe fn crumb_barrier(device: &Device, commands: vk::CommandBuffer) {
    let mut all = everything();
    all.dst_stage_mask |= vk::PipelineStageFlags2::HOST;
    all.dst_access_mask |= vk::AccessFlags2::HOST_READ;
    let all = [all];
    let info = vk::DependencyInfo::default().memory_barriers(&all);
    // SAFETY: the caller's promise; synchronization2 is enabled.
    unsafe { device.raw.cmd_pipeline_barrier2(commands, &info) };
}

/// Vulkan buffers by number.
type Handles = HashMap<u64, vk::Buffer>;

/// Records the commands of a recording into a slot's command buffer.
pub(super) fn encode(
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
    // SAFETY: the slot is not in flight and was reset.
    unsafe {
        raw.begin_command_buffer(commands, &begin).named("vkBeginCommandBuffer")?;
        if unsure {
            full_barrier(device, commands);
        }
        body(device, slot, commands, recorder, plan, Marks { crumbs, queries })?;
        raw.end_command_buffer(commands).named("vkEndCommandBuffer")
    }
}

/// Records the commands of a recording into a host's command buffer, between two barriers over everything.
///
/// # Safety
/// `commands` is being recorded, and what the recording and the slot hold outlives its last execution.
pub(super) unsafe fn encode_for_host(
    device: &Device,
    slot: &mut Slot,
    commands: vk::CommandBuffer,
    recorder: &Recorder,
    plan: &Plan,
) -> Result<()> {
    // SAFETY: the caller's promise.
    unsafe {
        full_barrier(device, commands);
        body(device, slot, commands, recorder, plan, Marks::default())?;
        full_barrier(device, commands);
    }
    Ok(())
}

/// What is written beside the commands: breadcrumbs with the number of the first command, and timestamps.
#[derive(Clone, Copy, Default)]
struct Marks<'a> {
    crumbs: Option<(&'a Buffer, u32)>,
    queries: Option<vk::QueryPool>,
}

/// # Safety
/// `commands` is being recorded. Every object recorded here is kept alive by the recording's commands and by the slot,
/// which the caller keeps until it has run.
unsafe fn body(
    device: &Device,
    slot: &mut Slot,
    commands: vk::CommandBuffer,
    recorder: &Recorder,
    plan: &Plan,
    marks: Marks<'_>,
) -> Result<()> {
    let raw = &device.raw;
    // SAFETY: the caller's promise.
    unsafe {
        canary::arm(device, commands, recorder.commands.iter().flat_map(Command::buffers));
        if let Some(pool) = marks.queries {
            raw.cmd_reset_query_pool(commands, pool, 0, recorder.commands.len() as u32 + 1);
            raw.cmd_write_timestamp2(commands, vk::PipelineStageFlags2::ALL_COMMANDS, pool, 0);
        }
        let handles: Handles = recorder
            .commands
            .iter()
            .flat_map(Command::buffers)
            .map(|buffer| (buffer.inner.id, buffer.inner.raw))
            .collect();
        for (i, command) in recorder.commands.iter().enumerate() {
            if let Some((crumbs, first)) = marks.crumbs {
                full_barrier(device, commands);
                raw.cmd_fill_buffer(commands, crumbs.inner.raw, 0, 4, first.wrapping_add(i as u32));
                crumb_barrier(device, commands);
            }
            barrier(device, commands, &handles, &plan.commands[i]);
            begin_label(device, commands, command.name());
            one(device, slot, commands, command)?;
            end_label(device, commands);
            if let Some(pool) = marks.queries {
                raw.cmd_write_timestamp2(commands, vk::PipelineStageFlags2::ALL_COMMANDS, pool, i as u32 + 1);
            }
        }
        barrier(device, commands, &handles, &plan.end);
    }
    Ok(())
}

/// # Safety
/// `commands` is being recorded and the buffers named by the barriers are among the recorder's.
unsafe fn barrier(device: &Device, commands: vk::CommandBuffer, handles: &Handles, barriers: &[Barrier]) {
    if barriers.is_empty() {
        return;
    }
    // Whether a shader reads through one descriptor or the other is its form's business.
    let texels = device.caps.texels;
    let list: Vec<vk::BufferMemoryBarrier2<'_>> = barriers
        .iter()
        .filter_map(|b| {
            let buffer = handles.get(&b.buffer)?;
            Some(
                vk::BufferMemoryBarrier2::default()
                    .buffer(*buffer)
                    .offset(b.range.start)
                    .size(b.range.end - b.range.start)
                    .src_stage_mask(b.src_stage)
                    .src_access_mask(b.src_access)
                    .dst_stage_mask(b.dst_stage)
                    .dst_access_mask(if texels && b.dst_access.contains(vk::AccessFlags2::SHADER_STORAGE_READ) {
                        b.dst_access | vk::AccessFlags2::SHADER_SAMPLED_READ
                    } else {
                        b.dst_access
                    })
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
/// As [`body`].
unsafe fn one(device: &Device, slot: &mut Slot, commands: vk::CommandBuffer, command: &Command) -> Result<()> {
    let raw = &device.raw;
    match command {
        Command::Dispatch { pipeline, reach, buffers, table, push, counts } => {
            let form = pipeline.inner.form(*reach).ok_or_else(|| Error::Interface {
                kernel: pipeline.name(),
                what: format!("its form by {reach:?} was not made"),
            })?;
            let set = slot.set(device, form.set_layout)?;
            let info =
                |buffer: &Buffer, offset, range| vk::DescriptorBufferInfo { buffer: buffer.inner.raw, offset, range };
            let infos: Vec<vk::DescriptorBufferInfo> = match table {
                Some(table) => vec![info(&table.buffer, table.offset, table.bytes)],
                None => buffers.iter().map(|b| info(&b.buffer, b.offset, b.bytes)).collect(),
            };
            let views = reach.texels(&pipeline.inner.kernel).map_or(&[][..], |texels| texels.views);
            let texels = views
                .iter()
                .map(|view| {
                    let bound = &buffers[view.binding as usize];
                    bound.buffer.texels(bound.offset, bound.bytes, view.format)
                })
                .collect::<Result<Vec<vk::BufferView>>>()?;
            let to = |binding: u32| vk::WriteDescriptorSet::default().dst_set(set).dst_binding(binding);
            let of_buffers =
                infos.iter().zip(0..).filter(|(_, i)| !views.iter().any(|view| view.at == *i)).map(|(info, i)| {
                    to(i).descriptor_type(vk::DescriptorType::STORAGE_BUFFER).buffer_info(std::slice::from_ref(info))
                });
            let of_texels = views.iter().zip(&texels).map(|(view, texels)| {
                let texels = std::slice::from_ref(texels);
                to(view.at).descriptor_type(vk::DescriptorType::UNIFORM_TEXEL_BUFFER).texel_buffer_view(texels)
            });
            let writes: Vec<vk::WriteDescriptorSet<'_>> = of_buffers.chain(of_texels).collect();
            // SAFETY: ranges were checked against buffers and limits when the command was recorded.
            unsafe {
                raw.update_descriptor_sets(&writes, &[]);
                raw.cmd_bind_pipeline(commands, vk::PipelineBindPoint::COMPUTE, form.raw);
                let point = vk::PipelineBindPoint::COMPUTE;
                raw.cmd_bind_descriptor_sets(commands, point, form.layout, 0, &[set], &[]);
                if !push.is_empty() {
                    raw.cmd_push_constants(commands, form.layout, vk::ShaderStageFlags::COMPUTE, 0, push);
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

/// One of the two callbacks of a [`QueueLock`].
type Callback = Box<dyn Fn() + Send + Sync>;

/// Whether a command buffer was handed to the queue.
pub(super) enum Handed {
    /// It was; with the panic of the host's unlocking, where that panicked.
    Over(std::thread::Result<()>),
    /// It was not, because the host's locking panicked.
    Not(Box<dyn Any + Send>),
}

/// Hands a command buffer to the queue, inside the host's lock where there is one.
pub(super) fn enqueue(
    device: &Device,
    commands: vk::CommandBuffer,
    timeline: vk::Semaphore,
    ticket: u64,
    order: SubmitSync<'_>,
) -> Result<Handed> {
    let point = |semaphore: vk::Semaphore, value: u64| {
        vk::SemaphoreSubmitInfo::default()
            .semaphore(semaphore)
            .value(value)
            .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
    };
    let points = |all: &[HostSemaphore]| all.iter().map(|p| point(p.semaphore(), p.value())).collect();
    let wait: Vec<vk::SemaphoreSubmitInfo<'_>> = points(order.wait);
    let mut signal: Vec<vk::SemaphoreSubmitInfo<'_>> = points(order.signal);
    signal.push(point(timeline, ticket));
    let buffers = [vk::CommandBufferSubmitInfo::default().command_buffer(commands)];
    let info = vk::SubmitInfo2::default()
        .wait_semaphore_infos(&wait)
        .command_buffer_infos(&buffers)
        .signal_semaphore_infos(&signal);
    // Nothing that is half done is seen by whoever goes on after a panic: the callbacks get nothing of ours.
    let call = |callback: fn(&QueueLock) -> &Callback| {
        catch_unwind(AssertUnwindSafe(|| device.host_lock.iter().for_each(|host| callback(host)())))
    };
    if let Err(panic) = call(|host| &host.lock) {
        return Ok(Handed::Not(panic));
    }
    // SAFETY: the queue is ours, guarded by the caller's lock on the state, or the host's, guarded by its callbacks.
    let result = unsafe { device.raw.queue_submit2(device.queue, &[info], vk::Fence::null()) };
    let unlocked = call(|host| &host.unlock);
    result.named("vkQueueSubmit2")?;
    Ok(Handed::Over(unlocked))
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
