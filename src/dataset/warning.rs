//! What the user should know about a dataset that loads.

use std::fmt;
use std::path::PathBuf;

/// A peculiarity of a dataset.
#[derive(Clone, Debug, PartialEq)]
pub enum Warning {
    /// All training cameras are at one place (or there is one only), so the scene's extent comes from the points.
    CamerasAtOnePlace {
        /// Number of training cameras.
        cameras: usize,
        /// The extent used instead, in dataset units.
        extent: f64,
    },
    /// Every pixel of a photograph is masked: it is not used.
    AllMasked {
        /// The view.
        name: String,
    },
    /// There are too few photographs to hold any out.
    NothingHeldOut {
        /// Number of photographs.
        views: usize,
    },
    /// The model has no points: training needs them, or a model to begin with.
    NoPoints {
        /// The points file, if there is one.
        file: Option<PathBuf>,
    },
    /// The folder has photographs that the model does not place.
    PhotographsWithoutPose {
        /// How many.
        photographs: usize,
    },
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::CamerasAtOnePlace { cameras, extent } => write!(
                f,
                "the training cameras ({cameras}) are all at one place: the scene's extent is taken from the points ({extent} units)"
            ),
            Self::AllMasked { name } => write!(f, "'{name}': every pixel is masked; it is left out"),
            Self::NothingHeldOut { views } => {
                write!(
                    f,
                    "{views} photographs are too few to hold any out: all are trained on, and no quality is measured"
                )
            }
            Self::NoPoints { file: None } => write!(f, "the model has no points3D file"),
            Self::NoPoints { file: Some(file) } => write!(f, "{}: the model has no points", file.display()),
            Self::PhotographsWithoutPose { photographs } => {
                write!(f, "{photographs} photographs have no pose in the model and are not used")
            }
        }
    }
}
