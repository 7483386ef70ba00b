//! What keeps a map from being made.

use crate::{format, vk};

/// A map cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The device failed.
    #[error(transparent)]
    Device(#[from] vk::Error),
    /// A file could not be written.
    #[error(transparent)]
    File(#[from] format::Error),
    /// A model without splats.
    #[error("the model has no splats")]
    NoSplats,
    /// A dataset without cameras.
    #[error("the dataset has no cameras")]
    NoCameras,
    /// The side of a cell is not a positive number.
    #[error("a ground sample distance must be a positive number of metres, not {0}")]
    Gsd(f64),
    /// The bounds hold nothing.
    #[error("bounds {0} hold no cell: west must be less than east, and south less than north, in metres of the map")]
    Bounds(String),
    /// More cells than files number.
    #[error(
        "{width} x {height} cells are more than 2^31: a ground sample distance of {fitting} m or more, or smaller \
         bounds, have room"
    )]
    Cells {
        /// Columns.
        width: u64,
        /// Rows.
        height: u64,
        /// The least distance that has room, in metres.
        fitting: f64,
    },
    /// Nothing says where the map lies.
    #[error("neither points nor splats say where the ground is: give bounds and a ground sample distance")]
    Nowhere,
}
