//! The full picture and its overviews.

use super::pack::Samples;
use super::{Place, TILE};

/// The full picture or an overview.
pub(super) struct Level {
    pub(super) width: u32,
    pub(super) height: u32,
    /// Columns and rows of tiles.
    pub(super) across: u32,
    pub(super) down: u32,
    /// Tiles, row-major.
    pub(super) places: Vec<Place>,
}

/// A tile of an overview that waits for parts.
pub(super) struct Pending {
    pub(super) samples: Samples,
    pub(super) missing: u32,
}

impl Level {
    /// The picture, and halves of it until one has room in a tile.
    pub(super) fn all(width: u32, height: u32) -> Vec<Self> {
        let mut levels = vec![Self::new(width, height)];
        let (mut width, mut height) = (width, height);
        while width.max(height) > TILE {
            (width, height) = (width.div_ceil(2), height.div_ceil(2));
            levels.push(Self::new(width, height));
        }
        levels
    }

    fn new(width: u32, height: u32) -> Self {
        let (across, down) = (width.div_ceil(TILE), height.div_ceil(TILE));
        Self { width, height, across, down, places: vec![Place::default(); across as usize * down as usize] }
    }
}
