//! Recording into a command buffer of the host rather than into one of our own.
//!
//! When and how often the host submits it is not known here, so nothing is inferred across its ends: it begins and ends
//! with a barrier over everything. What lies between was inferred, and is checked, on its own.

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

/// Keeps alive what a command buffer of the host refers to: buffers, pipelines, descriptors, staged bytes.
#[must_use = "the command buffer refers to what is freed with this"]
pub struct HostRecording {
    gpu: Gpu,
    slot: Option<Slot>,
    /// Buffers among those of the commands that the host sees.
    lent: Vec<Buffer>,
    _commands: Vec<Command>,
    _staging: Vec<(Buffer, u64)>,
}

/// Says that a [`HostRecording`] has run.
#[derive(Clone, Copy, Debug)]
pub struct Executed {
    /// Number of the device.
    device: u64,
}

impl Executed {
    /// Checks that the recording was one of this device.
    pub(super) fn of(self, device: &Device) -> Result<()> {
        if self.device == device.id {
            return Ok(());
        }
        Err(Error::Foreign { what: "the recording that a host has finished".into() })
    }
}

/// Something whose end makes a read-back buffer readable: see [`Gpu::read_ready`].
#[derive(Clone, Copy, Debug)]
pub enum Done {
    /// A submit of the engine, finished or not.
    Ticket(Ticket),
    /// A recording that a host has submitted and seen finished.
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
    /// Writes the commands into a command buffer of the host, between two barriers over all commands and all memory:
    /// whatever the host records before and after is ordered with them. It may be submitted more than once,
    /// one run after the other.
    ///
    /// # Safety
    /// `commands` is a primary or secondary command buffer of the adopted device, in the recording state and outside of
    /// a render pass, of the family of the engine's queue, and nobody else uses it during the call. What is returned is
    /// kept until the device has executed the command buffer for the last time. Submitted to another queue than the
    /// engine's, it is ordered with the engine's submits by semaphores.
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
            // Whoever reads or writes them now holds the lock until that is done.
            let _queue = gpu.state();
            lent.iter().for_each(|buffer| _ = buffer.inner.lent.fetch_add(1, Ordering::AcqRel));
        }
        Ok(HostRecording { gpu, slot: Some(slot), lent, _commands: self.commands, _staging: self.staging })
    }
}

impl HostRecording {
    /// Gives back what the command buffer referred to, which by the promise of [`Recorder::record_into`] has run for
    /// the last time.
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
