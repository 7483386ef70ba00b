//! What can go wrong in planning blocks.

use std::path::PathBuf;

use crate::byte_size::readable;
use crate::numbers::{counted, grouped};
use crate::{format, saliency, train};

/// An error of planning.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] format::Error),
    /// The training could not be planned.
    #[error(transparent)]
    Train(#[from] train::Error),
    /// Texture could not be measured.
    #[error(transparent)]
    Saliency(#[from] saliency::Error),
    /// There is nothing to train on.
    #[error("{}: there is no photograph to train on", dataset.display())]
    NoPhotographs {
        /// Folder of the dataset.
        dataset: PathBuf,
    },
    /// Nothing says where the surface lies.
    #[error(
        "{}: no photograph to train on sees a point, so nothing says how to cut the ground; \
         reconstruct points, for example with COLMAP's point_triangulator",
        dataset.display()
    )]
    NoSurface {
        /// Folder of the dataset.
        dataset: PathBuf,
    },
    /// A name of the dataset cannot stand in a plan.
    #[error(
        "{}: '{}' leads out of its folder on some systems, and a plan may be carried to any: rename the photograph",
        dataset.display(),
        name.escape_debug()
    )]
    Name {
        /// Folder of the dataset.
        dataset: PathBuf,
        /// The name.
        name: String,
    },
    /// No number of blocks keeps each one small enough.
    #[error(
        "{wanted} are too few for any number of blocks: with {} the largest still takes {least}. \
         Allow more, or lower `max-side` or `margin`",
        counted(*blocks, "block")
    )]
    TooSmall {
        /// What a block may take.
        wanted: Limit,
        /// Blocks of the finest cut that was tried.
        blocks: usize,
        /// What the largest block of it takes.
        least: Limit,
    },
}

/// What a block may take at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// Splats.
    Splats(u64),
    /// Bytes of device memory.
    Memory(u64),
}

impl std::fmt::Display for Limit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Splats(splats) => write!(f, "{} splats", grouped(*splats)),
            Self::Memory(bytes) => write!(f, "{} of device memory", readable(*bytes)),
        }
    }
}
