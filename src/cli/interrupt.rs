//! Ctrl-C and SIGTERM: the first asks the work to stop where it can be taken up again, the second ends the process. While there is nothing
//! to save, the first does.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context as _;

/// What a shell expects of a process that Ctrl-C has ended.
const ENDED: i32 = 130;

/// Whether the user wants to stop. Clones share the answer.
#[derive(Clone, Debug, Default)]
pub(crate) struct Interrupt(Arc<State>);

#[derive(Debug, Default)]
struct State {
    asked: AtomicBool,
    /// Whether there is something to save.
    working: AtomicBool,
}

impl Interrupt {
    /// Listens from now on: the process ends at once until [`Self::work_begins`]. To be called once in a process.
    pub(crate) fn listen() -> anyhow::Result<Self> {
        Self::default().listening("stopping after this step and saving; once more to stop at once")
    }

    /// Listens for work that has begun, with this answer to the user.
    pub(crate) fn listen_and_say(answer: &'static str) -> anyhow::Result<Self> {
        let interrupt = Self::default();
        interrupt.work_begins();
        interrupt.listening(answer)
    }

    fn listening(self, answer: &'static str) -> anyhow::Result<Self> {
        let shared = self.clone();
        signals::on_each(move || shared.hear(answer)).context("cannot listen for Ctrl-C")?;
        Ok(self)
    }

    fn hear(&self, answer: &str) {
        if !self.0.working.load(Ordering::Acquire) {
            eprintln!("\nstopped before the first step: there is nothing to save");
            signals::end(ENDED);
        }
        if self.0.asked.swap(true, Ordering::Relaxed) {
            signals::end(ENDED);
        }
        eprintln!("\n{answer}");
    }

    /// From now on there is something to save.
    pub(crate) fn work_begins(&self) {
        self.0.working.store(true, Ordering::Release);
    }

    /// Whether a stop was asked for.
    pub(crate) fn asked(&self) -> bool {
        self.0.asked.load(Ordering::Relaxed)
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

    /// Ends the process without what libraries do at a proper end: a driver that another thread is just loading does not survive that.
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
