//! A model in training, for concurrent viewers.

use super::planes::Planes;
use crate::pass::counters;
use crate::vk::Buffer;

/// The planes of a model in training, with the buffer in which the device counts the splats. A cheap handle that keeps
/// the planes alive.
///
/// Between any two submits to the engine's queue the model is consistent. When training needs room for more splats,
/// training continues in new planes. An older handle keeps the last model in the old planes, and their memory.
#[derive(Clone)]
pub struct LiveModel {
    planes: Planes,
    counters: Buffer,
}

impl LiveModel {
    /// `counters` has the layout of [`crate::pass::counters`].
    pub(crate) fn new(planes: Planes, counters: Buffer) -> Self {
        Self { planes, counters }
    }

    /// The planes. Rows from the number of splats on are undefined.
    pub fn planes(&self) -> &Planes {
        &self.planes
    }

    /// The buffer with the number of splats, a `u32` at byte [`Self::count_offset`]. Only the engine writes to it.
    pub fn counters(&self) -> &Buffer {
        &self.counters
    }

    /// Byte offset of the number of splats in [`Self::counters`].
    pub fn count_offset(&self) -> u64 {
        4 * counters::SPLATS as u64
    }
}
