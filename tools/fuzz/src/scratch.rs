//! A folder for readers that take paths.

use std::fs;
use std::path::{Path, PathBuf};

/// A folder in `TMPDIR` that lasts as long as the process. `tools/fuzz/run` puts it into memory and clears it.
pub struct Scratch(PathBuf);

impl Default for Scratch {
    fn default() -> Self {
        Self::new()
    }
}

impl Scratch {
    /// An empty folder.
    pub fn new() -> Self {
        Self(tempfile::Builder::new().prefix("psrgs-fuzz-").tempdir().expect("a temporary folder").keep())
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Writes a file in the folder.
    pub fn put(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let file = self.0.join(name);
        fs::create_dir_all(file.parent().unwrap_or(&self.0)).expect("a folder");
        fs::write(&file, bytes).expect("a file");
        file
    }
}
