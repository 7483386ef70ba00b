//! Guards of known bytes after buffers. A guard lies inside the bound range, so that a shader's write past the end
//! reaches the guard instead of being dropped by the driver's bounds check.

use std::sync::atomic::Ordering;

use ash::vk;

use super::barrier_plan::full_barrier;
use super::buffer::{Buffer, GARBAGE, GUARD};
use super::device::Device;
use super::error::{Error, Result};
use super::gpu::Gpu;
use super::host_allocator::Memory;
use super::recorder::Command;

/// The word that fills a guard.
pub(super) const PATTERN: u32 = 0xca9a_51e5;

/// Fills the guards that do not hold their pattern yet, and fills new buffers with garbage when
/// [`super::OpenOptions::garbage`] is on.
///
/// # Safety
/// `commands` is being recorded, and the buffers outlive its execution.
pub(super) unsafe fn arm<'a>(device: &Device, commands: vk::CommandBuffer, buffers: impl Iterator<Item = &'a Buffer>) {
    let mut seen = Vec::new();
    for buffer in buffers {
        let inner = &buffer.inner;
        let (armed, filled) = (inner.armed.load(Ordering::Acquire), inner.filled.load(Ordering::Acquire));
        if armed && filled || seen.contains(&inner.id) {
            continue;
        }
        if seen.is_empty() {
            // A guard that is armed again may have been written by earlier commands.
            // SAFETY: the caller's promise.
            unsafe { full_barrier(device, commands) };
        }
        seen.push(inner.id);
        if !armed {
            // SAFETY: the guard is the end of the buffer; offset and size are multiples of four bytes.
            unsafe { device.raw.cmd_fill_buffer(commands, inner.raw, inner.capacity, inner.guard, PATTERN) };
        }
        if !filled {
            // SAFETY: everything before the guard, a multiple of four bytes.
            unsafe { device.raw.cmd_fill_buffer(commands, inner.raw, 0, inner.capacity, GARBAGE) };
        }
    }
    if !seen.is_empty() {
        // SAFETY: the caller's promise.
        unsafe { full_barrier(device, commands) };
    }
}

impl Gpu {
    /// Waits, and fails with [`Error::Overrun`] at the first write past the end of a buffer. Does nothing when
    /// [`super::OpenOptions::canaries`] is off.
    pub fn check_canaries(&self) -> Result<()> {
        let guarded: Vec<Buffer> = self
            .live_buffers()
            .into_iter()
            .filter(|b| b.inner.guard > 0 && b.inner.armed.load(Ordering::Acquire))
            .collect();
        if guarded.is_empty() {
            return Ok(());
        }
        let landing = self.buffer("guards", guarded.len() as u64 * GUARD, Memory::Readback)?;
        let mut recorder = self.recorder("check guards")?;
        for (i, buffer) in guarded.iter().enumerate() {
            recorder.commands.push(Command::Copy {
                from: buffer.clone(),
                from_offset: buffer.inner.capacity,
                to: landing.clone(),
                to_offset: i as u64 * GUARD,
                bytes: GUARD,
                staged: false,
            });
        }
        self.wait(recorder.submit()?)?;
        let words: Vec<u32> = landing.load(0, (landing.size() / 4) as usize)?;
        for (buffer, guard) in guarded.iter().zip(words.chunks_exact((GUARD / 4) as usize)) {
            if let Some(at) = guard.iter().position(|&word| word != PATTERN) {
                // Arm the guard again, so that one overrun is reported once.
                buffer.inner.armed.store(false, Ordering::Release);
                return Err(Error::Overrun {
                    buffer: buffer.name().to_owned(),
                    size: buffer.size(),
                    offset: buffer.inner.capacity + 4 * at as u64,
                    value: guard[at],
                });
            }
        }
        Ok(())
    }
}
