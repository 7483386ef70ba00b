//! A training in a process of its own, which a stop of this one reaches once.

use std::io;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::sleep;
use std::time::Duration;

use crate::cli::interrupt::Interrupt;

/// How often the child and the wish to stop are looked at.
const GLANCE: Duration = Duration::from_millis(50);

/// Runs a command to its end. Where the user wants to stop, it is asked to stop too, and waited for:
/// it saves what it has.
pub(super) fn run(command: &mut Command, interrupt: &Interrupt) -> io::Result<ExitStatus> {
    apart(command);
    let mut child = command.stdin(Stdio::null()).spawn()?;
    let mut told = false;
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status);
        }
        if interrupt.asked() && !told {
            told = true;
            stop(&mut child)?;
        }
        sleep(GLANCE);
    }
}

/// Keeps the terminal's Ctrl-C from the child: it would get it a second time from here,
/// and a second one ends it without saving.
#[cfg(unix)]
fn apart(command: &mut Command) {
    use std::os::unix::process::CommandExt as _;
    command.process_group(0);
}

#[cfg(not(unix))]
fn apart(_: &mut Command) {}

#[cfg(unix)]
fn stop(child: &mut Child) -> io::Result<()> {
    use rustix::process::{Pid, Signal, kill_process};
    let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
    match pid.map(|pid| kill_process(pid, Signal::TERM)) {
        // It has come to its end meanwhile.
        Some(Err(rustix::io::Errno::SRCH)) | Some(Ok(())) => Ok(()),
        Some(Err(error)) => Err(error.into()),
        None => child.kill(),
    }
}

/// The console's Ctrl-C has reached it already.
#[cfg(not(unix))]
fn stop(_: &mut Child) -> io::Result<()> {
    Ok(())
}
