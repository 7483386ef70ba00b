//! The common representation of all formats.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use super::lens::Lens;
use super::{NoColours, Point, Tracks, Warning};
use crate::scene::Coordinates;

/// A layout of datasets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// COLMAP's cameras, images and points3D, binary or text, in `sparse/` or in the `sparse/N/` with the most images.
    /// Where no format is in its usual place: other folders of `sparse/`, the folder itself, `colmap/sparse/` and
    /// `distorted/sparse/`.
    Colmap,
    /// `transforms.json`, or `transforms_train.json` and its siblings.
    Nerfstudio,
    /// `reconstruction.json`, or `opensfm/reconstruction.json` of OpenDroneMap.
    Opensfm,
}

impl Format {
    /// All formats, in the order of the search.
    pub const ALL: [Self; 3] = [Self::Colmap, Self::Nerfstudio, Self::Opensfm];

    pub(super) fn looked_for(self) -> &'static str {
        match self {
            Self::Colmap => {
                "cameras and images (.bin or .txt) in sparse/0, sparse/1 ... and in sparse, in other folders of \
                 sparse, in the folder itself, in colmap/sparse and in distorted/sparse (COLMAP)"
            }
            Self::Nerfstudio => "transforms.json (nerfstudio), transforms_train.json (NeRF)",
            Self::Opensfm => "reconstruction.json and opensfm/reconstruction.json (OpenSfM, OpenDroneMap)",
        }
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Colmap => "colmap",
            Self::Nerfstudio => "nerfstudio",
            Self::Opensfm => "opensfm",
        })
    }
}

impl FromStr for Format {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        let known = Self::ALL.into_iter().find(|format| format.to_string() == word);
        known.ok_or_else(|| format!("no format `{word}`: it is colmap, nerfstudio or opensfm"))
    }
}

/// A photograph's observation of a reconstructed point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Observation {
    /// Pixels at the size of the lens's calibration.
    pub(super) at: [f64; 2],
    /// The point's id.
    pub(super) point: u64,
}

/// One posed photograph.
#[derive(Clone, Debug)]
pub(super) struct Shot {
    /// Its name, made safe for the folders of results.
    pub(super) name: String,
    /// The photograph's path inside the folder of photographs: as in the model until the file is found.
    pub(super) file: String,
    /// The camera's name in the model's file.
    pub(super) camera: String,
    /// The file's name of the camera model.
    pub(super) model: String,
    pub(super) lens: Lens,
    /// Rotation from the dataset's axes to the camera's, row-major.
    pub(super) rotation: [[f64; 3]; 3],
    /// x_cam = rotation x + translation.
    pub(super) translation: [f64; 3],
    /// Path of the mask in the dataset, if the file names one.
    pub(super) mask: Option<String>,
    /// The parts to which the dataset assigns the photograph, if it does.
    pub(super) part: Option<SplitParts>,
    /// Some observations of points, if the format has them.
    pub(super) observations: Vec<Observation>,
}

/// Poses, lenses and points in the dataset's coordinates.
pub(super) struct Model {
    pub(super) format: Format,
    /// The file with the poses.
    pub(super) file: PathBuf,
    /// All files that the model was read from.
    pub(super) files: Vec<PathBuf>,
    pub(super) shots: Vec<Shot>,
    /// Points by ascending id.
    pub(super) points: Vec<Point>,
    /// Why the points have no colours; `None` where they have.
    pub(super) colourless: Option<NoColours>,
    /// Observing views of each point, by position among the shots; empty where the format does not say.
    pub(super) tracks: Tracks,
    /// The points file, which may be missing.
    pub(super) points_file: Option<PathBuf>,
    /// The folder of photographs, where it is not `images` or `images_N`.
    pub(super) images: Option<PathBuf>,
    /// See [`super::Dataset::coordinates`].
    pub(super) coordinates: Option<Coordinates>,
    pub(super) warnings: Vec<Warning>,
}

impl Model {
    /// Sorts the poses by name.
    pub(super) fn sort(&mut self) {
        let mut order: Vec<usize> = (0..self.shots.len()).collect();
        if self.shots.is_sorted_by(|a, b| a.name <= b.name) {
            return;
        }
        order.sort_by(|a, b| self.shots[*a].name.cmp(&self.shots[*b].name));
        let mut places = vec![None; order.len()];
        for (place, old) in order.iter().enumerate() {
            places[*old] = Some(place as u32);
        }
        self.tracks = self.tracks.kept(&vec![true; self.points.len()], &places);
        self.shots.sort_by(|a, b| a.name.cmp(&b.name));
    }

    /// Keeps the poses where `kept` is true.
    pub(super) fn keep_shots(&mut self, kept: &[bool]) {
        if kept.iter().all(|kept| *kept) {
            return;
        }
        let mut next = 0..;
        let places: Vec<Option<u32>> = kept.iter().map(|kept| if *kept { next.next() } else { None }).collect();
        self.tracks = self.tracks.kept(&vec![true; self.points.len()], &places);
        let mut each = kept.iter();
        self.shots.retain(|_| each.next().copied().unwrap_or(true));
    }

    /// Keeps the points where `kept` is true.
    pub(super) fn keep_points(&mut self, kept: &[bool]) {
        if kept.iter().all(|kept| *kept) {
            return;
        }
        let places: Vec<Option<u32>> = (0..self.shots.len() as u32).map(Some).collect();
        self.tracks = self.tracks.kept(kept, &places);
        let mut each = kept.iter();
        self.points.retain(|_| each.next().copied().unwrap_or(true));
    }
}

/// The parts (training, validation, test) to which a dataset assigns a photograph: one, several, or none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct SplitParts {
    pub(super) train: bool,
    pub(super) val: bool,
    pub(super) test: bool,
}

impl SplitParts {
    pub(super) const TRAIN: Self = Self { train: true, val: false, test: false };
    pub(super) const VAL: Self = Self { train: false, val: true, test: false };
    pub(super) const TEST: Self = Self { train: false, val: false, test: true };

    /// The union of both.
    pub(super) fn and(self, other: Self) -> Self {
        Self { train: self.train || other.train, val: self.val || other.val, test: self.test || other.test }
    }
}
