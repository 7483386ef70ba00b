//! Photographs whose pixels turn out to be undecodable: a few are left out with a warning.

use std::collections::HashSet;
use std::path::PathBuf;

use super::error::Error;
use super::{Dataset, HostShare, Role, Supply, View, Warning, usable};
use crate::format::Tally;

/// A photograph that is left out because its pixels cannot be decoded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Undecodable {
    /// Its name.
    pub name: String,
    /// The photograph's role.
    pub role: Role,
    /// The decoder's problem.
    pub problem: String,
}

/// Photographs that were left out when they were decoded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Undecoded {
    /// The photographs that were left out.
    pub photographs: Vec<Undecodable>,
    /// The warning about them; `None` without any.
    pub warning: Option<Warning>,
}

/// Takes decoded photographs of a dataset and leaves out undecodable ones: at most one in ten, and none if the dataset
/// was loaded strictly.
pub struct Decoding {
    tally: Tally<Error>,
    folder: PathBuf,
    of: usize,
    found: Vec<Undecodable>,
}

impl Decoding {
    /// For a dataset's photographs, all of which are counted.
    pub fn of(dataset: &Dataset) -> Self {
        let folder = dataset.images.as_ref().map_or(&dataset.path, |images| &images.path).clone();
        Self { tally: Tally::new(dataset.strict), folder, of: dataset.views.len(), found: Vec::new() }
    }

    /// The decoded photograph of a view; `None` where it is left out. Errors that concern more than one photograph are
    /// returned.
    pub fn take<T>(&mut self, view: &View, decoded: Result<T, Error>) -> Result<Option<T>, Error> {
        if let Err(error) = &decoded {
            if !usable::is_of_one_photograph(error) {
                return decoded.map(Some);
            }
            let said = error.to_string();
            // The warning names the photograph already.
            let problem = said.strip_prefix(&format!("{}: ", view.path.display())).unwrap_or(&said).to_owned();
            self.found.push(Undecodable { name: view.name.clone(), role: view.role, problem });
        }
        self.tally.take(format_args!("'{}'", view.name), decoded)
    }

    /// [`Dataset::take_in`], with `None` also for photographs that are left out.
    pub fn take_in(
        &mut self,
        dataset: &Dataset,
        role: Role,
        share: &mut HostShare,
    ) -> Result<Vec<Option<Supply>>, Error> {
        let decoded = dataset.decoded(role, share);
        let views = dataset.views_of(role).map(|(_, view)| view);
        views.zip(decoded).map(|(view, decoded)| Ok(self.take(view, decoded)?.flatten())).collect()
    }

    /// The photographs that were left out. Fails if there are too many.
    pub fn end(self) -> Result<Undecoded, Error> {
        let kept = self.of.saturating_sub(self.found.len());
        let left_out = self.tally.end(&self.folder, "photographs", kept)?;
        let warning = left_out.zip(self.found.first()).map(|(mut left_out, first)| {
            left_out.problem = first.problem.clone();
            Warning::LeftOut(left_out)
        });
        Ok(Undecoded { photographs: self.found, warning })
    }
}

impl Dataset {
    /// Removes views whose photographs cannot be decoded. The scene's frame stays that of all poses.
    pub fn leave_out(&mut self, undecoded: &Undecoded) {
        if undecoded.photographs.is_empty() {
            return;
        }
        let gone: HashSet<&str> = undecoded.photographs.iter().map(|photograph| photograph.name.as_str()).collect();
        let stays = |view: &View| !gone.contains(view.name.as_str());
        let mut next = 0..;
        let places: Vec<Option<u32>> =
            self.views.iter().map(|view| if stays(view) { next.next() } else { None }).collect();
        self.tracks = self.tracks.kept(&vec![true; self.points.len()], &places);
        self.views.retain(stays);
        if let Some(masks) = &mut self.masks {
            masks.of = self.views.len();
            masks.matched = self.views.iter().filter(|view| view.mask.is_some()).count();
        }
    }
}
