//! Counting what would be allocated, without allocating it: the code that allocates is the one place that knows.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::buffer::{Buffer, GUARD};
use super::error::Result;
use super::gpu::Gpu;
use super::host_allocator::Memory;
use super::lock::lock;

/// What drivers round allocations up to, about.
const ROUNDING: u64 = 256;

impl Gpu {
    /// A handle of the same device on which buffers are counted and not allocated. Nothing can be recorded with them:
    /// they have no bytes. Pipelines are real.
    pub fn planning(&self) -> Gpu {
        let mut counting = self.clone();
        counting.planned = Some(Arc::new(AtomicU64::new(0)));
        counting
    }

    /// Bytes of all buffers asked for through this handle that count towards [`super::MemoryUse::limit`]; 0 for a
    /// handle that is not of [`Self::planning`]. Buffers that were dropped count too.
    pub fn planned_bytes(&self) -> u64 {
        self.planned.as_ref().map_or(0, |total| total.load(Ordering::Relaxed))
    }

    /// Bytes of a buffer that count towards [`super::MemoryUse::limit`]:
    /// in memory of the host only where the device works in it.
    pub(crate) fn counted_bytes(&self, buffer: &Buffer) -> u64 {
        if self.counts(buffer.memory()) { buffer.size() } else { 0 }
    }

    fn counts(&self, memory: Memory) -> bool {
        lock(&self.device().memory).as_ref().is_some_and(|pool| pool.counts(memory))
    }

    /// Notes a buffer of a planning handle.
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
