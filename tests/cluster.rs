//! Blocks on many machines: the Python package `tools/cluster`, on a cluster that lives on this machine alone.

#[path = "common/skips.rs"]
mod skips;

use std::path::Path;
use std::process::{Command, Stdio};

/// The exit code of `tools/cluster/test` where Ray or a network of its own cannot be had.
const NOT_HERE: i32 = 77;

#[test]
fn faults_of_a_cluster_change_no_bit_of_the_result() {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/cluster/test");
    let program = env!("CARGO_BIN_EXE_psrgs-vk");
    let Ok(output) = Command::new(script).arg(program).stdin(Stdio::null()).output() else {
        return skips::left_out("no bash to run tools/cluster/test");
    };
    let said = String::from_utf8_lossy(&output.stdout);
    if output.status.code() == Some(NOT_HERE) {
        return skips::left_out(said.lines().last().unwrap_or("tools/cluster/test says no reason"));
    }
    let error = String::from_utf8_lossy(&output.stderr);
    // The names of the Python tests, and why one of them is skipped.
    println!("{error}");
    assert!(output.status.success(), "{said}{error}");
    for reason in error.lines().filter_map(|line| line.split_once("... skipped ")) {
        skips::left_out(format_args!("{}: {}", reason.0.trim(), reason.1));
    }
}
