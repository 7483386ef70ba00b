//! Where a dataset lies on a map: by its own files, else by the positions that its photographs note, or by ground control
//! points.

mod control_points;
mod gps;
mod marks;
mod position;
mod report;

use std::path::PathBuf;

pub use control_points::{ControlPoints, Mark};
pub use position::{Position, noted_position};
pub use report::{FitReport, Off};

use super::Dataset;
use crate::format;
use crate::geodesy::{self, Georeference, KnownFrom, ReferenceSystem, VerticalDatum, fit::NoFit};
use crate::scene::Coordinates;

/// What a user says of where a dataset lies.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlaceOptions {
    /// The map's reference system: by default the dataset's or the control points' own, or the UTM zone.
    pub system: Option<ReferenceSystem>,
    /// What heights are measured from.
    pub heights: VerticalDatum,
    /// A file of ground control points in the format of OpenDroneMap.
    pub control_points: Option<PathBuf>,
}

/// Where a dataset lies.
#[derive(Clone, Debug)]
pub struct Placed {
    /// The way to the map.
    pub georeference: Georeference,
    /// What the fit to positions or control points left.
    pub fit: Option<FitReport>,
    /// Why the dataset is in a local system.
    pub unplaced: Option<String>,
}

/// A dataset could not be placed as it was asked for.
#[derive(Debug, thiserror::Error)]
pub enum PlaceError {
    /// The file of control points cannot be read.
    #[error(transparent)]
    File(#[from] format::Error),
    /// The reference system does not suit.
    #[error(transparent)]
    System(#[from] geodesy::Error),
    /// The control points do not suit the dataset.
    #[error("{}: {problem}", file.display())]
    ControlPoints {
        /// The file of control points.
        file: PathBuf,
        /// The problem and the remedy.
        problem: String,
    },
    /// A reference system is asked for, and nothing says where the dataset lies.
    #[error("{}: {problem}, so that nothing leads to {system}: give ground control points", dataset.display())]
    Unplaced {
        /// The dataset.
        dataset: PathBuf,
        /// What is missing.
        problem: String,
        /// The system.
        system: String,
    },
}

impl Dataset {
    /// Finds the way to a map. Without control points and without coordinates of its own, a dataset goes by the
    /// positions that its photographs note, and stays in a local system where they do not suffice, if no reference
    /// system is asked for.
    pub fn georeference(&self, options: &PlaceOptions) -> Result<Placed, PlaceError> {
        let placed = match (&options.control_points, &self.coordinates) {
            (Some(file), _) => self.by_control_points(&ControlPoints::read(file)?, options.system.clone())?,
            (None, Some(coordinates)) => self.by_coordinates(coordinates, options.system.clone())?,
            (None, None) => self.by_positions(options.system.clone())?,
        };
        let georeference = placed.georeference.with_heights(options.heights.clone());
        Ok(Placed { georeference, ..placed })
    }

    fn by_coordinates(&self, coordinates: &Coordinates, system: Option<ReferenceSystem>) -> Result<Placed, PlaceError> {
        match Georeference::of_coordinates(coordinates, system.clone()) {
            Ok(georeference) => Ok(Placed { georeference, fit: None, unplaced: None }),
            // A grid of an unknown name is a local system.
            Err(problem) if system.is_none() => Ok(Placed::local(problem.to_string())),
            Err(problem) => Err(problem.into()),
        }
    }

    fn by_positions(&self, system: Option<ReferenceSystem>) -> Result<Placed, PlaceError> {
        let unplaced = |problem: String| match &system {
            None => Ok(Placed::local(problem)),
            Some(system) => {
                let (dataset, system) = (self.path.clone(), system.to_string());
                Err(PlaceError::Unplaced { dataset, problem, system })
            }
        };
        let (tangent, fit, names) = match gps::fitted(self) {
            Ok(found) => found,
            Err(problem) => return unplaced(problem),
        };
        match Georeference::on_plane(tangent, &fit.similarity, system.clone()) {
            Ok(found) => {
                let georeference = found.known_by(KnownFrom::Gps);
                Ok(Placed { georeference, fit: Some(FitReport::new(names, &fit)), unplaced: None })
            }
            Err(problem) if system.is_none() => Ok(Placed::local(problem.to_string())),
            Err(problem) => Err(problem.into()),
        }
    }

    fn by_control_points(&self, points: &ControlPoints, system: Option<ReferenceSystem>) -> Result<Placed, PlaceError> {
        let refuse = |problem| PlaceError::ControlPoints { file: points.file.clone(), problem };
        let found = marks::triangulated(self, points).map_err(refuse)?;
        let own = points.system.check_map().is_ok().then(|| points.system.clone());
        let system = system.or(own);
        // A grid is no plane picture of the Earth: its points go to the Earth first.
        let grid = match &self.coordinates {
            Some(coordinates @ Coordinates::Grid { .. }) => Georeference::of_coordinates(coordinates, None).ok(),
            _ => None,
        };
        let (tangent, fit) = found.fitted(points, grid.as_ref()).map_err(|problem| refuse(open(&problem)))?;
        let made = match grid {
            Some(grid) => grid.moved(tangent, &fit.similarity, system)?,
            None => Georeference::on_plane(tangent, &fit.similarity, system)?,
        };
        let georeference = made.known_by(KnownFrom::ControlPoints);
        let report = FitReport::new(found.names(), &fit).with_notes(found.notes);
        Ok(Placed { georeference, fit: Some(report), unplaced: None })
    }
}

/// A fit's problem with the remedy for control points.
fn open(problem: &NoFit) -> String {
    let remedy = match problem {
        NoFit::TooFew(_) => "mark at least three points in two photographs each",
        NoFit::NoHeights(_) => "give heights of at least three points",
        NoFit::OnALine { .. } => "add a point beside the line",
        NoFit::NoAgreement { .. } => "are x and y in the order of the file's reference system?",
    };
    format!("{problem}; {remedy}")
}

impl Placed {
    fn local(problem: String) -> Self {
        Self { georeference: Georeference::local(), fit: None, unplaced: Some(problem) }
    }
}
