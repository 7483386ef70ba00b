//! Whether photographs are still those that a plan was made from.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::{PlannedPhotograph, sha256_of};
use crate::dataset::{Dataset, Role, View};
use crate::format::Error;

/// Of the photographs to train on, and their masks, the first file that is not the one that a plan has. Photographs
/// that are not among the `planned` ones are not read.
pub fn changed_photograph(dataset: &Dataset, planned: &[PlannedPhotograph]) -> Result<Option<PathBuf>, Error> {
    let planned: HashMap<&str, &PlannedPhotograph> = planned.iter().map(|one| (one.name.as_str(), one)).collect();
    let known = dataset.views_of(Role::Train).filter_map(|(_, view)| Some((view, *planned.get(view.name.as_str())?)));
    let known: Vec<(&View, &PlannedPhotograph)> = known.collect();
    let changed = known.into_par_iter().map(|(view, planned)| changed_file(&dataset.path, view, planned));
    changed.find_first(|changed| !matches!(changed, Ok(None))).unwrap_or(Ok(None))
}

/// The photograph or the mask, whichever has changed.
fn changed_file(folder: &Path, view: &View, planned: &PlannedPhotograph) -> Result<Option<PathBuf>, Error> {
    if is_other(&view.path, &planned.sha256, planned.bytes)? {
        return Ok(Some(view.path.clone()));
    }
    match (&view.mask, &planned.mask) {
        (None, None) => Ok(None),
        (Some(mask), Some(planned)) => Ok(is_other(mask, &planned.sha256, planned.bytes)?.then(|| mask.clone())),
        (Some(new), None) => Ok(Some(new.clone())),
        (None, Some(gone)) => Ok(Some(folder.join(&gone.name))),
    }
}

/// Whether a file has another content. A file of another length is not read.
fn is_other(file: &Path, sha256: &str, bytes: u64) -> Result<bool, Error> {
    let length = file.metadata().map_err(Error::io(file, "read"))?.len();
    Ok(length != bytes || sha256_of(file)?.0 != sha256)
}
