//! The coordinates of a model file.

use std::fmt;
use std::path::{Path, PathBuf};

use psrgs_vk::format::read_transform;
use psrgs_vk::scene::Similarity;

/// The options for the coordinates of a model.
#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct FrameArgs {
    /// The model is in coordinates of its own; this JSON file says how they come from the dataset's: a 4x4 or 3x4
    /// matrix, or an object with `transform` and `scale`, as nerfstudio's dataparser_transforms.json [default: the
    /// model is in the dataset's axes and units]
    #[arg(long, value_name = "FILE.json")]
    pub(crate) frame: Option<PathBuf>,
    /// Which way the transform of --frame leads
    #[arg(long, value_enum, requires = "frame", default_value_t = Direction::DatasetToModel)]
    pub(crate) frame_maps: Direction,
}

/// The direction of a transform.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Direction {
    /// From the dataset's coordinates to the model's.
    #[default]
    DatasetToModel,
    /// From the model's coordinates to the dataset's.
    ModelToDataset,
}

/// The coordinates of a model file.
#[derive(Clone, Debug)]
pub(crate) enum ModelFrame {
    /// The dataset's axes and units; `offset` was subtracted from positions.
    Dataset { offset: [f64; 3], known_from: &'static str },
    /// Other coordinates, with the similarity to the dataset's.
    Other { to_dataset: Similarity, file: PathBuf },
}

impl FrameArgs {
    /// The similarity from the model's coordinates to the dataset's, where the options name one.
    pub(crate) fn read(&self) -> anyhow::Result<Option<(Similarity, &Path)>> {
        let Some(file) = &self.frame else { return Ok(None) };
        let given = read_transform(file)?;
        let to_dataset = match self.frame_maps {
            Direction::DatasetToModel => given.inverse(),
            Direction::ModelToDataset => given,
        };
        Ok(Some((to_dataset, file)))
    }
}

impl fmt::Display for ModelFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Dataset { offset: [0.0, 0.0, 0.0], known_from } => {
                write!(f, "the dataset's axes and units ({known_from})")
            }
            Self::Dataset { offset: [x, y, z], known_from } => {
                write!(f, "the dataset's axes and units, moved by {x} {y} {z} ({known_from})")
            }
            Self::Other { to_dataset, file } => write!(
                f,
                "its own, one unit of it being {:.6} of the dataset's, turned by {:.3} degrees (--frame {})",
                to_dataset.scale,
                to_dataset.degrees(),
                file.display()
            ),
        }
    }
}
