//! Chooses the folder of photographs among `images`, `images_2`, `images_4` and so on.

use super::names::is_hidden;
use std::collections::HashSet;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::error::Error;
use super::names;
use crate::format;

/// Most entries of a folder that are looked at.
const LOOKED_AT: usize = 1000;

/// A folder of photographs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImagesFolder {
    /// The folder.
    pub path: PathBuf,
    /// N of `images_N`; 1 for `images` and for a folder of another name.
    pub reduction: u32,
    /// Whether the folder was chosen automatically.
    pub automatic: bool,
}

/// Takes the folder that the options name. Else takes the most reduced folder that is complete and not smaller than the
/// training size, so that no photograph is decoded at a larger size than needed. Else takes the least reduced folder.
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
            return Err(no_photographs(dataset, folder.to_string_lossy().into_owned(), names));
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
        .find(|(_, path)| names.iter().all(|name| names::is_there(path, name)));
    match large_enough.or(found.first()) {
        Some((reduction, path)) => Ok(ImagesFolder { path: path.clone(), reduction: *reduction, automatic: true }),
        None => Err(no_photographs(dataset, "images and images_N".to_owned(), names)),
    }
}

fn no_photographs(dataset: &Path, looked_for: String, names: &[&str]) -> Error {
    let elsewhere = most_of(dataset, names).map(|(folder, count)| {
        let count = if count == names.len() { "all".to_owned() } else { count.to_string() };
        format!("; {count} of them are in {folder}: set `images` to {folder}")
    });
    Error::NoPhotographs { folder: dataset.to_owned(), looked_for, elsewhere: elsewhere.unwrap_or_default() }
}

/// Whether a dataset has one of the usual folders of photographs.
pub(super) fn has_usual(dataset: &Path) -> bool {
    let entries = fs::read_dir(dataset).into_iter().flatten().flatten();
    entries.filter(|entry| entry.path().is_dir()).any(|entry| entry.file_name().to_str().and_then(reduction).is_some())
}

/// The folder of a dataset with the most of the named photographs, and their number. For messages where no usual folder
/// exists.
fn most_of(dataset: &Path, names: &[&str]) -> Option<(String, usize)> {
    let entries = fs::read_dir(dataset).into_iter().flatten().flatten();
    let mut folders: Vec<PathBuf> =
        entries.map(|entry| entry.path()).filter(|path| path.is_dir() && !is_hidden(path)).collect();
    folders.sort();
    folders.push(dataset.to_owned());
    let count = |path: &PathBuf| names.iter().filter(|name| names::is_there(path, name)).count();
    let counted = folders.iter().map(|path| (path, count(path))).filter(|(_, count)| *count > 0);
    // The first of equal folders.
    let (path, count) = counted.reduce(|best, next| if next.1 > best.1 { next } else { best })?;
    let name = path.strip_prefix(dataset).ok().filter(|inside| !inside.as_os_str().is_empty());
    Some((name.map_or_else(|| ".".to_owned(), |inside| inside.display().to_string()), count))
}

/// A filter for the paths of pictures that may be photographs of a dataset. Where photographs lie in the dataset's
/// `own` folder, pictures in folders for other purposes do not pass unless a name leads there.
pub(super) fn may_hold<'a>(own: bool, named: impl IntoIterator<Item = &'a str>) -> impl Fn(&Path) -> bool {
    let named: Vec<String> = named.into_iter().map(|name| name.replace('\\', "/")).collect();
    let first_of =
        |path: &Path| path.iter().next().and_then(|part| part.to_str()).map(str::to_owned).unwrap_or_default();
    let asked: HashSet<String> = named.iter().flat_map(|name| name.split('/')).map(str::to_owned).collect();
    move |path| {
        let first = first_of(path);
        is_photograph(path) && !(own && is_of_something_else(&first) && !asked.contains(&first))
    }
}

/// Whether a folder of a dataset holds pictures that are no photographs, or reduced photographs.
fn is_of_something_else(folder: &str) -> bool {
    let known = ["mask", "masks", "depth", "depths", "normal", "normals", "renders", "offpath"];
    known.contains(&folder) || reduction(folder).is_some_and(|n| n > 1)
}

/// Whether a file or folder exists. Fails where permissions do not tell.
pub(super) fn exists(path: &Path) -> Result<bool, format::Error> {
    allowed(path)?;
    Ok(path.exists())
}

/// Passes errors of permissions on: such a file may exist.
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

/// Number of photographs in a folder and its subfolders, by extension.
pub(super) fn count_photographs(folder: &Path) -> usize {
    let Ok(entries) = fs::read_dir(folder) else { return 0 };
    entries
        .filter_map(Result::ok)
        .map(|entry| match entry.file_type() {
            Ok(kind) if kind.is_dir() && is_hidden(&entry.path()) => 0,
            Ok(kind) if kind.is_dir() => count_photographs(&entry.path()),
            _ => usize::from(is_photograph(&entry.path())),
        })
        .sum()
}

/// Whether a picture is among the first entries of a folder.
pub(super) fn holds_pictures(folder: &Path) -> bool {
    fs::read_dir(folder).into_iter().flatten().take(LOOKED_AT).flatten().any(|entry| is_photograph(&entry.path()))
}

/// Whether a file is a photograph by its extension.
pub(super) fn is_photograph(path: &Path) -> bool {
    if is_hidden(path) {
        return false;
    }
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
    ["jpg", "jpeg", "png", "exr", "tif", "tiff", "webp"].iter().any(|known| extension.eq_ignore_ascii_case(known))
}
