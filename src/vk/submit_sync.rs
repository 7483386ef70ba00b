//! Semaphores that a submit waits for and signals, besides the engine's own timeline.

use ash::vk;

/// A timeline semaphore of the host with a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HostSemaphore {
    semaphore: vk::Semaphore,
    value: u64,
}

impl HostSemaphore {
    /// The point at which `semaphore` has `value`.
    ///
    /// # Safety
    /// `semaphore` is a timeline semaphore of the adopted device and lives until every submit that names the semaphore
    /// has finished. For a signal, `value` is larger than every value that the semaphore will have by then. For a wait,
    /// the signal of `value` does not depend on this submit; a signal on the same queue comes from an earlier submit.
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

/// Semaphore waits and signals around work of the engine.
#[derive(Clone, Copy, Debug, Default)]
pub struct SubmitSync<'a> {
    /// The work starts after all these values have been reached.
    pub wait: &'a [HostSemaphore],
    /// Signalled after the work, and everything submitted to the queue before, is done.
    pub signal: &'a [HostSemaphore],
}

impl<'a> SubmitSync<'a> {
    /// Waits for `wait` before the work, and signals `signal` after the work.
    pub fn new(wait: &'a [HostSemaphore], signal: &'a [HostSemaphore]) -> Self {
        Self { wait, signal }
    }

    /// The waits and signals of submit `index`, when the work is split into `count` submits in sequence.
    pub fn of_part(self, index: usize, count: usize) -> Self {
        let wait = if index == 0 { self.wait } else { &[] };
        let signal = if index + 1 == count { self.signal } else { &[] };
        Self { wait, signal }
    }
}
