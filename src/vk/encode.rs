//! Encodes commands and their barriers into a command buffer, and submits the command buffer to the queue.

use super::barrier_plan::{everything, full_barrier};
use std::any::Any;
use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};

use ash::vk;

use super::barrier::Barrier;
use super::barrier_plan::BarrierPlan;
use super::buffer::Buffer;
use super::canary;
use super::device::Device;
use super::error::{Error, Named, Result};
use super::lock::QueueLock;
use super::recorder::{Command, Counts, Recorder};
use super::slot::Slot;
use super::submit_sync::{HostSemaphore, SubmitSync};

/// Like [`full_barrier`], and also makes writes visible to the host: after a device loss no semaphore does.
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

/// Vulkan buffers by buffer number.
type Handles = HashMap<u64, vk::Buffer>;

/// Records the commands of a recording into a slot's command buffer.
pub(super) fn encode(
    device: &Device,
    slot: &mut Slot,
    recorder: &Recorder,
    plan: &BarrierPlan,
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
/// `commands` is being recorded. Everything that the recording and the slot hold outlives the last execution of
/// `commands`.
pub(super) unsafe fn encode_for_host(
    device: &Device,
    slot: &mut Slot,
    commands: vk::CommandBuffer,
    recorder: &Recorder,
    plan: &BarrierPlan,
) -> Result<()> {
    // SAFETY: the caller's promise.
    unsafe {
        full_barrier(device, commands);
        body(device, slot, commands, recorder, plan, Marks::default())?;
        full_barrier(device, commands);
    }
    Ok(())
}

/// Written besides the commands: breadcrumbs (with the number of the first command) and timestamps.
#[derive(Clone, Copy, Default)]
struct Marks<'a> {
    crumbs: Option<(&'a Buffer, u32)>,
    queries: Option<vk::QueryPool>,
}

/// # Safety
/// `commands` is being recorded. The recording's commands and the slot keep every recorded object alive; the caller
/// keeps both until `commands` has run.
unsafe fn body(
    device: &Device,
    slot: &mut Slot,
    commands: vk::CommandBuffer,
    recorder: &Recorder,
    plan: &BarrierPlan,
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
/// `commands` is being recorded, and `handles` has the buffers named by the barriers.
unsafe fn barrier(device: &Device, commands: vk::CommandBuffer, handles: &Handles, barriers: &[Barrier]) {
    if barriers.is_empty() {
        return;
    }
    // The pipeline variant decides whether a shader reads through a storage buffer or a texel buffer; allow both reads.
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
/// See [`body`].
unsafe fn one(device: &Device, slot: &mut Slot, commands: vk::CommandBuffer, command: &Command) -> Result<()> {
    let raw = &device.raw;
    match command {
        Command::Dispatch { pipeline, mode, buffers, table, push, counts } => {
            let variant = pipeline.inner.variant(*mode).ok_or_else(|| Error::Interface {
                kernel: pipeline.name(),
                what: format!("its pipeline variant for {mode:?} was not created"),
            })?;
            let set = slot.set(device, variant.set_layout)?;
            let info =
                |buffer: &Buffer, offset, range| vk::DescriptorBufferInfo { buffer: buffer.inner.raw, offset, range };
            let infos: Vec<vk::DescriptorBufferInfo> = match table {
                Some(table) => vec![info(&table.buffer, table.offset, table.bytes)],
                None => buffers.iter().map(|b| info(&b.buffer, b.offset, b.bytes)).collect(),
            };
            let views = mode.texels(&pipeline.inner.kernel).map_or(&[][..], |texels| texels.views);
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
            // SAFETY: the ranges were checked against buffers and limits when the command was recorded.
            unsafe {
                raw.update_descriptor_sets(&writes, &[]);
                raw.cmd_bind_pipeline(commands, vk::PipelineBindPoint::COMPUTE, variant.raw);
                let point = vk::PipelineBindPoint::COMPUTE;
                raw.cmd_bind_descriptor_sets(commands, point, variant.layout, 0, &[set], &[]);
                if !push.is_empty() {
                    raw.cmd_push_constants(commands, variant.layout, vk::ShaderStageFlags::COMPUTE, 0, push);
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

/// Outcome of handing a command buffer to the queue.
pub(super) enum QueueHandover {
    /// Submitted. `Err` is a panic of the host's `unlock`.
    Over(std::thread::Result<()>),
    /// Not submitted, because the host's `lock` panicked.
    Not(Box<dyn Any + Send>),
}

/// Submits a command buffer to the queue, inside the host's lock if the queue has one.
pub(super) fn enqueue(
    device: &Device,
    commands: vk::CommandBuffer,
    timeline: vk::Semaphore,
    ticket: u64,
    order: SubmitSync<'_>,
) -> Result<QueueHandover> {
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
    // Unwind safe: the callbacks get no reference to the engine's data, so a panic leaves no half-done state.
    let call = |callback: fn(&QueueLock) -> &Callback| {
        catch_unwind(AssertUnwindSafe(|| device.host_lock.iter().for_each(|host| callback(host)())))
    };
    if let Err(panic) = call(|host| &host.lock) {
        return Ok(QueueHandover::Not(panic));
    }
    // SAFETY: the caller's lock on the state guards an owned queue, and the host's callbacks guard a host's queue.
    let result = unsafe { device.raw.queue_submit2(device.queue, &[info], vk::Fence::null()) };
    let unlocked = call(|host| &host.unlock);
    result.named("vkQueueSubmit2")?;
    Ok(QueueHandover::Over(unlocked))
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
