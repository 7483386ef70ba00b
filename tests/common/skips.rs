//! Tests that cannot run where they are: said among the results, kept for the closing lines of `tools/test`, and
//! refused where all of them have to run.
#![allow(dead_code, unreachable_pub)]

use std::fmt::Display;
use std::fs;
use std::io::{self, Write as _};
use std::path::PathBuf;

/// Says that a test is skipped because something is missing that can be had: a driver, a browser, photographs. With
/// `PSRGS_REQUIRE_ALL=1` it fails.
#[track_caller]
pub fn skipped(why: impl Display) {
    assert!(std::env::var_os("PSRGS_REQUIRE_ALL").is_none_or(|all| all != "1"), "skipped: {why}");
    tell("skipped", &why);
}

/// Says that a test, or the rest of it, has nothing to look at on this device or machine, as it is of another kind.
/// It never fails.
pub fn left_out(why: impl Display) {
    tell("left out", &why);
}

/// Past the harness, which hides what a test prints that passes, and in a list (`$PSRGS_SKIPPED`, else `skipped.txt` of
/// cargo's folder for tests).
fn tell(what: &str, why: &dyn Display) {
    let name = std::thread::current().name().unwrap_or("a test").to_owned();
    let line = format!("{what}: {name}: {why}\n");
    // That it cannot be told fails no test.
    let _ = io::stderr().write_all(line.as_bytes());
    let usual = || PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("skipped.txt");
    let list = std::env::var_os("PSRGS_SKIPPED").map_or_else(usual, PathBuf::from);
    if let Ok(mut list) = fs::OpenOptions::new().create(true).append(true).open(list) {
        let _ = list.write_all(line.as_bytes());
    }
}
