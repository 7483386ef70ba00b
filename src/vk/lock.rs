//! Locking of mutexes despite poisoning, and a host's lock around its queue.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Locks a mutex. Ignores poisoning: a panic of another thread leaves the data usable.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Callbacks around every use of the host's queue. The host's own submits take the same lock, and a thread that holds
/// the lock does not call the engine. A panic in a callback continues in the submitting thread. After a panic in `lock`
/// nothing has been submitted; after a panic in `unlock` the device has the work, under the engine's next ticket. The
/// engine stays usable in both cases.
pub struct QueueLock {
    /// Waits for exclusive use of the queue.
    pub lock: Box<dyn Fn() + Send + Sync>,
    /// Releases the queue.
    pub unlock: Box<dyn Fn() + Send + Sync>,
}
