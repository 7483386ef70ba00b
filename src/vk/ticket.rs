//! Tickets: positions of submits on the timeline of their device.

use std::sync::atomic::{AtomicU64, Ordering};

use super::error::{Error, Result};
use super::gpu::Gpu;

/// A device number, unique in the process.
///
/// A ticket may outlive its device, so the device's address cannot identify the owner of a ticket.
pub(super) fn next_device() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(1);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

/// A submit's position on the timeline of its device. The default ticket stands for no submit and has passed on every
/// device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Ticket {
    value: u64,
    /// Number of the device.
    device: u64,
}

impl Ticket {
    /// Ticket of submit `value` of a device; 0 stands for no submit.
    pub(super) fn of(device: u64, value: u64) -> Self {
        if value == 0 { Ticket::default() } else { Ticket { value, device } }
    }

    /// The value of [`Gpu::timeline`] once the submit has finished.
    pub fn value(self) -> u64 {
        self.value
    }
}

impl Gpu {
    /// The ticket of the last submit.
    pub fn last_ticket(&self) -> Ticket {
        self.ticket(self.state().last)
    }

    /// Whether a submit has finished.
    pub fn is_done(&self, ticket: Ticket) -> Result<bool> {
        self.owns(ticket)?;
        Ok(self.completed()? >= ticket.value)
    }

    /// Ticket of submit `value` of this device.
    pub(super) fn ticket(&self, value: u64) -> Ticket {
        Ticket::of(self.device().id, value)
    }

    /// Checks that a ticket belongs to this device.
    pub(super) fn owns(&self, ticket: Ticket) -> Result<()> {
        if ticket.value == 0 || ticket.device == self.device().id {
            return Ok(());
        }
        Err(Error::ForeignTicket { ticket: ticket.value, last: self.state().last })
    }
}
