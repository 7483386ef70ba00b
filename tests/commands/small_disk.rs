//! A disk of a chosen size, where this machine allows mounting.
#![cfg(unix)]

use std::fs;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use crate::common;

/// Unit of allocation of the disk in bytes.
pub const PAGE: u64 = 4096;

/// A file system in memory, mounted in the namespace of a child process and reached through that process.
pub struct Disk {
    shell: Child,
    to: Option<ChildStdin>,
    from: BufReader<ChildStdout>,
    mount: tempfile::TempDir,
    path: PathBuf,
}

impl Disk {
    /// `None`, with a printed reason, where no file system may be mounted.
    pub fn of(bytes: u64) -> Option<Self> {
        let found = Self::try_of(bytes);
        if found.is_none() {
            common::left_out("this machine lets nobody mount a file system in a namespace (unshare -rm)");
        }
        found
    }

    fn try_of(bytes: u64) -> Option<Self> {
        let mount = tempfile::tempdir().ok()?;
        let mut shell = Command::new("unshare")
            .args(["-rm", "sh"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .ok()?;
        let from = BufReader::new(shell.stdout.take()?);
        let path = PathBuf::from(format!("/proc/{}/root{}", shell.id(), mount.path().display()));
        let mut disk = Self { to: shell.stdin.take(), shell, from, mount, path };
        let at = disk.mount.path().display().to_string();
        let made = disk.runs(&format!("mount -t tmpfs -o size={bytes} psrgs-test {at}"));
        // The path through the child differs from what this process sees at the mount point.
        let probe = disk.path.join("probe");
        let seen = made && fs::write(&probe, "").is_ok() && !disk.mount.path().join("probe").exists();
        (seen && fs::remove_file(probe).is_ok()).then_some(disk)
    }

    /// Runs a command where the disk is mounted; gives whether the command succeeded.
    fn runs(&mut self, command: &str) -> bool {
        let Some(to) = &mut self.to else { return false };
        let sent = writeln!(to, "{command} >&2 && echo yes || echo no").and_then(|()| to.flush());
        let mut answer = String::new();
        sent.is_ok() && self.from.read_line(&mut answer).is_ok() && answer.trim() == "yes"
    }

    /// Path of the disk.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Makes the disk read-only.
    pub fn make_read_only(&mut self) {
        let at = self.mount.path().display().to_string();
        assert!(self.runs(&format!("mount -o remount,ro {at}")), "the disk cannot be made read-only");
    }

    /// Writes a file of `bytes` bytes; removing the file gives the room back.
    pub fn ballast(&self, bytes: u64) -> PathBuf {
        let file = self.path.join("ballast");
        fs::write(&file, vec![1; bytes as usize]).expect("room for the ballast");
        file
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        // The shell ends when its input closes, and the disk goes with the shell.
        self.to = None;
        let _ = self.shell.wait();
    }
}

/// Bytes on the disk of a file with this length.
pub fn on_disk(length: u64) -> u64 {
    length.next_multiple_of(PAGE)
}
