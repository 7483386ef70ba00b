//! Memory from a host's allocator, in the place of our own.

use std::ffi::c_void;
use std::ptr::NonNull;

use ash::vk;

use super::device::Device;
use super::error::{Error, Result};
use super::memory::Memory;

/// What a buffer needs of the host's allocator.
#[derive(Clone, Copy, Debug)]
pub struct MemoryRequest<'a> {
    /// Name of the buffer.
    pub name: &'a str,
    /// What it is for. [`Memory::Upload`] and [`Memory::Readback`] need a host-visible and coherent memory type.
    pub memory: Memory,
    /// Size, alignment and possible memory types of the buffer, which has linear layout.
    pub requirements: vk::MemoryRequirements,
    /// The memory has to be allocated with `VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT`.
    pub device_address: bool,
}

/// A range of device memory that a host's allocator has given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryBlock {
    /// The memory object.
    pub memory: vk::DeviceMemory,
    /// First byte, a multiple of the alignment asked for.
    pub offset: u64,
    /// Bytes, at least as many as were asked for.
    pub size: u64,
    /// Index of its memory type, one of those asked for.
    pub memory_type: u32,
    /// Whatever the allocator wants to see again.
    pub token: u64,
}

/// A host's allocator. It is called from whichever thread makes or drops a buffer, one call at a time for each [`super::Gpu`], and
/// must not call the engine back.
///
/// # Safety
/// A block lies in memory of the adopted device, belongs to nobody else until it is freed, and stays where it is. The pointer
/// that [`Self::map`] gives is that of the block's first byte and valid until the block is freed.
pub unsafe trait HostAllocator: Send + Sync {
    /// Memory for one buffer. `VK_ERROR_OUT_OF_DEVICE_MEMORY` and `VK_ERROR_OUT_OF_HOST_MEMORY` become
    /// [`Error::OutOfDeviceMemory`].
    fn allocate(&self, request: &MemoryRequest<'_>) -> std::result::Result<MemoryBlock, vk::Result>;

    /// Where the host sees a block; asked once for each block that is not [`Memory::Device`], right after it was given.
    fn map(&self, block: &MemoryBlock) -> std::result::Result<NonNull<c_void>, vk::Result>;

    /// Takes a block back. The device uses it no more.
    fn free(&self, block: MemoryBlock);
}

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
