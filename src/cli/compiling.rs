//! Progress messages while pipelines are compiled. At the first start a driver may take minutes.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use psrgs_vk::vk::{Gpu, PipelineEvent};

use super::console::Console;

/// Compilation time below which nothing is said.
const PATIENCE: Duration = Duration::from_secs(1);
/// Longest time between two messages while pipelines are compiled.
const OFTEN: Duration = Duration::from_secs(10);
/// Polling interval.
const TICK: Duration = Duration::from_millis(200);
/// Pipelines that take longer are named at the verbose level.
const LONG: Duration = Duration::from_millis(500);

/// State of the compilation, and what was said about it.
#[derive(Debug, Default)]
struct Compiling {
    made: u32,
    /// Total time of the finished pipelines.
    spent: Duration,
    now: Option<(&'static str, Instant)>,
    /// The total time in the last message.
    told: Option<Duration>,
    /// The total time when the pipelines were last said to be compiled.
    closed: Duration,
    ended: Option<Instant>,
}

impl Compiling {
    fn note(&mut self, event: PipelineEvent, at: Instant) {
        match event {
            PipelineEvent::Begun { kernel } => {
                self.now = Some((kernel, at));
            }
            PipelineEvent::Made { took, .. } => {
                self.made += 1;
                self.spent += took;
                (self.now, self.ended) = (None, Some(at));
            }
        }
    }

    /// The message that is due at a moment, if any.
    fn line(&mut self, at: Instant) -> Option<String> {
        let running = self.now.map_or(Duration::ZERO, |(_, since)| at.saturating_duration_since(since));
        let spent = self.spent + running;
        let idle = self.now.is_none() && self.ended.is_some_and(|end| at.saturating_duration_since(end) >= PATIENCE);
        match self.told {
            None if spent >= PATIENCE => {
                self.told = Some(spent);
                Some("compiling pipelines for this device, which takes longest at its first start".to_owned())
            }
            Some(told) if spent.saturating_sub(told) >= OFTEN => {
                self.told = Some(spent);
                let kernel = self.now.map(|(kernel, _)| format!(", now {kernel}")).unwrap_or_default();
                Some(format!("compiling pipelines: {} done in {} s{kernel}", self.made, spent.as_secs()))
            }
            Some(_) if idle && spent.saturating_sub(self.closed) >= PATIENCE => {
                (self.told, self.closed) = (Some(spent), spent);
                Some(format!("{} pipelines compiled in {:.1} s", self.made, spent.as_secs_f64()))
            }
            _ => None,
        }
    }
}

fn lock(state: &Mutex<Compiling>) -> MutexGuard<'_, Compiling> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

/// From now on reports slow pipelines, as long as the device is open.
pub(crate) fn tell(gpu: &Gpu, console: &Console) {
    let state = Arc::new(Mutex::new(Compiling::default()));
    let (watched, said) = (Arc::downgrade(&state), console.clone());
    // The thread ends at its first poll after the device is closed. If no thread can be started, nothing is reported.
    let _ = thread::Builder::new().name("pipelines".into()).spawn(move || {
        while let Some(state) = watched.upgrade() {
            let line = lock(&state).line(Instant::now());
            drop(state);
            line.into_iter().for_each(|line| said.say(line));
            thread::sleep(TICK);
        }
    });
    let console = console.clone();
    gpu.watch_pipelines(move |event| {
        lock(&state).note(event, Instant::now());
        if let PipelineEvent::Made { kernel, took } = event
            && took >= LONG
        {
            console.detail(format_args!("  pipeline {kernel}: {:.1} s", took.as_secs_f64()));
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_pipelines_are_told_and_quick_ones_are_not() {
        let begin = Instant::now();
        let at = |seconds: f64| begin + Duration::from_secs_f64(seconds);
        let mut state = Compiling::default();
        let make = |state: &mut Compiling, from: f64, to: f64| {
            state.note(PipelineEvent::Begun { kernel: "blend" }, at(from));
            let told: Vec<String> =
                (1..100).filter_map(|i| state.line(at(from + (to - from) * f64::from(i) / 100.0))).collect();
            state.note(PipelineEvent::Made { kernel: "blend", took: Duration::from_secs_f64(to - from) }, at(to));
            told
        };
        // Quick pipelines, far apart: nothing is said until they add up to a second.
        for i in 0..9 {
            assert!(make(&mut state, f64::from(i) * 5.0, f64::from(i) * 5.0 + 0.1).is_empty());
            assert_eq!(state.line(at(f64::from(i) * 5.0 + 3.0)), None);
        }
        let told = make(&mut state, 50.0, 85.0);
        assert!(told[0].starts_with("compiling pipelines for this device"), "{told:?}");
        assert_eq!(told[1], "compiling pipelines: 9 done in 11 s, now blend");
        assert_eq!(told.len(), 4, "one in ten seconds: {told:?}");
        assert_eq!(state.line(at(85.5)), None, "others may follow");
        assert_eq!(state.line(at(86.5)).unwrap(), "10 pipelines compiled in 35.9 s");
        assert_eq!(state.line(at(90.0)), None);
        assert!(make(&mut state, 100.0, 100.5).is_empty());
        assert_eq!(state.line(at(110.0)), None, "half a second more is not worth a line");
    }
}
