//! Advice for a folder that is no dataset.

use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Component, Path, PathBuf};

use super::folder::holds_pictures;
use super::foreign;
use super::model::Format;
use super::names::is_hidden;
use crate::format;

/// Most entries of a folder that are looked at.
const LOOKED_AT: usize = 1000;
/// Levels below a folder that are searched for a dataset.
const LEVELS_BELOW: usize = 3;

/// The error of the first unreadable folder among those where a dataset's files would be.
pub(super) fn unreadable(folder: &Path) -> Option<format::Error> {
    let sparse = folder.join("sparse");
    let models = fs::read_dir(&sparse).into_iter().flatten().take(LOOKED_AT).flatten().map(|entry| entry.path());
    let mut places = [folder.to_owned(), sparse.clone(), folder.join("opensfm")].into_iter().chain(models);
    places.find_map(|place| match look_into(&place) {
        Err(error) if error.kind() == ErrorKind::PermissionDenied => Some(format::Error::io(&place, "list")(error)),
        _ => None,
    })
}

/// Tries to list a folder and to inspect its entries.
fn look_into(folder: &Path) -> io::Result<()> {
    if fs::metadata(folder)?.is_dir() {
        fs::read_dir(folder).map(drop)?;
        fs::metadata(folder.join("."))?;
    }
    Ok(())
}

/// What the folder has instead of a dataset (of format `asked`, if given), and the remedy.
pub(super) fn instead_of_dataset(folder: &Path, asked: Option<Format>) -> String {
    let is_dataset = |path: &Path| match asked {
        Some(format) => format.is_in(path) || format.is_elsewhere(path),
        None => Format::ALL.into_iter().any(|format| format.is_in(path) || format.is_elsewhere(path)),
    };
    if !folder.exists() {
        return "there is no such folder".to_owned();
    }
    if !folder.is_dir() {
        return "it is a file, and a dataset is a folder".to_owned();
    }
    if let Some(other) = Format::ALL.into_iter().find(|format| format.is_in(folder) || format.is_elsewhere(folder)) {
        return format!("there is a {other} dataset: set no `format`, or `format` to {other}");
    }
    // A link is known by its name and by its target; `..` by its target alone.
    let real = folder.canonicalize().unwrap_or_default();
    if let Some((above, place)) = above(folder).into_iter().chain(above(&real)).find(|(path, _)| is_dataset(path)) {
        return format!("the dataset is {place}, {}", above.display());
    }
    let named = if folder.components().any(|part| part == Component::ParentDir) { real.as_path() } else { folder };
    let inside = datasets_below(named, is_dataset);
    if let Some(child) = inside.first() {
        return format!("there is one in {}", child.display());
    }
    if let Some(said) = foreign::incomplete_model(folder).or_else(|| foreign::cameras_in(folder)) {
        return said;
    }
    if holds_pictures(folder) || ["images", "input"].iter().any(|inside| holds_pictures(&folder.join(inside))) {
        return "there are photographs, but nothing says where they were taken from: COLMAP or OpenDroneMap finds that \
                out (docs/GUIDE.md, section 2)"
            .to_owned();
    }
    "docs/GUIDE.md, section 2, says how to make one from photographs".to_owned()
}

/// The datasets in the subfolders of a folder; where none exist, those one level deeper, and so on.
fn datasets_below(folder: &Path, is_dataset: impl Fn(&Path) -> bool) -> Vec<PathBuf> {
    let mut level = vec![folder.to_owned()];
    for _ in 0..LEVELS_BELOW {
        let children =
            level.iter().flat_map(|folder| fs::read_dir(folder).into_iter().flatten().take(LOOKED_AT).flatten());
        let children = children.map(|entry| entry.path()).filter(|path| !is_hidden(path)).take(LOOKED_AT);
        level = children.filter(|path| path.is_dir()).collect();
        level.sort();
        let found: Vec<PathBuf> = level.iter().filter(|path| is_dataset(path)).cloned().collect();
        if !found.is_empty() {
            return found;
        }
    }
    Vec::new()
}

/// The two parent folders of a path, and names for them in messages: the dataset of `sparse/0` is the second parent.
pub(super) fn above(folder: &Path) -> Vec<(&Path, &'static str)> {
    let (mut found, mut at) = (Vec::new(), folder);
    for place in ["the folder above it", "two folders above it"] {
        match at.parent() {
            // The parent of `a/..` is not `a`.
            Some(parent) if at.file_name().is_some() && !parent.as_os_str().is_empty() => at = parent,
            _ => break,
        }
        found.push((at, place));
    }
    found
}
