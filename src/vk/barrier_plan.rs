//! The barriers of a recording, and barriers over all memory.

use super::barrier::{Barrier, BufferUse};
use super::device::Device;
use ash::vk;

/// The barriers in front of every command, the barriers at the end for host reads, and the ranges that the host may
/// read.
pub(super) struct BarrierPlan {
    pub(super) commands: Vec<Vec<Barrier>>,
    pub(super) end: Vec<Barrier>,
    pub(super) landings: Vec<BufferUse>,
}

pub(super) fn everything() -> vk::MemoryBarrier2<'static> {
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
