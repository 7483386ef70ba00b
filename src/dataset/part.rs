//! Some photographs of a dataset, placed and split as the whole dataset is.

use std::collections::{BTreeSet, HashMap};
use std::path::Path;

use super::{Dataset, Error, LoadOptions, Role};
use crate::scene::Frame;

/// What a part of a dataset has from the whole.
pub(super) struct OfWhole {
    /// The role of every photograph of the part by name.
    roles: HashMap<String, Role>,
    pub(super) frame: Frame,
    pub(super) extent: f64,
}

impl OfWhole {
    /// The role of a photograph; `None` if it does not belong to the part.
    pub(super) fn role(&self, name: &str) -> Option<Role> {
        self.roles.get(name).copied()
    }
}

impl Dataset {
    /// Loads the named photographs of a dataset. Roles, frame and extent are those that all poses of the dataset give,
    /// so that parts of a dataset fit together and a photograph that the dataset holds out is held out of every part.
    /// The files of other photographs are not looked at and may be missing.
    pub fn load_part(path: &Path, options: &LoadOptions, names: &BTreeSet<String>) -> Result<Self, Error> {
        let whole = Self::load(path, &LoadOptions { photographs: false, ..options.clone() })?;
        let (frame, extent) = (whole.frame, whole.extent);
        let named = whole.views.into_iter().filter(|view| names.contains(&view.name));
        let roles: HashMap<String, Role> = named.map(|view| (view.name, view.role)).collect();
        if let Some(unknown) = names.iter().find(|name| !roles.contains_key(name.as_str())) {
            return Err(Error::NoSuchPhotograph { dataset: path.to_owned(), name: unknown.clone() });
        }
        Self::load_of(path, options, Some(&OfWhole { roles, frame, extent }))
    }
}
