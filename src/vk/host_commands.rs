//! Recording into a command buffer of the host.
//!
//! The engine does not know when and how often the host submits the command buffer. So no barrier is inferred across
//! the ends of the recording: the recording begins and ends with a barrier over all memory. Barriers within the
//! recording are inferred and checked separately.

use std::sync::atomic::Ordering;

use ash::vk;

use super::barrier::Tracker;
use super::buffer::Buffer;
use super::device::Device;
use super::encode::encode_for_host;
use super::error::{Error, Result};
use super::gpu::Gpu;
use super::hazard::HazardChecker;
use super::host_allocator::Memory;
use super::recorder::{Command, Recorder};
use super::slot::Slot;
use super::submit::plan;
use super::ticket::Ticket;

/// Keeps alive everything that a command buffer of the host refers to: buffers, pipelines, descriptors, staged bytes.
#[must_use = "dropping the recording frees objects that the command buffer refers to"]
pub struct HostRecording {
    gpu: Gpu,
    slot: Option<Slot>,
    /// Host-visible buffers of the commands.
    lent: Vec<Buffer>,
    _commands: Vec<Command>,
    _staging: Vec<(Buffer, u64)>,
}

/// Proof that a [`HostRecording`] has run for the last time.
#[derive(Clone, Copy, Debug)]
pub struct Executed {
    /// Number of the device.
    device: u64,
}

impl Executed {
    /// Checks that the recording belonged to `device`.
    pub(super) fn of(self, device: &Device) -> Result<()> {
        if self.device == device.id {
            return Ok(());
        }
        Err(Error::Foreign { what: "the finished recording".into() })
    }
}

/// Work after which a read-back buffer is readable: see [`Gpu::read_ready`].
#[derive(Clone, Copy, Debug)]
pub enum Done {
    /// A submit of the engine, finished or not.
    Ticket(Ticket),
    /// A recording that the host has submitted and has seen finish.
    Executed(Executed),
}

impl From<Ticket> for Done {
    fn from(ticket: Ticket) -> Self {
        Done::Ticket(ticket)
    }
}

impl From<Executed> for Done {
    fn from(executed: Executed) -> Self {
        Done::Executed(executed)
    }
}

impl Recorder {
    /// Writes the commands into a command buffer of the host, between two barriers over all commands and all memory, so
    /// that commands of the host before and after are ordered. The command buffer may be submitted more than once, one
    /// run after the other.
    ///
    /// # Safety
    /// `commands` is a primary or secondary command buffer of the adopted device, for the family of the engine's queue,
    /// in the recording state and outside a render pass. Nobody else uses `commands` during the call. The caller keeps
    /// the returned [`HostRecording`] until the device has executed the command buffer for the last time. If the host
    /// submits to a queue other than the engine's, semaphores order the command buffer with the engine's submits.
    pub unsafe fn record_into(self, commands: vk::CommandBuffer) -> Result<HostRecording> {
        let gpu = self.gpu.clone();
        let device = gpu.device().clone();
        let mut checker = gpu.state().checker.is_some().then(HazardChecker::default);
        let plan = plan(&mut Tracker::default(), &mut checker, &self)?;
        let free = gpu.state().free_slot();
        let mut slot = match free {
            Some(slot) => slot,
            None => Slot::new(&device)?,
        };
        // SAFETY: the caller's promise.
        if let Err(error) = unsafe { encode_for_host(&device, &mut slot, commands, &self, &plan) } {
            // SAFETY: a command buffer whose recording failed cannot be submitted.
            unsafe { slot.destroy(&device) };
            return Err(error);
        }
        let seen = self.commands.iter().flat_map(Command::buffers).filter(|b| b.memory() != Memory::Device);
        let lent: Vec<Buffer> = seen.cloned().collect();
        {
            // A thread that reads or writes one of the buffers now holds the lock until done.
            let _queue = gpu.state();
            lent.iter().for_each(|buffer| _ = buffer.inner.lent.fetch_add(1, Ordering::AcqRel));
        }
        Ok(HostRecording { gpu, slot: Some(slot), lent, _commands: self.commands, _staging: self.staging })
    }
}

impl HostRecording {
    /// Frees what the command buffer referred to. By the promise of [`Recorder::record_into`], the command buffer has
    /// run for the last time.
    pub fn finished(self) -> Executed {
        Executed { device: self.gpu.device().id }
    }
}

impl Drop for HostRecording {
    fn drop(&mut self) {
        self.lent.iter().for_each(|buffer| _ = buffer.inner.lent.fetch_sub(1, Ordering::AcqRel));
        let Some(mut slot) = self.slot.take() else { return };
        // SAFETY: the promise given to `record_into`: the device has executed the command buffer for the last time.
        match unsafe { slot.reset(self.gpu.device()) } {
            Ok(()) => self.gpu.state().keep_slot(slot),
            // SAFETY: as above.
            Err(_) => unsafe { slot.destroy(self.gpu.device()) },
        }
    }
}
