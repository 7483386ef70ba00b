//! Memory from a host's allocator, in the place of our own.

use super::host_allocator::{HostAllocator, MemoryBlock, MemoryRequest};
use std::ffi::c_void;
use std::ptr::NonNull;

use ash::vk;

use super::device::Device;
use super::error::{Error, Result};
use super::host_allocator::Memory;

/// A block of a host's allocator with its address, checked.
pub(super) struct HostBlock {
    pub(super) block: MemoryBlock,
    pub(super) mapped: Option<NonNull<c_void>>,
}

// SAFETY: the pointer is an address of memory that belongs to the block alone; `Buffer` guards every access through it.
unsafe impl Send for HostBlock {}

/// Asks a host's allocator, and checks that what it gives can be used.
pub(super) fn ask(
    allocator: &dyn HostAllocator,
    types: &vk::PhysicalDeviceMemoryProperties,
    request: &MemoryRequest<'_>,
) -> Result<HostBlock> {
    let call = "the host's allocator";
    let block = allocator.allocate(request).map_err(|result| Error::Vulkan { call, result })?;
    let given = Given { allocator, block };
    let wrong = |what: &'static str| Err(Error::HostAllocator { buffer: request.name.to_owned(), what });
    let needs = request.requirements;
    if block.memory == vk::DeviceMemory::null() || block.size < needs.size {
        return wrong("it gave less memory than asked for");
    }
    if !block.offset.is_multiple_of(needs.alignment.max(1)) {
        return wrong("the block does not begin where its alignment asks");
    }
    let known = block.memory_type < types.memory_type_count.min(32);
    if !known || needs.memory_type_bits & (1 << block.memory_type) == 0 {
        return wrong("the block's memory type is none of those asked for");
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

/// A block that is given back unless it is forgotten: where it cannot be used, and where the host panics.
struct Given<'a> {
    allocator: &'a dyn HostAllocator,
    block: MemoryBlock,
}

impl Drop for Given<'_> {
    fn drop(&mut self) {
        self.allocator.free(self.block);
    }
}

/// The memory types of a device.
pub(super) fn memory_types(device: &Device) -> vk::PhysicalDeviceMemoryProperties {
    // SAFETY: the physical device belongs to the instance.
    unsafe { device.instance.get_physical_device_memory_properties(device.physical) }
}
