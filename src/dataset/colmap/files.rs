//! Which model of a dataset is read, and its files.

use std::fs;
use std::path::{Path, PathBuf};

use super::images;
use crate::dataset::{Error, Format, Warning};
use crate::format::Error as FileError;

/// The files of a model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Files {
    pub(super) cameras: PathBuf,
    pub(super) images: PathBuf,
    /// Binary, text or PLY; absent when the model has no points file.
    pub(super) points: Option<PathBuf>,
    pub(super) binary: bool,
    /// The folder inside the dataset, as it is told.
    place: String,
}

impl Files {
    /// The models of a dataset: those in `sparse/0`, `sparse/1` and so on, by their numbers, else that in `sparse`.
    pub(super) fn all(dataset: &Path) -> Vec<Self> {
        let sparse = dataset.join("sparse");
        let mut numbered: Vec<(u64, String)> = fs::read_dir(&sparse)
            .into_iter()
            .flatten()
            .flatten()
            .filter_map(|entry| entry.file_name().into_string().ok())
            .filter_map(|name| Some((name.parse::<u64>().ok()?, name)))
            .collect();
        numbered.sort();
        let inside = |(_, name): &(u64, String)| Self::inside(&sparse.join(name), format!("sparse/{name}"));
        let models: Vec<Self> = numbered.iter().filter_map(inside).collect();
        if models.is_empty() { Self::inside(&sparse, "sparse".to_owned()).into_iter().collect() } else { models }
    }

    /// The model in a folder: binary, else text, as COLMAP itself prefers. Points may be in another kind of file than the rest.
    fn inside(folder: &Path, place: String) -> Option<Self> {
        for (extension, binary) in [("bin", true), ("txt", false)] {
            let part = |name: &str| folder.join(format!("{name}.{extension}"));
            let (cameras, images) = (part("cameras"), part("images"));
            if cameras.is_file() && images.is_file() {
                let kinds = [extension, "bin", "txt", "ply"].map(|kind| folder.join(format!("points3D.{kind}")));
                let points = kinds.into_iter().find(|file| file.is_file());
                return Some(Self { cameras, images, points, binary, place });
            }
        }
        None
    }

    /// How many images the model has; little of it is read for that.
    fn count(&self) -> Result<u64, FileError> {
        if self.binary { images::count_binary(&self.images) } else { images::count_text(&self.images) }
    }
}

/// The model that is read. Several are parts of a reconstruction without a common frame: that is the one with the most images, the first
/// of these, and what the others have is told.
pub(super) fn choose(dataset: &Path) -> Result<(Files, Option<Warning>), Error> {
    let mut models = Files::all(dataset);
    if models.len() < 2 {
        let format = Format::Colmap;
        let none = || Error::no_model(dataset, format.looked_for().to_owned(), Some(format));
        return Ok((models.pop().ok_or_else(none)?, None));
    }
    let counts = models.iter().map(Files::count).collect::<Result<Vec<u64>, FileError>>()?;
    let most = counts.iter().copied().max().unwrap_or(0);
    let largest = counts.iter().position(|count| *count == most).unwrap_or(0);
    let used = models.remove(largest);
    let counts = counts.iter().enumerate().filter(|(at, _)| *at != largest).map(|(_, count)| *count);
    let others = models.into_iter().map(|model| model.place).zip(counts).collect();
    let warning = Warning::OtherModels { used: used.place.clone(), images: most, others };
    Ok((used, Some(warning)))
}
