//! The folder of photographs, among `images`, `images_2`, `images_4` and so on.

use std::fs;
use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};

use super::error::Error;
use crate::format;

/// A folder of photographs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImagesFolder {
    /// The folder.
    pub path: PathBuf,
    /// N of `images_N`; 1 for `images` and for a folder of another name.
    pub reduction: u32,
    /// Whether it was chosen rather than asked for.
    pub automatic: bool,
}

/// Uses the folder asked for, else the most reduced one that is complete and not smaller than the size trained at, else
/// the least reduced one there is: photographs are not decoded at a size that is thrown away.
pub(super) fn choose(
    dataset: &Path,
    asked: Option<&Path>,
    longest_side: u32,
    wanted: u32,
    names: &[&str],
) -> Result<ImagesFolder, Error> {
    if let Some(folder) = asked {
        let path = dataset.join(folder);
        if !path.is_dir() {
            allowed(&path)?;
            return Err(Error::NoPhotographs {
                folder: dataset.to_owned(),
                looked_for: folder.to_string_lossy().into_owned(),
            });
        }
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let reduction = reduction(&name).unwrap_or(1);
        return Ok(ImagesFolder { path, reduction, automatic: false });
    }
    let entries = fs::read_dir(dataset).map_err(format::Error::io(dataset, "list"))?;
    let mut found: Vec<(u32, PathBuf)> = entries
        .filter_map(|entry| entry.ok().map(|e| e.path()))
        .filter(|path| path.is_dir())
        .filter_map(|path| Some((reduction(path.file_name()?.to_str()?)?, path)))
        .collect();
    found.sort();
    let large_enough = found
        .iter()
        .rev()
        .filter(|(n, _)| longest_side / n >= wanted)
        .find(|(_, path)| names.iter().all(|name| path.join(name).is_file()));
    match large_enough.or(found.first()) {
        Some((reduction, path)) => Ok(ImagesFolder { path: path.clone(), reduction: *reduction, automatic: true }),
        None => Err(Error::NoPhotographs { folder: dataset.to_owned(), looked_for: "images and images_N".to_owned() }),
    }
}

/// Refuses what may not be looked at: nobody knows that it is missing.
pub(super) fn allowed(path: &Path) -> Result<(), format::Error> {
    match fs::metadata(path) {
        Err(error) if error.kind() == ErrorKind::PermissionDenied => Err(format::Error::io(path, "open")(error)),
        _ => Ok(()),
    }
}

fn reduction(name: &str) -> Option<u32> {
    match name.strip_prefix("images")? {
        "" => Some(1),
        rest => rest.strip_prefix('_')?.parse().ok().filter(|n| *n > 0),
    }
}

/// Whether a name stays inside the folder it is looked up in.
pub(super) fn stays_inside(name: &str) -> bool {
    Path::new(name).components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir))
}

/// Photographs in a folder, counted by their extension, subfolders included.
pub(super) fn count_photographs(folder: &Path) -> usize {
    let Ok(entries) = fs::read_dir(folder) else { return 0 };
    entries
        .filter_map(Result::ok)
        .map(|entry| match entry.file_type() {
            Ok(kind) if kind.is_dir() => count_photographs(&entry.path()),
            _ => usize::from(is_photograph(&entry.path())),
        })
        .sum()
}

/// Whether a file is a photograph by its extension.
pub(super) fn is_photograph(path: &Path) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
    ["jpg", "jpeg", "png", "exr", "tif", "tiff", "webp"].iter().any(|known| extension.eq_ignore_ascii_case(known))
}
