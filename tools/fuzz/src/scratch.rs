//! A folder for readers that take paths.

use std::fs;
use std::path::{Path, PathBuf};

/// A folder that stays as long as the process, in `TMPDIR`: `tools/fuzz/run` puts that into memory and clears it.
pub struct Scratch(PathBuf);

impl Default for Scratch {
    fn default() -> Self {
        Self::new()
    }
}

impl Scratch {
    /// An empty one.
    pub fn new() -> Self {
        Self(tempfile::Builder::new().prefix("psrgs-fuzz-").tempdir().expect("a temporary folder").keep())
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Writes a file in it.
    pub fn put(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let file = self.0.join(name);
        fs::create_dir_all(file.parent().unwrap_or(&self.0)).expect("a folder");
        fs::write(&file, bytes).expect("a file");
        file
    }
}
