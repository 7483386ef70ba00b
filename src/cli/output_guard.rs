//! Keeps results out of the folders that they are made from.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use psrgs_vk::dataset::Dataset;

use super::exit::Failure;

/// Refuses a folder for results that is the dataset, or that contains its photographs or masks. Results have the names
/// of photographs and would replace them. Call this function before anything is written.
pub(crate) fn check(out: &Path, dataset: &Dataset) -> Result<(), Failure> {
    // A folder that does not exist has no files to replace.
    let Ok(wanted) = out.canonicalize() else { return Ok(()) };
    let is = |folder: &Path| folder.canonicalize().is_ok_and(|folder| folder == wanted);
    let what = if is(&dataset.path) {
        "the dataset, whose files could be replaced"
    } else if sources(dataset).iter().any(|folder| is(folder)) {
        "a folder of the dataset's photographs or masks, which could be replaced"
    } else {
        return Ok(());
    };
    Err(Failure::Usage(format!("--out {}: that is {what}; choose another folder", out.display())))
}

/// Folders with photographs or masks of the dataset, also where the dataset was loaded without photographs.
fn sources(dataset: &Dataset) -> BTreeSet<PathBuf> {
    let usual = |name: &str| name == "images" || name.starts_with("images_") || name == "masks";
    let mut roots: Vec<PathBuf> = fs::read_dir(&dataset.path)
        .into_iter()
        .flatten()
        .flatten()
        .filter(|entry| usual(&entry.file_name().to_string_lossy()))
        .map(|entry| entry.path())
        .collect();
    roots.extend(dataset.images.iter().map(|images| images.path.clone()));
    let mut folders: BTreeSet<PathBuf> = roots.iter().cloned().collect();
    // Names of photographs may contain folders inside these, or inside the dataset where it has none of these.
    roots.push(dataset.path.clone());
    for view in &dataset.views {
        let named = [Some(view.path.clone()), view.mask.clone()].into_iter().flatten();
        let files = roots.iter().map(|root| root.join(&view.name)).chain(named);
        folders.extend(files.filter(|file| file.is_file()).filter_map(|file| Some(file.parent()?.to_owned())));
    }
    folders
}
