//! Tests that cannot run on this machine: printed among the results, listed by `tools/test` at its end, and an error
//! where every test has to run.
#![allow(dead_code, unreachable_pub)]

use std::fmt::Display;
use std::fs;
use std::io::{self, Write as _};
use std::path::PathBuf;

/// Reports a test as skipped because something that can be installed is missing: a driver, a browser, photographs.
/// Panics with `PSRGS_REQUIRE_ALL=1`.
#[track_caller]
pub fn skipped(why: impl Display) {
    assert!(std::env::var_os("PSRGS_REQUIRE_ALL").is_none_or(|all| all != "1"), "skipped: {why}");
    tell("skipped", &why);
}

/// Reports that a test, or the rest of one, does not apply to this kind of device or machine. Never panics.
pub fn left_out(why: impl Display) {
    tell("left out", &why);
}

/// Writes the line to standard error past the harness, which hides the output of passing tests, and to a list
/// (`$PSRGS_SKIPPED`, else `skipped.txt` in cargo's folder for tests).
fn tell(what: &str, why: &dyn Display) {
    let name = std::thread::current().name().unwrap_or("a test").to_owned();
    let line = format!("{what}: {name}: {why}\n");
    // A line that cannot be written fails no test.
    let _ = io::stderr().write_all(line.as_bytes());
    let usual = || PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("skipped.txt");
    let list = std::env::var_os("PSRGS_SKIPPED").map_or_else(usual, PathBuf::from);
    if let Ok(mut list) = fs::OpenOptions::new().create(true).append(true).open(list) {
        let _ = list.write_all(line.as_bytes());
    }
}
