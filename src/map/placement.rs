//! The way from a dataset's coordinates to a map's.

use crate::scene::{Camera, Coordinates, Similarity, turn, up_of};

/// From a dataset's coordinates to easting, northing and height.
#[derive(Clone, Debug)]
pub struct Placement {
    /// Turns the dataset's coordinates so that z is up.
    upright: Similarity,
}

impl Placement {
    /// Of a dataset that lies nowhere on Earth: its coordinates, with z up as files say, or else as its cameras say.
    pub fn local(coordinates: Option<&Coordinates>, cameras: &[Camera]) -> Self {
        let up = match coordinates {
            Some(_) => None,
            None => up_of(cameras),
        };
        let rotation = up.map_or(Similarity::IDENTITY.rotation, |up| turn(up, [0.0, 0.0, 1.0]));
        Self { upright: Similarity { rotation, ..Similarity::IDENTITY } }
    }

    /// By a similarity.
    pub fn of_similarity(similarity: Similarity) -> Self {
        Self { upright: similarity }
    }

    /// Easting, northing and height of a dataset point.
    pub fn to_map(&self, point: [f64; 3]) -> [f64; 3] {
        self.upright.point(point)
    }

    /// The inverse of [`Self::to_map`].
    pub fn to_dataset(&self, point: [f64; 3]) -> [f64; 3] {
        self.upright.inverse().point(point)
    }

    /// The similarity that is best near a dataset point.
    pub fn similarity_at(&self, _point: [f64; 3]) -> Similarity {
        self.upright
    }

    /// Whether one similarity holds everywhere.
    pub fn is_similarity(&self) -> bool {
        true
    }
}
