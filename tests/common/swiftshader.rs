//! SwiftShader, a second Vulkan implementation on the CPU, which Chromium's packages contain: subgroups of 4, no float
//! atomics, no 16-bit storage, and a compiler whose time explodes with chains of branches in loops.
#![allow(dead_code, unreachable_pub)]

use std::io::Read as _;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use super::skipped;

/// Where packages install SwiftShader's manifest, which names the library beside it.
const PLACES: [&str; 4] =
    ["/usr/lib/chromium", "/usr/lib/chromium-browser", "/usr/lib64/chromium-browser", "/opt/google/chrome"];

/// SwiftShader's manifest, for the variables of the Vulkan loader; `None`, with a printed reason, where it is missing.
pub fn swiftshader() -> Option<PathBuf> {
    let manifests = PLACES.map(|place| PathBuf::from(place).join("vk_swiftshader_icd.json"));
    let found = manifests.into_iter().find(|file| file.exists());
    if found.is_none() {
        skipped("SwiftShader is not there (Debian's package chromium brings it)");
    }
    found
}

/// Runs a command on SwiftShader; gives whether the command succeeded, and its output. A runaway compiler fails by a
/// limit on memory, or after five minutes.
pub fn on_swiftshader(driver: &std::path::Path, command: &Command) -> (bool, String) {
    let mut limited = Command::new("sh");
    limited.args(["-c", "ulimit -v 8000000; exec \"$0\" \"$@\" 2>&1"]).arg(command.get_program());
    limited.args(command.get_args()).envs(["VK_DRIVER_FILES", "VK_ICD_FILENAMES"].map(|name| (name, driver)));
    for (name, value) in command.get_envs() {
        match value {
            Some(value) => limited.env(name, value),
            None => limited.env_remove(name),
        };
    }
    let mut child = limited.stdout(Stdio::piped()).spawn().expect("sh starts");
    let mut out = child.stdout.take().expect("a pipe");
    let reader = std::thread::spawn(move || {
        let mut said = Vec::new();
        // A broken pipe also ends the output.
        let _ = out.read_to_end(&mut said);
        String::from_utf8_lossy(&said).into_owned()
    });
    let end = Instant::now() + Duration::from_secs(300);
    let status = loop {
        if let Some(status) = child.try_wait().expect("a process") {
            break Some(status);
        }
        if Instant::now() > end {
            child.kill().expect("a process");
            child.wait().expect("a process");
            break None;
        }
        std::thread::sleep(Duration::from_millis(50));
    };
    let said = reader.join().expect("a reader");
    (status.is_some_and(|status| status.success()), said)
}
