//! Decodes photographs ahead of their use, in threads.

use std::collections::{HashMap, HashSet};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use crate::dataset::{self, Pixels, Supply};

/// Gives decoded photographs by index. The first photographs that [`Feed::look_ahead`] names are decoded before they
/// are asked for.
pub(in crate::train) struct Feed {
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
    ahead: usize,
}

struct Shared {
    supplies: Vec<Supply>,
    state: Mutex<FeedState>,
    /// Signalled when a photograph is wanted, and when the feed is closed.
    work: Condvar,
    /// Signalled when a photograph is decoded.
    done: Condvar,
}

#[derive(Default)]
struct FeedState {
    /// Photographs to decode, in the order of their use, each once.
    wanted: Vec<usize>,
    ready: HashMap<usize, Result<Arc<Pixels>, dataset::Error>>,
    busy: HashSet<usize>,
    /// Photographs that were wanted before the last call of [`Feed::look_ahead`].
    foreseen: HashSet<usize>,
    counts: FeedCounts,
    closed: bool,
}

/// Counts of the photographs that steps asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FeedCounts {
    /// Photographs asked for.
    pub asked: u64,
    /// Photographs asked for that were still in a staging buffer from an earlier step.
    pub reused: u64,
    /// Photographs asked for that a step had to wait for.
    pub waited: u64,
    /// Photographs asked for that were not named in time, so that they could not be decoded ahead.
    pub unforeseen: u64,
    /// Photographs decoded.
    pub decoded: u64,
}

impl std::ops::Add for FeedCounts {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            asked: self.asked + other.asked,
            reused: self.reused + other.reused,
            waited: self.waited + other.waited,
            unforeseen: self.unforeseen + other.unforeseen,
            decoded: self.decoded + other.decoded,
        }
    }
}

impl Feed {
    /// Keeps `ahead` photographs decoded, by up to `threads` threads; by none if all photographs are kept decoded
    /// anyway.
    pub(in crate::train) fn new(supplies: Vec<Supply>, ahead: usize, threads: usize) -> Self {
        let ahead = ahead.max(1);
        let idle = supplies.iter().all(Supply::is_decoded);
        let shared = Arc::new(Shared {
            supplies,
            state: Mutex::new(FeedState::default()),
            work: Condvar::new(),
            done: Condvar::new(),
        });
        let threads = if idle { 0 } else { threads.clamp(1, ahead) };
        let start = |_| {
            let shared = shared.clone();
            std::thread::Builder::new().name("photographs".into()).spawn(move || shared.work()).ok()
        };
        Self { threads: (0..threads).filter_map(start).collect(), shared, ahead }
    }

    /// Most photographs decoded ahead; 0 if there is nothing to decode.
    pub(in crate::train) fn ahead(&self) -> usize {
        if self.threads.is_empty() { 0 } else { self.ahead }
    }

    /// Names the photographs that are needed next, in their order. Decoded photographs that are not among the first
    /// ones named are dropped.
    pub(in crate::train) fn look_ahead(&self, views: &[usize]) {
        if self.threads.is_empty() {
            return;
        }
        self.shared.want(views, self.ahead);
    }

    /// A photograph. Waits until it is decoded.
    pub(in crate::train) fn get(&self, view: usize) -> Result<Arc<Pixels>, dataset::Error> {
        self.get_timed(view).map(|(pixels, _)| pixels)
    }

    /// A photograph with the seconds of waiting; `None` if the photograph was there.
    pub(super) fn get_timed(&self, view: usize) -> Result<(Arc<Pixels>, Option<f64>), dataset::Error> {
        let Some(supply) = self.shared.supplies.get(view) else {
            return Ok((Arc::new(Pixels::Rgba8(Vec::new())), None));
        };
        if self.threads.is_empty() || supply.is_decoded() {
            lock(&self.shared.state).counts.asked += 1;
            return Ok((supply.pixels()?, None));
        }
        let started = Instant::now();
        let mut state = lock(&self.shared.state);
        state.counts.asked += 1;
        let there = state.ready.contains_key(&view);
        state.counts.waited += u64::from(!there);
        state.counts.unforeseen += u64::from(!state.foreseen.contains(&view));
        if !state.wanted.contains(&view) {
            state.wanted.insert(0, view);
            self.shared.work.notify_all();
        }
        let missing = |state: &mut FeedState| !state.ready.contains_key(&view);
        let mut state = self.shared.done.wait_while(state, missing).unwrap_or_else(PoisonError::into_inner);
        let pixels = match state.ready.get(&view) {
            Some(Ok(pixels)) => Ok(pixels.clone()),
            _ => state.ready.remove(&view).unwrap_or_else(|| supply.pixels()),
        };
        Ok((pixels?, (!there).then(|| started.elapsed().as_secs_f64())))
    }

    /// Counts a photograph that was asked for and still in a staging buffer.
    pub(super) fn reused(&self) {
        let counts = &mut lock(&self.shared.state).counts;
        counts.asked += 1;
        counts.reused += 1;
    }

    /// Counts so far.
    pub(super) fn counts(&self) -> FeedCounts {
        lock(&self.shared.state).counts
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        lock(&self.shared.state).closed = true;
        self.shared.work.notify_all();
        for thread in self.threads.drain(..) {
            // A panic of a decoder was caught in `Shared::decode`.
            let _ = thread.join();
        }
    }
}

impl Shared {
    fn want(&self, views: &[usize], most: usize) {
        let mut state = lock(&self.state);
        state.foreseen = state.wanted.drain(..).collect();
        for view in views {
            if state.wanted.len() < most && !state.wanted.contains(view) {
                state.wanted.push(*view);
            }
        }
        let FeedState { wanted, ready, .. } = &mut *state;
        ready.retain(|view, _| wanted.contains(view));
        self.work.notify_all();
    }

    fn work(&self) {
        let mut state = lock(&self.state);
        while !state.closed {
            let open = |view: &&usize| !state.ready.contains_key(view) && !state.busy.contains(view);
            let Some(view) = state.wanted.iter().find(open).copied() else {
                state = self.work.wait(state).unwrap_or_else(PoisonError::into_inner);
                continue;
            };
            state.busy.insert(view);
            drop(state);
            let pixels = self.decode(view);
            state = lock(&self.state);
            state.busy.remove(&view);
            state.counts.decoded += 1;
            if state.wanted.contains(&view) {
                state.ready.insert(view, pixels);
                self.done.notify_all();
            }
        }
    }

    /// Decodes a photograph. A panic of the decoder is an error, else steps would wait for the photograph for ever.
    fn decode(&self, view: usize) -> Result<Arc<Pixels>, dataset::Error> {
        let Some(supply) = self.supplies.get(view) else { return Ok(Arc::new(Pixels::Rgba8(Vec::new()))) };
        catch_unwind(AssertUnwindSafe(|| supply.pixels())).unwrap_or_else(|_| {
            Err(dataset::Error::undecodable(supply.file(), "pixels", 0, "the decoder failed on this file"))
        })
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
