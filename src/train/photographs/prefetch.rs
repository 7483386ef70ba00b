//! Photographs decoded ahead of their use, by threads of their own.

use std::collections::{HashMap, HashSet};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use crate::dataset::{self, Pixels, Supply};

/// Hands out photographs by number. What [`Feed::look_ahead`] names is decoded before it is asked for, as far as it fits.
pub(in crate::train) struct Feed {
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
    ahead: usize,
}

struct Shared {
    supplies: Vec<Supply>,
    state: Mutex<State>,
    /// Something is wanted, or it is over.
    work: Condvar,
    /// Something is decoded.
    done: Condvar,
}

#[derive(Default)]
struct State {
    /// In the order of their use, each once.
    wanted: Vec<usize>,
    ready: HashMap<usize, Result<Arc<Pixels>, dataset::Error>>,
    busy: HashSet<usize>,
    /// Those wanted that an earlier call has named already.
    foreseen: HashSet<usize>,
    counts: FeedCounts,
    closed: bool,
}

/// How photographs came to where they were needed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FeedCounts {
    /// Photographs asked for.
    pub asked: u64,
    /// Of those, how many still lay where an earlier step was given them.
    pub reused: u64,
    /// Of those asked for, how many had to be waited for.
    pub waited: u64,
    /// Of those asked for, how many had not been named before the use of another: nothing could be done for them meanwhile.
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
    /// Keeps `ahead` photographs decoded, by up to `threads` threads: none where all are decoded anyway.
    pub(in crate::train) fn new(supplies: Vec<Supply>, ahead: usize, threads: usize) -> Self {
        let ahead = ahead.max(1);
        let idle = supplies.iter().all(Supply::is_decoded);
        let shared = Arc::new(Shared {
            supplies,
            state: Mutex::new(State::default()),
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

    /// How many are decoded ahead at most; 0 where there is nothing to decode.
    pub(in crate::train) fn ahead(&self) -> usize {
        if self.threads.is_empty() { 0 } else { self.ahead }
    }

    /// The photographs that are needed next, in this order. What is decoded and not among the first of them is dropped.
    pub(in crate::train) fn look_ahead(&self, views: &[usize]) {
        if self.threads.is_empty() {
            return;
        }
        self.shared.want(views, self.ahead);
    }

    /// A photograph: at once where it is decoded, else as soon as it is.
    pub(in crate::train) fn get(&self, view: usize) -> Result<Arc<Pixels>, dataset::Error> {
        self.get_timed(view).map(|(pixels, _)| pixels)
    }

    /// The same, with the seconds that it was waited for; `None` where it was there.
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
        let missing = |state: &mut State| !state.ready.contains_key(&view);
        let mut state = self.shared.done.wait_while(state, missing).unwrap_or_else(PoisonError::into_inner);
        let pixels = match state.ready.get(&view) {
            Some(Ok(pixels)) => Ok(pixels.clone()),
            _ => state.ready.remove(&view).unwrap_or_else(|| supply.pixels()),
        };
        Ok((pixels?, (!there).then(|| started.elapsed().as_secs_f64())))
    }

    /// A photograph was needed, and lay elsewhere still.
    pub(super) fn reused(&self) {
        let counts = &mut lock(&self.shared.state).counts;
        counts.asked += 1;
        counts.reused += 1;
    }

    /// So far.
    pub(super) fn counts(&self) -> FeedCounts {
        lock(&self.shared.state).counts
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        lock(&self.shared.state).closed = true;
        self.shared.work.notify_all();
        for thread in self.threads.drain(..) {
            // A decoder's panic was caught where it happened.
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
        let State { wanted, ready, .. } = &mut *state;
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

    /// A decoder that panics must not leave its photograph waited for.
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
