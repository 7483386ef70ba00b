//! Memory that the host sees, read and written while no commands use it.
//!
//! The queue's lock is held during the look at what is in flight and the copy: whoever submits meanwhile waits, so that
//! the device cannot begin to use the bytes half-way.

use std::sync::atomic::Ordering;

use super::buffer::Buffer;
use super::error::{Error, Result};
use super::gpu::Gpu;
use super::host_allocator::Memory;
use super::host_commands::Done;

impl Gpu {
    /// Everything in a buffer, after all that was submitted. Waits.
    pub fn read<T: bytemuck::Pod>(&self, buffer: &Buffer) -> Result<Vec<T>> {
        let count = buffer.size().checked_div(size_of::<T>() as u64).unwrap_or(0);
        self.read_at(buffer, 0, count as usize)
    }

    /// `count` values from byte `offset` on, after all that was submitted. Waits. Memory for read-back that commands of
    /// the host may write is refused, because their end is not known here: see [`super::HostRecording::finished`].
    pub fn read_at<T: bytemuck::Pod>(&self, buffer: &Buffer, offset: u64, count: usize) -> Result<Vec<T>> {
        buffer.of(self.device())?;
        let bytes = (count as u64).saturating_mul(size_of::<T>() as u64);
        buffer.inside(offset, bytes)?;
        if buffer.memory() == Memory::Readback {
            loop {
                buffer.not_lent()?;
                self.wait(self.ticket(buffer.inner.last_use.load(Ordering::Acquire)))?;
                if let Some(values) = self.load_idle(buffer, offset, count)? {
                    return Ok(values);
                }
            }
        }
        let landing = self.buffer("read-back", bytes, Memory::Readback)?;
        let mut recorder = self.recorder("read")?;
        recorder.copy(buffer, offset, &landing, 0, bytes)?;
        self.wait(recorder.submit()?)?;
        landing.load(0, count)
    }

    /// `count` values of a read-back buffer from byte `offset` on if what writes them has finished, which is `by` and
    /// whatever else was submitted or recorded for a host; never waits.
    pub fn read_ready<T: bytemuck::Pod>(
        &self,
        buffer: &Buffer,
        offset: u64,
        count: usize,
        by: impl Into<Done>,
    ) -> Result<Option<Vec<T>>> {
        buffer.of(self.device())?;
        let done = match by.into() {
            Done::Ticket(ticket) => self.is_done(ticket)?,
            Done::Executed(executed) => {
                executed.of(self.device())?;
                true
            }
        };
        if done { self.load_idle(buffer, offset, count) } else { Ok(None) }
    }

    /// The values, unless commands that may write them have not finished.
    fn load_idle<T: bytemuck::Pod>(&self, buffer: &Buffer, offset: u64, count: usize) -> Result<Option<Vec<T>>> {
        let completed = self.completed()?;
        let state = self.state();
        let bytes = (count as u64).saturating_mul(size_of::<T>() as u64);
        let range = offset..offset.saturating_add(bytes);
        if buffer.not_lent().is_err() || state.lands_later(completed, buffer.inner.id, &range) {
            return Ok(None);
        }
        buffer.load(offset, count).map(Some)
    }

    /// Writes host bytes to the beginning of a buffer of [`Memory::Upload`]: what is submitted from then on sees them.
    /// Waits for the last submit that uses the buffer where that has not finished yet.
    /// Refused for a buffer that commands of the host use.
    pub fn store(&self, buffer: &Buffer, bytes: &[u8]) -> Result<()> {
        buffer.of(self.device())?;
        if buffer.memory() != Memory::Upload {
            return Err(buffer.bad_range(0, bytes.len() as u64, "only memory for uploads is written straight"));
        }
        loop {
            let last = self.ticket(buffer.inner.last_use.load(Ordering::Acquire));
            if !self.is_done(last)? {
                self.wait(last)?;
            }
            let _queue = self.state();
            buffer.not_lent()?;
            if buffer.inner.last_use.load(Ordering::Acquire) == last.value() {
                return buffer.store(0, bytes);
            }
        }
    }
}

impl Buffer {
    /// Checks that no command buffer of a host may still use it.
    fn not_lent(&self) -> Result<()> {
        match self.inner.lent.load(Ordering::Acquire) {
            0 => Ok(()),
            _ => Err(Error::InHostCommands { buffer: self.name().to_owned() }),
        }
    }
}
