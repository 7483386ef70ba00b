//! Ctrl-C, SIGTERM and the end of the terminal. While work can be saved, the first signal asks the work to stop at a
//! point from which it can resume, and the second ends the process. At any other time the first signal ends the
//! process.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use anyhow::Context as _;

use super::console;
use super::exit::{Failure, INTERRUPTED};

/// Longest time that the last message may take: standard error may be closed, or its reader may have stopped reading.
const LAST_WORDS: Duration = Duration::from_millis(300);

/// Whether the user wants to stop. Clones share the state.
#[derive(Clone, Debug)]
pub(crate) struct Interrupt(Arc<State>);

#[derive(Debug)]
struct State {
    asked: AtomicBool,
    stage: Mutex<Stage>,
}

/// The effect of the next signal.
#[derive(Clone, Debug)]
enum Stage {
    /// Ends the process with this message.
    Ends(String),
    /// Asks the work to stop, with this message.
    Asks(&'static str),
}

impl Interrupt {
    /// Listens from now on. A signal ends the process until [`Self::work_begins`]. Call this function once per process.
    pub(crate) fn listen() -> anyhow::Result<Self> {
        let interrupt = Self::new();
        let shared = interrupt.clone();
        signals::on_each(move || shared.hear()).context("cannot listen for Ctrl-C")?;
        Ok(interrupt)
    }

    fn new() -> Self {
        Self(Arc::new(State { asked: AtomicBool::new(false), stage: Mutex::new(Stage::Ends("stopped".to_owned())) }))
    }

    /// Handles a signal on the thread of the signals. Must return whatever the state of standard error.
    fn hear(&self) {
        let stage = self.stage().clone();
        match stage {
            Stage::Ends(words) => {
                console::say_within(format!("\n{words}"), LAST_WORDS);
                signals::end(INTERRUPTED.into());
            }
            Stage::Asks(words) => {
                if self.0.asked.swap(true, Ordering::SeqCst) {
                    signals::end(INTERRUPTED.into());
                }
                console::say_within(format!("\n{words}"), Duration::ZERO);
            }
        }
    }

    fn stage(&self) -> MutexGuard<'_, Stage> {
        self.0.stage.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// From now on a signal ends the process with this message: nothing is unsaved.
    pub(crate) fn ends_at_once(&self, words: String) {
        *self.stage() = Stage::Ends(words);
    }

    /// From now on there is something to save: the first signal prints `answer` and asks for a stop.
    pub(crate) fn work_begins(&self, answer: &'static str) {
        *self.stage() = Stage::Asks(answer);
    }

    /// Whether the user has asked for a stop.
    pub(crate) fn asked(&self) -> bool {
        self.0.asked.load(Ordering::SeqCst)
    }

    /// Fails with the message of an immediate end if the user has asked for a stop.
    pub(crate) fn end_if_asked(&self) -> Result<(), Failure> {
        match &*self.stage() {
            Stage::Ends(words) if self.asked() => Err(Failure::Interrupted(words.clone())),
            _ => Ok(()),
        }
    }
}

#[cfg(unix)]
mod signals {
    use std::{fs, io, thread};

    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    use signal_hook::iterator::Signals;

    /// Calls `act` for every signal that asks the process to end.
    pub(super) fn on_each(act: impl Fn() + Send + 'static) -> io::Result<()> {
        // A process started by nohup ignores the end of the terminal.
        let wanted = [SIGINT, SIGTERM].into_iter().chain(Some(SIGHUP).filter(|_| hears_of_hangups()));
        let mut signals = Signals::new(wanted)?;
        thread::Builder::new()
            .name("signals".to_owned())
            .spawn(move || signals.forever().for_each(|_| act()))
            .map(|_| ())
    }

    /// Ends the process without the exit handlers of libraries: they crash a driver that another thread is loading.
    pub(super) fn end(code: i32) -> ! {
        signal_hook::low_level::exit(code)
    }

    /// Whether hang-ups are not ignored in this process, where the system says so.
    fn hears_of_hangups() -> bool {
        let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
        let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
        let mask = ignored.and_then(|hex| u64::from_str_radix(hex.trim(), 16).ok());
        mask.is_some_and(|mask| mask >> (SIGHUP - 1) & 1 == 0)
    }
}

#[cfg(not(unix))]
mod signals {
    use std::io;

    /// Calls `act` for every Ctrl-C.
    pub(super) fn on_each(act: impl Fn() + Send + 'static) -> io::Result<()> {
        ctrlc::set_handler(act).map_err(io::Error::other)
    }

    /// Ends the process.
    pub(super) fn end(code: i32) -> ! {
        std::process::exit(code)
    }
}
