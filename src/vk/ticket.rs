//! Tickets: places of submits on the timeline of their device.

use std::sync::atomic::{AtomicU64, Ordering};

use super::error::{Error, Result};
use super::gpu::Gpu;

/// A number for a device that no other device of the process has or will have.
///
/// A ticket is a copy of numbers and may outlive its device, so that no address can tell whose it is.
pub(super) fn next_device() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(1);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

/// A finished submit's place on the timeline of its device. The default is that of no submit:
/// it has passed on every device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Ticket {
    value: u64,
    /// Number of the device.
    device: u64,
}

impl Ticket {
    /// The submit `value` of a device; 0 for none.
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

    /// True when a submit has finished.
    pub fn is_done(&self, ticket: Ticket) -> Result<bool> {
        self.owns(ticket)?;
        Ok(self.completed()? >= ticket.value)
    }

    /// The ticket of a submit of this device.
    pub(super) fn ticket(&self, value: u64) -> Ticket {
        Ticket::of(self.device().id, value)
    }

    /// Checks that a ticket is of this device.
    pub(super) fn owns(&self, ticket: Ticket) -> Result<()> {
        if ticket.value == 0 || ticket.device == self.device().id {
            return Ok(());
        }
        Err(Error::ForeignTicket { ticket: ticket.value, last: self.state().last })
    }
}
