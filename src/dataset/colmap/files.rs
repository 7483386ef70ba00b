//! Chooses the model of a dataset, and finds its files.

use std::fs;
use std::path::{Path, PathBuf};

use super::images;
use crate::dataset::{Error, Format, Warning, folder, hint};
use crate::format::Error as FileError;

/// The files of a model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Files {
    pub(super) cameras: PathBuf,
    pub(super) images: PathBuf,
    /// Binary, text or PLY; absent when the model has no points file.
    pub(super) points: Option<PathBuf>,
    pub(super) binary: bool,
    /// The model's folder inside the dataset, for messages.
    place: String,
    /// The folder of the model's photographs, where that is not `images` or `images_N`.
    pub(super) photographs: Option<PathBuf>,
}

impl Files {
    /// The models of a dataset: those in `sparse/0`, `sparse/1` and so on, by their numbers, else that in `sparse`.
    pub(super) fn all(dataset: &Path) -> Vec<Self> {
        Self::numbered(&dataset.join("sparse"), "sparse")
    }

    /// The models in the folders `0`, `1` and so on of a folder, by their numbers, else that in the folder.
    fn numbered(folder: &Path, place: &str) -> Vec<Self> {
        let mut numbered: Vec<(u64, String)> =
            names_in(folder).into_iter().filter_map(|name| Some((name.parse::<u64>().ok()?, name))).collect();
        numbered.sort();
        let inside = |(_, name): &(u64, String)| Self::inside(&folder.join(name), format!("{place}/{name}"));
        let models: Vec<Self> = numbered.iter().filter_map(inside).collect();
        if models.is_empty() { Self::inside(folder, place.to_owned()).into_iter().collect() } else { models }
    }

    /// The models of a dataset in named folders of `sparse`, and in the dataset's own folder.
    pub(super) fn unusual(dataset: &Path) -> Vec<Self> {
        let sparse = dataset.join("sparse");
        let mut names: Vec<String> = names_in(&sparse)
            .into_iter()
            .filter(|name| name.parse::<u64>().is_err() && !name.starts_with('.'))
            .collect();
        names.sort();
        let named = names.iter().filter_map(|name| Self::inside(&sparse.join(name), format!("sparse/{name}")));
        let mut found: Vec<Self> = named.collect();
        if let Some(mut own) = Self::inside(dataset, ".".to_owned()).filter(|_| !is_part_of_another(dataset)) {
            own.photographs = (!folder::has_usual(dataset)).then(|| dataset.to_owned());
            found.push(own);
        }
        found
    }

    /// The models in working folders of other programs: `colmap` of nerfstudio, `distorted` of the 3DGS reference.
    fn of_other_programs(dataset: &Path) -> Vec<Self> {
        for place in ["colmap/sparse", "colmap"] {
            let found = Self::numbered(&dataset.join(place), place);
            if !found.is_empty() {
                return found;
            }
        }
        let mut found = Self::numbered(&dataset.join("distorted/sparse"), "distorted/sparse");
        for model in &mut found {
            // Cameras in `distorted` belong to the original photographs in `input`; those in `images` are undistorted.
            model.photographs = Some(dataset.join("input")).filter(|folder| folder.is_dir());
        }
        found
    }

    /// The models in places outside of COLMAP's layouts.
    pub(super) fn elsewhere(dataset: &Path) -> Vec<Self> {
        let unusual = Self::unusual(dataset);
        if unusual.is_empty() { Self::of_other_programs(dataset) } else { unusual }
    }

    /// The model in a folder: binary files, else text files, as COLMAP itself prefers. The points may be in another
    /// kind of file.
    fn inside(folder: &Path, place: String) -> Option<Self> {
        for (extension, binary) in [("bin", true), ("txt", false)] {
            let part = |name: &str| folder.join(format!("{name}.{extension}"));
            let (cameras, images) = (part("cameras"), part("images"));
            if cameras.is_file() && images.is_file() {
                let kinds = [extension, "bin", "txt", "ply"].map(|kind| folder.join(format!("points3D.{kind}")));
                let points = kinds.into_iter().find(|file| file.is_file());
                return Some(Self { cameras, images, points, binary, place, photographs: None });
            }
        }
        None
    }

    /// The number of images, from the beginning of the images file where possible.
    fn count(&self) -> Result<u64, FileError> {
        if self.binary { images::count_binary(&self.images) } else { images::count_text(&self.images) }
    }
}

fn names_in(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.file_name().into_string().ok()).collect()
}

/// Whether a folder is the model of a dataset above it (`sparse/0`), and no dataset itself.
fn is_part_of_another(folder: &Path) -> bool {
    let real = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let is_here =
        |model: &Files| model.images.parent().and_then(|at| at.canonicalize().ok()).as_deref() == Some(real.as_path());
    let named = |above: &Path| {
        let sparse = above.join("sparse");
        let names = names_in(&sparse).into_iter().filter(|name| !name.starts_with('.'));
        let named: Vec<Files> = names.filter_map(|name| Files::inside(&sparse.join(&name), name)).collect();
        Files::all(above).into_iter().chain(named).chain(Files::of_other_programs(above)).any(|model| is_here(&model))
    };
    hint::above(&real).into_iter().any(|(above, _)| named(above))
}

/// The model to read, and the warning about the others. Models in numbered folders are parts of a reconstruction
/// without a common frame: the one with the most images is read, the first of equal ones. The same holds for models in
/// other places, which are searched only where COLMAP's layouts have none.
pub(super) fn choose(dataset: &Path) -> Result<(Files, Option<Warning>), Error> {
    let usual = Files::all(dataset);
    let (mut models, others) = match usual.is_empty() {
        true => (Files::elsewhere(dataset), Vec::new()),
        false => (usual, Files::unusual(dataset)),
    };
    let mut others: Vec<String> = others.into_iter().map(|model| model.place).collect();
    // A model directly in `sparse`, beside the numbered folders.
    let beside = Files::inside(&dataset.join("sparse"), "sparse".to_owned()).map(|model| model.place);
    others.extend(beside.filter(|place| models.iter().all(|model| model.place != *place)));
    if models.len() < 2 {
        let format = Format::Colmap;
        let none = || Error::no_model(dataset, format.looked_for().to_owned(), Some(format));
        let only = models.pop().ok_or_else(none)?;
        let used = only.place.clone();
        return Ok((only, (!others.is_empty()).then_some(Warning::OtherPlaces { used, others })));
    }
    let counts = models.iter().map(Files::count).collect::<Result<Vec<u64>, FileError>>()?;
    let most = counts.iter().copied().max().unwrap_or(0);
    let largest = counts.iter().position(|count| *count == most).unwrap_or(0);
    let used = models.remove(largest);
    let is_numbered = |model: &Files| model.place.rsplit('/').next().is_some_and(|name| name.parse::<u64>().is_ok());
    let parts = is_numbered(&used) && models.iter().all(is_numbered);
    let place = used.place.clone();
    if !parts {
        let others = models.into_iter().map(|model| model.place).collect();
        return Ok((used, Some(Warning::OtherPlaces { used: place, others })));
    }
    let counts = counts.iter().enumerate().filter(|(at, _)| *at != largest).map(|(_, count)| *count);
    let others = models.into_iter().map(|model| model.place).zip(counts).collect();
    let warning = Warning::OtherModels { used: place, images: most, others };
    Ok((used, Some(warning)))
}
