//! A scene, a finished training on it, and helpers that run the program.

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::OnceLock;

use psrgs_vk::world::{WorldParams, generate};

use crate::common;

/// Steps of the training that all tests share.
pub const STEPS: u32 = 150;

/// Options of the training that all tests share: growth is part of it.
pub const OPTIONS: [&str; 14] = [
    "--method",
    "3dgs",
    "--iterations",
    "150",
    "--deterministic",
    "--densify-from",
    "10",
    "--densify-interval",
    "20",
    "--densify-until",
    "120",
    "--opacity-reset-interval",
    "50",
    "--seed=3",
];

/// The program with arguments, without the environment variables that change its behaviour.
pub fn command(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_psrgs-vk"));
    command.args(args);
    for variable in ["PSRGS_DEVICE", "PSRGS_WEIGHTS", "RUST_BACKTRACE"] {
        command.env_remove(variable);
    }
    command
}

/// Runs the program to its end, and checks that it does not panic.
pub fn psrgs(args: &[&str]) -> Output {
    let output = command(args).output().expect("the command starts");
    assert!(!stderr(&output).contains("panicked"), "{args:?}: {}", stderr(&output));
    output
}

/// Runs the program, which must succeed; gives its standard error.
#[track_caller]
pub fn works(args: &[&str]) -> String {
    let output = psrgs(args);
    assert!(output.status.success(), "{args:?}: {}", stderr(&output));
    stderr(&output)
}

/// Runs the program, which must fail with the exit code `code` and a message with all `words`.
#[track_caller]
pub fn fails(args: &[&str], code: i32, words: &[&str]) {
    let output = psrgs(args);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(code), "{args:?}: {said}");
    for word in words {
        assert!(said.contains(word), "{args:?} does not say `{word}`: {said}");
    }
}

/// A running command, and its standard error so far.
pub struct Running {
    pub child: Child,
    lines: BufReader<std::process::ChildStderr>,
    said: String,
}

impl Running {
    pub fn new(args: &[&str]) -> Self {
        Self::of(&mut command(args))
    }

    /// As `new`, for a prepared command.
    pub fn of(command: &mut Command) -> Self {
        let mut child = command.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().expect("the command starts");
        let lines = BufReader::new(child.stderr.take().expect("a pipe"));
        Self { child, lines, said: String::new() }
    }

    /// Reads standard error until a line contains `word`.
    #[track_caller]
    pub fn until(&mut self, word: &str) {
        while self.lines.read_line(&mut self.said).expect("text") > 0 {
            if self.said.lines().last().is_some_and(|line| line.contains(word)) {
                return;
            }
        }
        panic!("never said `{word}`: {}", self.said);
    }

    /// Sends a signal to the process.
    pub fn signal(&self, signal: &str) {
        let sent = Command::new("kill").args([signal, &self.child.id().to_string()]).status().expect("kill runs");
        assert!(sent.success());
    }

    /// The exit code (`None` after a signal), and the whole standard error.
    pub fn end(mut self) -> (Option<i32>, String) {
        self.lines.read_to_string(&mut self.said).expect("text");
        let code = self.child.wait().expect("an end").code();
        assert!(!self.said.contains("panicked"), "{}", self.said);
        (code, self.said)
    }
}

/// Arguments in the form that the functions here take.
pub fn strs(args: &[String]) -> Vec<&str> {
    args.iter().map(String::as_str).collect()
}

/// Copies the files of a folder into another folder.
pub fn copy_folder(from: &Path, to: &Path) {
    for (file, bytes) in content(from) {
        let copy = to.join(file.strip_prefix(from).expect("inside"));
        fs::create_dir_all(copy.parent().expect("a folder")).expect("a folder");
        fs::write(copy, bytes).expect("written");
    }
}

/// The bytes of a file, or of all files in a folder, by path.
pub fn content(of: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    if of.is_dir() {
        for entry in fs::read_dir(of).expect("a folder") {
            found.extend(content(&entry.expect("an entry").path()));
        }
    } else {
        found.insert(of.to_owned(), fs::read(of).expect("a file"));
    }
    found
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

pub fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// A scene of nine photographs of 64x48, the first and the last held out, and a training on it.
pub struct Shared {
    folder: tempfile::TempDir,
    trained: OnceLock<()>,
}

impl Shared {
    pub fn data(&self) -> PathBuf {
        self.folder.path().join("scene")
    }

    /// The training's folder; the first call trains.
    pub fn run(&self) -> PathBuf {
        let out = self.folder.path().join("run");
        self.trained.get_or_init(|| {
            works(&strs(&self.train(&out)));
        });
        out
    }

    pub fn model(&self) -> PathBuf {
        self.run().join("point_cloud.ply")
    }

    /// Arguments of a training like the shared one into another folder, of fewer steps and with more options.
    pub fn train_for(&self, steps: u32, out: &Path, more: &[&str]) -> Vec<String> {
        let shared = STEPS.to_string();
        let steps = |arg: String| if arg == shared { steps.to_string() } else { arg };
        self.train(out).into_iter().map(steps).chain(more.iter().map(|s| (*s).to_owned())).collect()
    }

    /// Arguments of a training like the shared one into another folder.
    pub fn train(&self, out: &Path) -> Vec<String> {
        let data = self.data();
        let ends = ["train", text(&data), "--out", text(out)];
        ends.iter().chain(&OPTIONS).map(|s| (*s).to_owned()).collect()
    }
}

/// The one shared scene, made at the first call; `None` where there is no Vulkan driver.
pub fn shared() -> Option<&'static Shared> {
    static SHARED: OnceLock<Option<Shared>> = OnceLock::new();
    let make = || {
        common::gpu()?;
        let folder = tempfile::tempdir().expect("a temporary folder");
        let shared = Shared { folder, trained: OnceLock::new() };
        let params =
            WorldParams { images: 9, max_side: 64, pixels_per_point: 16, offpath: 2, ..WorldParams::default() };
        generate(&params, &shared.data(), &mut |_| ()).expect("a scene");
        Some(shared)
    };
    SHARED.get_or_init(make).as_ref()
}

/// A copy of a dataset, to be damaged.
pub fn copy_of(dataset: &Path) -> tempfile::TempDir {
    let copy = tempfile::tempdir().expect("a temporary folder");
    for folder in ["images", "sparse/0"] {
        fs::create_dir_all(copy.path().join(folder)).expect("a folder");
        for entry in fs::read_dir(dataset.join(folder)).expect("a folder") {
            let file = entry.expect("an entry").path();
            fs::copy(&file, copy.path().join(folder).join(file.file_name().expect("a name"))).expect("copied");
        }
    }
    copy
}
