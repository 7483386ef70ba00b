//! Counts the memory that buffers would need, without allocating: the allocating code itself does the counting.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::buffer::{Buffer, GUARD};
use super::error::Result;
use super::gpu::Gpu;
use super::host_allocator::Memory;
use super::lock::lock;

/// Approximate granularity in bytes to which drivers round allocations up.
const ROUNDING: u64 = 256;

impl Gpu {
    /// A handle of the same device that counts buffers instead of allocating them. These buffers have no bytes, so
    /// nothing can be recorded with them. Pipelines are real.
    pub fn planning(&self) -> Gpu {
        let mut counting = self.clone();
        counting.planned = Some(Arc::new(AtomicU64::new(0)));
        counting
    }

    /// Bytes of all buffers requested through this handle that count towards [`super::MemoryUse::limit`], including
    /// dropped buffers; 0 for a handle not made by [`Self::planning`].
    pub fn planned_bytes(&self) -> u64 {
        self.planned.as_ref().map_or(0, |total| total.load(Ordering::Relaxed))
    }

    /// Bytes of a buffer that count towards [`super::MemoryUse::limit`]. A host-visible buffer counts only on a device
    /// with unified memory.
    pub(crate) fn counted_bytes(&self, buffer: &Buffer) -> u64 {
        if self.counts(buffer.memory()) { buffer.size() } else { 0 }
    }

    fn counts(&self, memory: Memory) -> bool {
        lock(&self.device().memory).as_ref().is_some_and(|pool| pool.counts(memory))
    }

    /// Adds a buffer of a planning handle to the count.
    pub(super) fn plan_buffer(&self, total: &AtomicU64, name: &str, bytes: u64, memory: Memory) -> Result<Buffer> {
        let device = self.device();
        let buffer = Buffer::unallocated(device, name, bytes, memory)?;
        if self.counts(memory) {
            let guard = if device.canaries && memory == Memory::Device { GUARD } else { 0 };
            total.fetch_add((bytes.max(16) + guard).next_multiple_of(ROUNDING), Ordering::Relaxed);
        }
        Ok(buffer)
    }
}
