//! Signals end the process in every state of the program and of its terminal.
#![cfg(target_os = "linux")]

use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::run::{command, shared, strs, text, works};
use crate::training::same_model;

/// Far longer than any wait here; a process that does not end in this time fails the test.
const PATIENCE: Duration = Duration::from_secs(60);
const SIGTERM: u32 = 15;

#[track_caller]
fn wait_for(what: &str, mut done: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !done() {
        assert!(begun.elapsed() < PATIENCE, "{what} has not come");
        sleep(Duration::from_millis(1));
    }
}

/// Waits until the process handles signals.
#[track_caller]
fn listens(child: &Child) {
    let status = format!("/proc/{}/status", child.id());
    wait_for("a process that listens", || {
        let status = fs::read_to_string(&status).unwrap_or_default();
        let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:"));
        caught
            .and_then(|hex| u64::from_str_radix(hex.trim(), 16).ok())
            .is_some_and(|mask| mask >> (SIGTERM - 1) & 1 == 1)
    });
}

fn signal(child: &Child, signal: &str) {
    assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().expect("kill runs").success());
}

/// The exit code; a process that does not end is killed.
#[track_caller]
fn code(mut child: Child) -> Option<i32> {
    let begun = Instant::now();
    loop {
        if let Some(status) = child.try_wait().expect("a state") {
            return status.code();
        }
        if begun.elapsed() > PATIENCE {
            child.kill().expect("killed");
            panic!("only SIGKILL has ended it");
        }
        sleep(Duration::from_millis(5));
    }
}

/// Standard error is a pipe whose reading end is closed.
#[test]
fn signals_end_a_training_that_lost_its_terminal_at_the_start() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    for name in ["-TERM", "-HUP", "-INT"] {
        let (reader, writer) = std::io::pipe().expect("a pipe");
        let out = folder.path().join(name);
        let mut command = command(&strs(&shared.train(&out)));
        let child = command.stdout(Stdio::null()).stderr(writer).spawn().expect("the command starts");
        drop((reader, command));
        listens(&child);
        signal(&child, name);
        assert_eq!(code(child), Some(130), "{name}");
    }
}

/// As with a stopped pager: writes to standard error block.
#[test]
fn signals_end_a_command_whose_terminal_is_blocked() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (model, data) = (shared.model(), shared.data());
    let (model, data, out) = (text(&model), text(&data), folder.path().join("out"));
    let commands: [&[&str]; 4] = [
        &["train", data, "--out", text(&out), "--iterations", "5"],
        &["eval", model, data],
        &["render", model, "--cameras", data, "--out", text(&out)],
        &["stereo", data, "--out", text(&out)],
    ];
    for args in commands {
        let (reader, mut writer) = std::io::pipe().expect("a pipe");
        // Fills the pipe.
        writer.write_all(&[b'x'; 1 << 16]).expect("room");
        let child = command(args).stdout(Stdio::null()).stderr(writer).spawn().expect("the command starts");
        listens(&child);
        sleep(Duration::from_millis(100));
        signal(&child, "-TERM");
        assert_eq!(code(child), Some(130), "{args:?}");
        drop(reader);
    }
}

/// The training is done and saved by then: a resumption writes the files.
#[test]
fn a_signal_while_scoring_ends_it_at_once_and_it_goes_on() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("run");
    let args = shared.train(&out);
    let (reader, writer) = std::io::pipe().expect("a pipe");
    let child = command(&strs(&args)).stdout(Stdio::null()).stderr(writer).spawn().expect("the command starts");
    wait_for("a picture", || fs::read_dir(out.join("renders")).is_ok_and(|mut files| files.next().is_some()));
    signal(&child, "-TERM");
    assert_eq!(code(child), Some(130));
    let said = std::io::read_to_string(reader).expect("text");
    assert!(said.contains("the training is done") && said.contains("train --resume"), "{said}");
    assert!(!out.join("metrics.json").exists() && out.join("point_cloud.ply").exists());
    works(&["train", "--resume", text(&out)]);
    assert!(out.join("metrics.json").exists() && out.join("report.html").exists());
    assert!(!unfinished(&out) && !unfinished(&out.join("renders")), "a file half written is left");
    same_model(shared, &out, "stopped while it was scored");
}

fn unfinished(folder: &Path) -> bool {
    let files = fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    files.into_iter().any(|file| file.extension().is_some_and(|e| e == "tmp"))
}

/// As in `psrgs-vk ... | head`.
#[test]
fn a_reader_that_has_seen_enough_is_no_error_and_no_panic() {
    for args in [&["options"][..], &["passes"], &["completions", "bash"], &["--help"], &["train", "--help"]] {
        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        let output = command(args).stdout(writer).stderr(Stdio::piped()).output().expect("the command starts");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(!said.contains("panicked") && output.status.code().is_some(), "{args:?}: {said}");
    }
}
