//! Host reads and writes of host-visible buffers while no commands use the buffers.
//!
//! A read or write holds the queue's lock from the check of the work in flight to the end of the copy. Submits wait
//! meanwhile, so that the device cannot start to use the bytes during the copy.

use std::sync::atomic::Ordering;

use super::buffer::Buffer;
use super::error::{Error, Result};
use super::gpu::Gpu;
use super::host_allocator::Memory;
use super::host_commands::Done;

impl Gpu {
    /// The whole content of a buffer, after everything submitted so far. Waits.
    pub fn read<T: bytemuck::Pod>(&self, buffer: &Buffer) -> Result<Vec<T>> {
        let count = buffer.size().checked_div(size_of::<T>() as u64).unwrap_or(0);
        self.read_at(buffer, 0, count as usize)
    }

    /// `count` values from byte `offset` on, after everything submitted so far. Waits. Fails with
    /// [`Error::InHostCommands`] for a read-back buffer that commands of the host may write, until
    /// [`super::HostRecording::finished`].
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

    /// `count` values of a read-back buffer from byte `offset` on, or `None` while `by`, a submit or a recording for a
    /// host may still write the values. Never waits.
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

    /// `count` values from byte `offset` on; `None` while unfinished commands may write the values.
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

    /// Writes host bytes to the beginning of a buffer of [`Memory::Upload`]; later submits see the bytes. Waits until
    /// the last submit that uses the buffer has finished. Fails with [`Error::InHostCommands`] for a buffer that
    /// commands of the host use.
    pub fn store(&self, buffer: &Buffer, bytes: &[u8]) -> Result<()> {
        buffer.of(self.device())?;
        if buffer.memory() != Memory::Upload {
            return Err(buffer.bad_range(
                0,
                bytes.len() as u64,
                "only a buffer of Memory::Upload can be written directly",
            ));
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
    /// Checks that no unfinished recording for a host uses the buffer.
    fn not_lent(&self) -> Result<()> {
        match self.inner.lent.load(Ordering::Acquire) {
            0 => Ok(()),
            _ => Err(Error::InHostCommands { buffer: self.name().to_owned() }),
        }
    }
}
