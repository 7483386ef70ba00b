//! What a submit waits for and what it signals, besides the engine's own timeline.

use ash::vk;

/// A timeline semaphore of the host and a value of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HostSemaphore {
    semaphore: vk::Semaphore,
    value: u64,
}

impl HostSemaphore {
    /// The point at which `semaphore` has `value`.
    ///
    /// # Safety
    /// `semaphore` is a timeline semaphore of the adopted device and lives until every submit that names it has
    /// finished. Where the point is signalled, the value is larger than every one that the semaphore has, or will have
    /// been given, by then. Where it is waited for, somebody signals it without having to wait for this submit; on one
    /// queue, in a submit that comes before.
    pub unsafe fn new(semaphore: vk::Semaphore, value: u64) -> Self {
        Self { semaphore, value }
    }

    /// The semaphore.
    pub fn semaphore(self) -> vk::Semaphore {
        self.semaphore
    }

    /// The value to wait for or to signal.
    pub fn value(self) -> u64 {
        self.value
    }
}

/// Points of the host's timelines around work of the engine.
#[derive(Clone, Copy, Debug, Default)]
pub struct SubmitSync<'a> {
    /// Nothing of the work begins before all of these have been reached.
    pub wait: &'a [HostSemaphore],
    /// These are reached when all of the work is done, and what was submitted to the queue before it.
    pub signal: &'a [HostSemaphore],
}

impl<'a> SubmitSync<'a> {
    /// Waits for `wait`, then signals `signal`.
    pub fn new(wait: &'a [HostSemaphore], signal: &'a [HostSemaphore]) -> Self {
        Self { wait, signal }
    }

    /// The part of this order that submit `index` of `count` carries,
    /// when the work is that many submits one after the other.
    pub fn of_part(self, index: usize, count: usize) -> Self {
        let wait = if index == 0 { self.wait } else { &[] };
        let signal = if index + 1 == count { self.signal } else { &[] };
        Self { wait, signal }
    }
}
