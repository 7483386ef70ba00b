//! A training in a child process, which gets each stop of this process exactly once.

use std::io;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::sleep;
use std::time::Duration;

use crate::cli::interrupt::Interrupt;

/// Interval at which the child and the interrupt are polled.
const GLANCE: Duration = Duration::from_millis(50);

/// Runs a command to its end. On an interrupt the child is asked to stop, and this process waits while the child saves.
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

/// Moves the child to a process group of its own. Else the terminal's Ctrl-C would reach the child in addition to the
/// signal from here, and a second signal ends the child without saving.
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
        // The child may have ended meanwhile.
        Some(Err(rustix::io::Errno::SRCH)) | Some(Ok(())) => Ok(()),
        Some(Err(error)) => Err(error.into()),
        None => child.kill(),
    }
}

/// The console's Ctrl-C has reached the child already.
#[cfg(not(unix))]
fn stop(_: &mut Child) -> io::Result<()> {
    Ok(())
}
