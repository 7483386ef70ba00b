//! What to say to someone who names a folder that is no dataset.

use std::path::Path;

use super::model::Format;

/// Entries of a folder that are looked at.
const LOOKED_AT: usize = 1000;

/// What is there instead, and what to do about it.
pub(super) fn instead_of_dataset(folder: &Path) -> String {
    let is_dataset = |path: &Path| Format::ALL.into_iter().any(|format| format.is_in(path));
    if !folder.exists() {
        return "there is no such folder".to_owned();
    }
    if !folder.is_dir() {
        return "it is a file, and a dataset is a folder".to_owned();
    }
    // Of `sparse/0` it is two above.
    let mut above = folder.ancestors().skip(1).take(2).zip(["the folder above it", "two folders above it"]);
    if let Some((above, place)) = above.find(|(above, _)| is_dataset(above)) {
        return format!("the dataset is {place}, {}", above.display());
    }
    let children = std::fs::read_dir(folder).into_iter().flatten().take(LOOKED_AT).flatten();
    let mut inside: Vec<_> = children.map(|entry| entry.path()).filter(|path| is_dataset(path)).collect();
    inside.sort();
    if let Some(child) = inside.first() {
        return format!("there is one in {}", child.display());
    }
    if has_photographs(folder) || has_photographs(&folder.join("images")) {
        return "there are photographs, but nothing says where they were taken from: COLMAP or OpenDroneMap finds that out \
                (docs/GUIDE.md, section 2)"
            .to_owned();
    }
    "docs/GUIDE.md, section 2, says how to make one from photographs".to_owned()
}

fn has_photographs(folder: &Path) -> bool {
    let is_photograph = |path: &Path| {
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        ["jpg", "jpeg", "png", "exr"].contains(&extension.as_str())
    };
    std::fs::read_dir(folder).into_iter().flatten().take(LOOKED_AT).flatten().any(|entry| is_photograph(&entry.path()))
}
