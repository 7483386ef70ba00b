//! Parallel work on photographs within a memory budget.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use super::HostShare;

impl HostShare {
    /// Runs `work` for each of `costs` (bytes while it runs) on [`Self::threads`] threads. As many run at a time as fit
    /// into [`Self::decoding`], and always at least one. Results have the order of the costs.
    pub fn in_turns<T: Send>(&self, costs: &[u64], work: impl Fn(usize) -> T + Sync) -> Vec<T> {
        let (gate, next) = (MemoryGate::new(self.decoding), AtomicUsize::new(0));
        let done: Vec<Mutex<Option<T>>> = costs.iter().map(|_| Mutex::new(None)).collect();
        // Threads of its own rather than a pool's: a pool thread that waits for memory could wait for a task that only
        // it can run.
        std::thread::scope(|scope| {
            for _ in 0..self.threads.clamp(1, costs.len().max(1)) {
                scope.spawn(|| {
                    loop {
                        let at = next.fetch_add(1, Ordering::Relaxed);
                        let (Some(cost), Some(place)) = (costs.get(at), done.get(at)) else { return };
                        let _room = gate.enter(*cost);
                        let result = work(at);
                        *lock(place) = Some(result);
                    }
                });
            }
        });
        done.into_iter().filter_map(|place| place.into_inner().unwrap_or_else(PoisonError::into_inner)).collect()
    }
}

/// Admits work while it fits beside the work inside, and always at least one.
struct MemoryGate {
    most: u64,
    inside: Mutex<(u64, usize)>,
    left: Condvar,
}

struct Inside<'a>(&'a MemoryGate, u64);

impl MemoryGate {
    fn new(most: u64) -> Self {
        Self { most, inside: Mutex::new((0, 0)), left: Condvar::new() }
    }

    fn enter(&self, bytes: u64) -> Inside<'_> {
        let full = |(inside, count): &mut (u64, usize)| *count > 0 && inside.saturating_add(bytes) > self.most;
        let mut inside = self.left.wait_while(lock(&self.inside), full).unwrap_or_else(PoisonError::into_inner);
        inside.0 += bytes;
        inside.1 += 1;
        Inside(self, bytes)
    }
}

impl Drop for Inside<'_> {
    fn drop(&mut self) {
        let mut inside = lock(&self.0.inside);
        inside.0 -= self.1;
        inside.1 -= 1;
        self.0.left.notify_all();
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gate_lets_one_in_and_no_more_than_fit() {
        let gate = MemoryGate::new(10);
        let large = gate.enter(100);
        let (sender, receiver) = std::sync::mpsc::channel();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let _a = gate.enter(4);
                let _b = gate.enter(6);
                sender.send(*lock(&gate.inside)).expect("heard");
            });
            assert!(receiver.try_recv().is_err(), "nothing fits beside what is too large");
            drop(large);
            assert_eq!(receiver.recv().expect("let in"), (10, 2));
        });
        assert_eq!(*lock(&gate.inside), (0, 0));
    }

    #[test]
    fn all_is_done_in_order_and_within_the_room() {
        let (inside, most) = (Mutex::new(0_u64), Mutex::new(0_u64));
        let costs: Vec<u64> = (0..60).map(|k| 1 + k * 7 % 5).collect();
        for threads in [1, 4] {
            let share = HostShare { keep: 0, decoding: 8, threads };
            let done = share.in_turns(&costs, |at| {
                let now = {
                    let mut inside = lock(&inside);
                    *inside += costs[at];
                    *inside
                };
                std::thread::yield_now();
                {
                    let mut most = lock(&most);
                    *most = now.max(*most);
                }
                *lock(&inside) -= costs[at];
                at
            });
            assert_eq!(done, (0..60).collect::<Vec<_>>());
            let most = std::mem::take(&mut *lock(&most));
            assert!((5..=8).contains(&most), "{most} on {threads} threads");
        }
        assert!(HostShare::unlimited().in_turns(&[], |at| at).is_empty());
    }
}
