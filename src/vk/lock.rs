//! Mutexes that a panic elsewhere does not close, and the lock that a host puts around its queue.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Locks a mutex; a panic elsewhere does not make the data unusable here.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Called around every use of the host's queue. The host's own submits take the same lock, and whoever holds it does
/// not call the engine. A panic in one of them goes on in whoever submits: in `lock` nothing has been submitted, in
/// `unlock` the work is with the device and has the engine's next ticket; the engine can be used again in both cases.
pub struct QueueLock {
    /// Waits until nobody else uses the queue.
    pub lock: Box<dyn Fn() + Send + Sync>,
    /// Lets others use it.
    pub unlock: Box<dyn Fn() + Send + Sync>,
}
