//! Ctrl-C, SIGTERM and the end of the terminal: while there is something to save, the first asks the work to stop where
//! it can be taken up again, and the second ends the process. At any other time the first does.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use anyhow::Context as _;

use super::console;
use super::exit::{Failure, INTERRUPTED};

/// The longest that an end waits for its last words: who reads standard error may be gone, or may read no more.
const LAST_WORDS: Duration = Duration::from_millis(300);

/// Whether the user wants to stop. Clones share the answer.
#[derive(Clone, Debug)]
pub(crate) struct Interrupt(Arc<State>);

#[derive(Debug)]
struct State {
    asked: AtomicBool,
    stage: Mutex<Stage>,
}

/// What a signal does.
#[derive(Clone, Debug)]
enum Stage {
    /// Ends the process, with these words.
    Ends(String),
    /// Asks the work to stop, with these words.
    Asks(&'static str),
}

impl Interrupt {
    /// Listens from now on: the process ends at once until [`Self::work_begins`]. To be called once in a process.
    pub(crate) fn listen() -> anyhow::Result<Self> {
        let interrupt = Self::new();
        let shared = interrupt.clone();
        signals::on_each(move || shared.hear()).context("cannot listen for Ctrl-C")?;
        Ok(interrupt)
    }

    fn new() -> Self {
        Self(Arc::new(State { asked: AtomicBool::new(false), stage: Mutex::new(Stage::Ends("stopped".to_owned())) }))
    }

    /// On a thread of its own, which must come back whatever has become of standard error.
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

    /// From now on a signal ends the process at once, with these words: there is nothing to save,
    /// or all that there was is saved.
    pub(crate) fn ends_at_once(&self, words: String) {
        *self.stage() = Stage::Ends(words);
    }

    /// From now on there is something to save: the first signal asks for a stop, with this answer to the user.
    pub(crate) fn work_begins(&self, answer: &'static str) {
        *self.stage() = Stage::Asks(answer);
    }

    /// Whether a stop was asked for.
    pub(crate) fn asked(&self) -> bool {
        self.0.asked.load(Ordering::SeqCst)
    }

    /// Fails, with the words that an end at once would have, where a stop was asked for before.
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
        // Whoever starts a process by nohup has it ignore the end of the terminal.
        let wanted = [SIGINT, SIGTERM].into_iter().chain(Some(SIGHUP).filter(|_| hears_of_hangups()));
        let mut signals = Signals::new(wanted)?;
        thread::Builder::new()
            .name("signals".to_owned())
            .spawn(move || signals.forever().for_each(|_| act()))
            .map(|_| ())
    }

    /// Ends the process without what libraries do at a proper end: a driver that another thread is just loading does
    /// not survive that.
    pub(super) fn end(code: i32) -> ! {
        signal_hook::low_level::exit(code)
    }

    /// Whether this process was not started with hang-ups ignored, where that can be told.
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
