//! A scene, a finished training on it, and running the command.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
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

/// The command with arguments, without the variables that change it.
pub fn command(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_psrgs-vk"));
    command.args(args).env_remove("PSRGS_DEVICE").env_remove("RUST_BACKTRACE");
    command
}

/// Runs it to its end. It never panics.
pub fn psrgs(args: &[&str]) -> Output {
    let output = command(args).output().expect("the command starts");
    assert!(!stderr(&output).contains("panicked"), "{args:?}: {}", stderr(&output));
    output
}

/// Runs it, must succeed; gives what it said.
#[track_caller]
pub fn works(args: &[&str]) -> String {
    let output = psrgs(args);
    assert!(output.status.success(), "{args:?}: {}", stderr(&output));
    stderr(&output)
}

/// Runs it, must fail with a code and say all words.
#[track_caller]
pub fn fails(args: &[&str], code: i32, words: &[&str]) {
    let output = psrgs(args);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(code), "{args:?}: {said}");
    for word in words {
        assert!(said.contains(word), "{args:?} does not say `{word}`: {said}");
    }
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

pub fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// A scene of nine photographs, 64 x 48, of which the first and the last are held out, and a training on it.
pub struct Shared {
    folder: tempfile::TempDir,
}

impl Shared {
    pub fn data(&self) -> PathBuf {
        self.folder.path().join("scene")
    }

    pub fn run(&self) -> PathBuf {
        self.folder.path().join("run")
    }

    pub fn model(&self) -> PathBuf {
        self.run().join("point_cloud.ply")
    }

    /// Arguments of a training like the shared one into another folder.
    pub fn train(&self, out: &Path) -> Vec<String> {
        let data = self.data();
        let ends = ["train", text(&data), "--out", text(out)];
        ends.iter().chain(&OPTIONS).map(|s| (*s).to_owned()).collect()
    }
}

/// Made once; `None` where there is no Vulkan driver.
pub fn shared() -> Option<&'static Shared> {
    static SHARED: OnceLock<Option<Shared>> = OnceLock::new();
    let make = || {
        common::gpu()?;
        let shared = Shared { folder: tempfile::tempdir().expect("a temporary folder") };
        let params =
            WorldParams { images: 9, max_side: 64, pixels_per_point: 16, offpath: 2, ..WorldParams::default() };
        generate(&params, &shared.data(), &mut |_| ()).expect("a scene");
        let args = shared.train(&shared.run());
        works(&args.iter().map(String::as_str).collect::<Vec<_>>());
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
