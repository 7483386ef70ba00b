//! A model that changes on the device while others look at it.

use super::planes::Planes;
use crate::pass::counters;
use crate::vk::Buffer;

/// The planes of a model in training, with the buffer in which the device counts its splats. A handle: cloning it
/// copies nothing, and it keeps the planes alive.
///
/// Between any two submits to the engine's queue it is a whole model. When training makes room for more splats it goes
/// on in new planes, and a handle taken before stays with the last model of the old ones, whose memory it holds.
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

    /// Where the number of splats stands in [`Self::counters`], in bytes.
    pub fn count_offset(&self) -> u64 {
        4 * counters::SPLATS as u64
    }
}
