//! Where buffers live, and memory that a host gives.

use ash::vk;
use std::ffi::c_void;
use std::ptr::NonNull;

/// Where a buffer lives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Memory {
    /// Fast for the device.
    Device,
    /// Written by the host.
    Upload,
    /// Read by the host.
    Readback,
}

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

/// A host's allocator. It is called from whichever thread makes or drops a buffer, one call at a time for each
/// [`super::Gpu`], and must not call the engine back.
///
/// # Safety
/// A block lies in memory of the adopted device, belongs to nobody else until it is freed, and stays where it is. The
/// pointer that [`Self::map`] gives is that of the block's first byte and valid until the block is freed.
pub unsafe trait HostAllocator: Send + Sync {
    /// Memory for one buffer. `VK_ERROR_OUT_OF_DEVICE_MEMORY` and `VK_ERROR_OUT_OF_HOST_MEMORY` become
    /// [`super::Error::OutOfDeviceMemory`].
    fn allocate(&self, request: &MemoryRequest<'_>) -> std::result::Result<MemoryBlock, vk::Result>;

    /// Where the host sees a block; asked once for each block that is not [`Memory::Device`], right after it was given.
    fn map(&self, block: &MemoryBlock) -> std::result::Result<NonNull<c_void>, vk::Result>;

    /// Takes a block back. The device uses it no more.
    fn free(&self, block: MemoryBlock);
}
