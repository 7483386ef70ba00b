//! The way from a dataset's coordinates to a map's.

use crate::geodesy::{Georeference, ReferenceSystem};
use crate::scene::{Camera, Coordinates, Similarity, turn, up_of};

/// From a dataset's coordinates to easting, northing and height.
#[derive(Clone, Debug)]
pub enum Placement {
    /// In a reference system.
    Earth(Box<Georeference>),
    /// In a local system, by a similarity.
    Local(Similarity),
}

impl Placement {
    /// As a georeference says. Where it knows no system, the dataset's coordinates, with z up if its files say so, or
    /// else turned so that z is the cameras' up.
    pub fn new(georeference: Georeference, coordinates: Option<&Coordinates>, cameras: &[Camera]) -> Self {
        if georeference.system().is_some() {
            return Self::Earth(Box::new(georeference));
        }
        let up = if coordinates.is_some() { None } else { up_of(cameras) };
        let rotation = up.map_or(Similarity::IDENTITY.rotation, |up| turn(up, [0.0, 0.0, 1.0]));
        Self::Local(Similarity { rotation, ..Similarity::IDENTITY })
    }

    /// Easting, northing and height of a dataset point.
    pub fn to_map(&self, point: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Earth(georeference) => georeference.to_map(point),
            Self::Local(similarity) => similarity.point(point),
        }
    }

    /// The inverse of [`Self::to_map`].
    pub fn to_dataset(&self, point: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Earth(georeference) => georeference.to_dataset(point),
            Self::Local(similarity) => similarity.inverse().point(point),
        }
    }

    /// The similarity that is best near a dataset point.
    pub fn similarity_at(&self, point: [f64; 3]) -> Similarity {
        match self {
            Self::Earth(georeference) => georeference.similarity_at(point),
            Self::Local(similarity) => *similarity,
        }
    }

    /// The reference system; `None` in a local one.
    pub fn system(&self) -> Option<&ReferenceSystem> {
        match self {
            Self::Earth(georeference) => georeference.system(),
            Self::Local(_) => None,
        }
    }

    /// Whether one similarity holds everywhere.
    pub fn is_similarity(&self) -> bool {
        matches!(self, Self::Local(_))
    }
}
