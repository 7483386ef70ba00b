//! Output of the commands: results on standard output, everything else on standard error.

use std::fmt::Display;
use std::io::{self, IsTerminal as _, Write as _};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread;
use std::time::Duration;

use anyhow::Context as _;
use psrgs_vk::vk::Messages;

use super::asked::as_options;
use super::exit::Failure;
use super::plain;

/// How much is printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Level {
    /// Warnings and errors.
    Quiet,
    /// Messages for every user.
    Normal,
    /// Details for finding out why.
    Verbose,
}

/// Standard error with a level.
#[derive(Clone, Debug)]
pub(crate) struct Console {
    level: Level,
    terminal: bool,
    watched: Arc<Mutex<Vec<Messages>>>,
}

impl Console {
    pub(crate) fn new(level: Level) -> Self {
        Self { level, terminal: io::stderr().is_terminal(), watched: Arc::default() }
    }

    /// From now on collects the messages of a device's validation layer.
    pub(crate) fn watch(&self, messages: Messages) {
        self.watched.lock().unwrap_or_else(PoisonError::into_inner).push(messages);
    }

    /// The messages of all watched devices. Call this function after all devices are closed.
    pub(crate) fn messages_of_devices(&self) -> Vec<String> {
        let watched = self.watched.lock().unwrap_or_else(PoisonError::into_inner);
        let open = watched.iter().filter(|messages| !messages.is_closed());
        let open = open.map(|_| "something that was made from a device outlives the command".to_owned());
        watched.iter().flat_map(Messages::all).chain(open).collect()
    }

    /// Whether a progress bar can be drawn.
    pub(crate) fn draws(&self) -> bool {
        self.terminal && self.level >= Level::Normal
    }

    pub(crate) fn say(&self, text: impl Display) {
        if self.level >= Level::Normal {
            line(&text);
        }
    }

    pub(crate) fn detail(&self, text: impl Display) {
        if self.level >= Level::Verbose {
            line(&text);
        }
    }

    pub(crate) fn warn(&self, text: impl Display) {
        line(&format_args!("warning: {text}"));
    }
}

/// A closed standard error must not stop a training, so write errors are dropped.
fn line(text: &dyn Display) {
    let _ = writeln!(io::stderr(), "{}", plain::message(&as_options(&text.to_string())));
}

/// Prints a text and waits for at most `longest`. A closed terminal answers with an error, and a reader that has
/// stopped reading does not answer at all.
pub(crate) fn say_within(text: String, longest: Duration) {
    let (said, heard) = mpsc::channel();
    let say = move || {
        line(&text);
        // The receiver may have given up.
        let _ = said.send(());
    };
    if thread::Builder::new().name("words".to_owned()).spawn(say).is_ok() && !longest.is_zero() {
        let _ = heard.recv_timeout(longest);
    }
}

/// Prints why the command failed, at every level.
pub(crate) fn error(text: impl Display, remedies: &[String]) {
    line(&format_args!("psrgs-vk: {text}"));
    for remedy in remedies {
        line(&format_args!("  {remedy}"));
    }
}

/// Writes a result to standard output.
pub(crate) fn print(text: &str) -> anyhow::Result<()> {
    let mut out = io::stdout().lock();
    let written = out.write_all(plain::plain(text).as_bytes()).and_then(|()| out.flush());
    written.context(Failure::Output("standard output".to_owned()))
}

/// Whether the reader of standard output has closed it, as `head` does. The user wanted that.
pub(crate) fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error.downcast_ref::<io::Error>().is_some_and(|e| e.kind() == io::ErrorKind::BrokenPipe)
}

/// Rows as aligned text. The first row is the header. Columns that hold only numbers are right-aligned.
pub(crate) fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let cell = |row: &Vec<String>, c: usize| row.get(c).cloned().unwrap_or_default();
    let width = |c: usize| rows.iter().map(|row| cell(row, c).chars().count()).max().unwrap_or(0);
    let numeric = |c: usize| {
        rows.len() > 1 && rows[1..].iter().all(|row| cell(row, c).starts_with(|x: char| x.is_ascii_digit() || x == '-'))
    };
    let shape: Vec<(usize, bool)> = (0..columns).map(|c| (width(c), numeric(c))).collect();
    let mut text = String::new();
    for row in rows {
        let cells: Vec<String> = shape
            .iter()
            .enumerate()
            .map(
                |(c, &(w, right))| {
                    if right { format!("{:>w$}", cell(row, c)) } else { format!("{:<w$}", cell(row, c)) }
                },
            )
            .collect();
        text.push_str(cells.join("  ").trim_end());
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_right_aligned() {
        let rows = [["pass", "us"], ["blend", "7"], ["x", "1234"]].map(|r| r.map(str::to_owned).to_vec());
        assert_eq!(table(&rows), "pass     us\nblend     7\nx      1234\n");
    }
}
