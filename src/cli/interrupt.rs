//! Ctrl-C and SIGTERM: the first asks the work to stop where it can be taken up again, the second ends the process.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context as _;

/// Whether the user wants to stop. Clones share the answer.
#[derive(Clone, Debug, Default)]
pub(crate) struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Listens from now on. To be called once in a process.
    pub(crate) fn listen() -> anyhow::Result<Self> {
        Self::listen_and_say("stopping after this step and saving; once more to stop at once")
    }

    /// The same with another answer to the user.
    pub(crate) fn listen_and_say(answer: &'static str) -> anyhow::Result<Self> {
        let asked = Self::default();
        let flag = asked.clone();
        ctrlc::set_handler(move || {
            if flag.0.swap(true, Ordering::Relaxed) {
                std::process::exit(130);
            }
            eprintln!("\n{answer}");
        })
        .context("cannot listen for Ctrl-C")?;
        Ok(asked)
    }

    /// Whether a stop was asked for.
    pub(crate) fn asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
