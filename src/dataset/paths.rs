//! Paths of files in a dataset.

use std::path::{Component, Path};

/// Whether a name stays inside the folder it is looked up in.
pub(super) fn stays_inside(name: &str) -> bool {
    Path::new(name).components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir))
}

/// Whether a file or folder is hidden, as what macOS leaves beside each file of a foreign disk is (`._a.jpg`).
pub(super) fn is_hidden(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."))
}
