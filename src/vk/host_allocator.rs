//! Kinds of buffer memory, and the interface of a host's allocator.

use ash::vk;
use std::ffi::c_void;
use std::ptr::NonNull;

/// Kind of memory of a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Memory {
    /// Device memory, fast for the device.
    Device,
    /// Host-visible memory that the host writes.
    Upload,
    /// Host-visible memory that the host reads.
    Readback,
}

/// A request for memory of one buffer to the host's allocator.
#[derive(Clone, Copy, Debug)]
pub struct MemoryRequest<'a> {
    /// Name of the buffer.
    pub name: &'a str,
    /// Kind of memory. [`Memory::Upload`] and [`Memory::Readback`] need a host-visible, host-coherent memory type.
    pub memory: Memory,
    /// Size, alignment and allowed memory types. The resource is a buffer, so linear.
    pub requirements: vk::MemoryRequirements,
    /// Whether the memory has to be allocated with `VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT`.
    pub device_address: bool,
}

/// A range of device memory from a host's allocator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryBlock {
    /// The memory object.
    pub memory: vk::DeviceMemory,
    /// First byte; a multiple of the requested alignment.
    pub offset: u64,
    /// Size in bytes; at least the requested size.
    pub size: u64,
    /// Index of the memory type; one of the requested types.
    pub memory_type: u32,
    /// Free for the allocator's own use.
    pub token: u64,
}

/// A host's allocator. Called from any thread that creates or drops a buffer, one call at a time per [`super::Gpu`].
/// Must not call the engine.
///
/// # Safety
/// A block lies in memory of the adopted device, has no other user until freed, and does not move. The pointer from
/// [`Self::map`] points to the block's first byte and stays valid until the block is freed.
pub unsafe trait HostAllocator: Send + Sync {
    /// Allocates memory for one buffer. `VK_ERROR_OUT_OF_DEVICE_MEMORY` and `VK_ERROR_OUT_OF_HOST_MEMORY` become
    /// [`super::Error::OutOfDeviceMemory`].
    fn allocate(&self, request: &MemoryRequest<'_>) -> std::result::Result<MemoryBlock, vk::Result>;

    /// Host address of a block. Called once per block of [`Memory::Upload`] or [`Memory::Readback`], right after the
    /// allocation.
    fn map(&self, block: &MemoryBlock) -> std::result::Result<NonNull<c_void>, vk::Result>;

    /// Frees a block. The device no longer uses the block.
    fn free(&self, block: MemoryBlock);
}
