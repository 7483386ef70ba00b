//! Memory from a host's allocator, in place of the engine's own allocator.

use super::host_allocator::{HostAllocator, MemoryBlock, MemoryRequest};
use std::ffi::c_void;
use std::ptr::NonNull;

use ash::vk;

use super::device::Device;
use super::error::{Error, Result};
use super::host_allocator::Memory;

/// A checked block of a host's allocator, with its mapped address.
pub(super) struct HostBlock {
    pub(super) block: MemoryBlock,
    pub(super) mapped: Option<NonNull<c_void>>,
}

// SAFETY: the pointer addresses memory of this block only; `Buffer` guards every access through the pointer.
unsafe impl Send for HostBlock {}

/// Requests a block from a host's allocator and checks that the block is usable.
pub(super) fn ask(
    allocator: &dyn HostAllocator,
    types: &vk::PhysicalDeviceMemoryProperties,
    request: &MemoryRequest<'_>,
) -> Result<HostBlock> {
    let call = "the host's allocator";
    let block = allocator.allocate(request).map_err(|result| Error::Vulkan { call, result })?;
    let given = UncheckedBlock { allocator, block };
    let wrong = |what: &'static str| Err(Error::HostAllocator { buffer: request.name.to_owned(), what });
    let needs = request.requirements;
    if block.memory == vk::DeviceMemory::null() || block.size < needs.size {
        return wrong("the block is smaller than requested");
    }
    if !block.offset.is_multiple_of(needs.alignment.max(1)) {
        return wrong("the block's offset is not a multiple of the requested alignment");
    }
    let known = block.memory_type < types.memory_type_count.min(32);
    if !known || needs.memory_type_bits & (1 << block.memory_type) == 0 {
        return wrong("the block's memory type is not one of the requested types");
    }
    let mapped = if request.memory == Memory::Device {
        None
    } else {
        let flags = types.memory_types[block.memory_type as usize].property_flags;
        if !flags.contains(vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT) {
            return wrong("the block's memory type is not host-visible and coherent");
        }
        Some(allocator.map(&block).map_err(|result| Error::Vulkan { call, result })?)
    };
    std::mem::forget(given);
    Ok(HostBlock { block, mapped })
}

/// A block that `Drop` returns to the host's allocator, unless forgotten: for unusable blocks and for a panic of the
/// host.
struct UncheckedBlock<'a> {
    allocator: &'a dyn HostAllocator,
    block: MemoryBlock,
}

impl Drop for UncheckedBlock<'_> {
    fn drop(&mut self) {
        self.allocator.free(self.block);
    }
}

/// The memory types of a device.
pub(super) fn memory_types(device: &Device) -> vk::PhysicalDeviceMemoryProperties {
    // SAFETY: the physical device belongs to the instance.
    unsafe { device.instance.get_physical_device_memory_properties(device.physical) }
}
