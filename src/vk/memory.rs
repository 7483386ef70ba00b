//! Device memory: named allocations through gpu-allocator or a host's allocator, with a byte count and a limit.

use super::host_allocator::Memory;
use std::ffi::c_void;
use std::ptr::NonNull;
use std::sync::Arc;

use ash::vk;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme, Allocator, AllocatorCreateDesc};
use gpu_allocator::{AllocationError, AllocationSizes, MemoryLocation};

use super::allocator::{HostBlock, ask, memory_types};
use super::caps::{Addresses, DeviceKind};
use super::device::Device;
use super::error::{Error, Result};
use super::host_allocator::{HostAllocator, MemoryRequest};

/// Bytes allocated for buffers in device memory; on integrated GPUs and CPUs, for all buffers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MemoryUse {
    /// Bytes allocated now.
    pub current: u64,
    /// Most bytes allocated at one time since the start or since [`super::Gpu::restart_peak`].
    pub peak: u64,
    /// Most bytes that may be allocated.
    pub limit: u64,
}

/// The allocator that memory comes from.
enum MemorySource {
    Own(Box<Allocator>),
    Host { allocator: Arc<dyn HostAllocator>, types: Box<vk::PhysicalDeviceMemoryProperties>, device_address: bool },
}

/// Memory of one buffer.
pub(super) enum Block {
    Own(Allocation),
    Host(HostBlock),
}

impl Block {
    /// The memory object and the first byte in it.
    pub(super) fn place(&self) -> (vk::DeviceMemory, u64) {
        match self {
            // SAFETY: the caller only binds the memory; only the pool frees the memory.
            Block::Own(allocation) => (unsafe { allocation.memory() }, allocation.offset()),
            Block::Host(host) => (host.block.memory, host.block.offset),
        }
    }

    /// Host address of the first byte; `None` for memory that the host does not see.
    pub(super) fn mapped(&self) -> Option<NonNull<c_void>> {
        match self {
            Block::Own(allocation) => allocation.mapped_ptr(),
            Block::Host(host) => host.mapped,
        }
    }

    fn size(&self) -> u64 {
        match self {
            Block::Own(allocation) => allocation.size(),
            Block::Host(host) => host.block.size,
        }
    }
}

pub(super) struct MemoryPool {
    source: MemorySource,
    tally: MemoryUse,
    /// Whether the device works in the host's memory, so that host-visible buffers count too.
    unified: bool,
}

impl MemoryPool {
    pub(super) fn new(device: &Device, host: Option<Arc<dyn HostAllocator>>) -> Result<MemoryPool> {
        let mib = 1 << 20;
        let device_address = device.caps.addresses != Addresses::Never;
        let source = match host {
            Some(allocator) => MemorySource::Host { allocator, types: Box::new(memory_types(device)), device_address },
            None => MemorySource::Own(Box::new(Allocator::new(&AllocatorCreateDesc {
                instance: device.instance.clone(),
                device: device.raw.clone(),
                physical_device: device.physical,
                debug_settings: gpu_allocator::AllocatorDebugSettings::default(),
                buffer_device_address: device_address,
                allocation_sizes: AllocationSizes::new(32 * mib, 16 * mib),
            })?)),
        };
        let unified = matches!(device.caps.kind, DeviceKind::Cpu | DeviceKind::Integrated);
        Ok(MemoryPool { source, unified, tally: MemoryUse { limit: device.caps.memory_limit, ..Default::default() } })
    }

    pub(super) fn restart_peak(&mut self) {
        self.tally.peak = self.tally.current;
    }

    pub(super) fn tally(&self) -> MemoryUse {
        self.tally
    }

    pub(super) fn allocate(
        &mut self,
        name: &str,
        memory: Memory,
        requirements: vk::MemoryRequirements,
    ) -> Result<Block> {
        let out_of_memory = |tally: &MemoryUse| Error::OutOfDeviceMemory {
            requested: requirements.size,
            name: name.to_owned(),
            in_use: tally.current,
            limit: tally.limit,
        };
        if self.counts(memory) && self.tally.current.saturating_add(requirements.size) > self.tally.limit {
            return Err(out_of_memory(&self.tally));
        }
        let allocation = match &mut self.source {
            MemorySource::Host { allocator, types, device_address } => {
                let request = MemoryRequest { name, memory, requirements, device_address: *device_address };
                ask(allocator.as_ref(), types, &request).map(Block::Host).map_err(|error| match error {
                    Error::Vulkan {
                        result: vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_HOST_MEMORY,
                        ..
                    } => out_of_memory(&self.tally),
                    error => error,
                })?
            }
            MemorySource::Own(allocator) => {
                let location = match memory {
                    Memory::Device => MemoryLocation::GpuOnly,
                    // Both are copied once. Host-visible device memory (CpuToGpu) would reduce the memory for the
                    // model.
                    Memory::Upload | Memory::Readback => MemoryLocation::GpuToCpu,
                };
                let allocation_scheme = AllocationScheme::GpuAllocatorManaged;
                let wanted = AllocationCreateDesc { name, requirements, location, linear: true, allocation_scheme };
                Block::Own(allocator.allocate(&wanted).map_err(|error| match error {
                    AllocationError::OutOfMemory => out_of_memory(&self.tally),
                    error => Error::Allocator(error),
                })?)
            }
        };
        if self.counts(memory) {
            self.tally.current += allocation.size();
            self.tally.peak = self.tally.peak.max(self.tally.current);
        }
        Ok(allocation)
    }

    /// Whether allocations of this memory count towards the limit.
    pub(super) fn counts(&self, memory: Memory) -> bool {
        self.unified || memory == Memory::Device
    }

    pub(super) fn free(&mut self, memory: Memory, block: Block) {
        if self.counts(memory) {
            self.tally.current = self.tally.current.saturating_sub(block.size());
        }
        match (&mut self.source, block) {
            // Freeing fails only for an allocation of another allocator, which cannot occur.
            (MemorySource::Own(allocator), Block::Own(allocation)) => {
                let _ = allocator.free(allocation);
            }
            (MemorySource::Host { allocator, .. }, Block::Host(host)) => allocator.free(host.block),
            _ => {}
        }
    }
}
