//! Device memory: named allocations through gpu-allocator, a tally of our own, and a limit.

use ash::vk;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme, Allocator, AllocatorCreateDesc};
use gpu_allocator::{AllocationError, AllocationSizes, MemoryLocation};

use super::caps::{Addresses, DeviceKind};
use super::device::Device;
use super::error::{Error, Result};

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

/// Bytes allocated for buffers in device memory, which on integrated GPUs and CPUs is all memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MemoryUse {
    /// Now.
    pub current: u64,
    /// At most so far.
    pub peak: u64,
    /// What may be allocated.
    pub limit: u64,
}

pub(super) struct MemoryPool {
    allocator: Allocator,
    tally: MemoryUse,
    /// The device works in the host's memory, so that host-visible buffers count as well.
    unified: bool,
}

impl MemoryPool {
    pub(super) fn new(device: &Device) -> Result<MemoryPool> {
        let mib = 1 << 20;
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: device.instance.clone(),
            device: device.raw.clone(),
            physical_device: device.physical,
            debug_settings: gpu_allocator::AllocatorDebugSettings::default(),
            buffer_device_address: device.caps.addresses != Addresses::Never,
            allocation_sizes: AllocationSizes::new(32 * mib, 16 * mib),
        })?;
        let unified = matches!(device.caps.kind, DeviceKind::Cpu | DeviceKind::Integrated);
        Ok(MemoryPool {
            allocator,
            unified,
            tally: MemoryUse { limit: device.caps.memory_limit, ..Default::default() },
        })
    }

    pub(super) fn restart_peak(&mut self) {
        self.tally.peak = self.tally.current;
    }

    pub(super) fn tally(&self) -> MemoryUse {
        self.tally
    }

    pub(super) fn forget_peak(&mut self) {
        self.tally.peak = self.tally.current;
    }

    pub(super) fn allocate(
        &mut self,
        name: &str,
        memory: Memory,
        requirements: vk::MemoryRequirements,
    ) -> Result<Allocation> {
        let out_of_memory = |tally: &MemoryUse| Error::OutOfDeviceMemory {
            requested: requirements.size,
            name: name.to_owned(),
            in_use: tally.current,
            limit: tally.limit,
        };
        if self.counts(memory) && self.tally.current.saturating_add(requirements.size) > self.tally.limit {
            return Err(out_of_memory(&self.tally));
        }
        let allocation = self
            .allocator
            .allocate(&AllocationCreateDesc {
                name,
                requirements,
                location: match memory {
                    Memory::Device => MemoryLocation::GpuOnly,
                    Memory::Upload => MemoryLocation::CpuToGpu,
                    Memory::Readback => MemoryLocation::GpuToCpu,
                },
                linear: true,
                allocation_scheme: AllocationScheme::GpuAllocatorManaged,
            })
            .map_err(|error| match error {
                AllocationError::OutOfMemory => out_of_memory(&self.tally),
                error => Error::Allocator(error),
            })?;
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

    pub(super) fn free(&mut self, memory: Memory, allocation: Allocation) {
        if self.counts(memory) {
            self.tally.current = self.tally.current.saturating_sub(allocation.size());
        }
        // Freeing fails only for an allocation of another allocator, which cannot be.
        let _ = self.allocator.free(allocation);
    }
}
