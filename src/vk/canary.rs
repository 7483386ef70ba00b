//! Guards of known bytes behind buffers. They lie inside the bound range, so that a shader that writes past the end writes
//! into the guard rather than having the write dropped by the driver's bounds check.

use std::sync::atomic::Ordering;

use ash::vk;

use super::buffer::Buffer;
use super::device::Device;
use super::submit::full_barrier;

/// The word that fills a guard.
pub(super) const PATTERN: u32 = 0xca9a_51e5;

/// Fills the guards that do not hold their pattern yet.
///
/// # Safety
/// `commands` is being recorded, and the buffers outlive it.
pub(super) unsafe fn arm<'a>(device: &Device, commands: vk::CommandBuffer, buffers: impl Iterator<Item = &'a Buffer>) {
    let mut seen = Vec::new();
    for buffer in buffers {
        let inner = &buffer.inner;
        if inner.armed.load(Ordering::Acquire) || seen.contains(&inner.id) {
            continue;
        }
        seen.push(inner.id);
        // SAFETY: the guard is the end of the buffer, a multiple of four bytes at a multiple of four.
        unsafe { device.raw.cmd_fill_buffer(commands, inner.raw, inner.capacity, inner.guard, PATTERN) };
    }
    if !seen.is_empty() {
        // SAFETY: the caller's promise.
        unsafe { full_barrier(device, commands) };
    }
}
