//! Where the rows of tiles of each splat begin and end, for the numbers of pairs of tiles.

use super::alpha_min::ALPHA_MIN;
use super::{Pass, module};
use crate::vk::{Kernel, read, read_write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Image width in pixels.
        pub width: u32,
        /// Image height in pixels.
        pub height: u32,
        /// Tile width in pixels.
        pub tile_width: u32,
        /// Tile height in pixels.
        pub tile_height: u32,
    }
}

/// Words of `edges` for up to `tiles` tiles, whatever the shape of the image: one per tile and one more per row of tiles,
/// then the number of visible splats.
pub fn words(tiles: u64) -> u64 {
    2 * tiles.max(1) + 1
}

/// The pass. `edges` must be zero beforehand.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "tile_edges",
        spirv: module("tile_edges"),
        bindings: &[read("splat2d"), read("tile_counts"), read("counters"), read_write("edges")],
        push_bytes: Push::BYTES,
        constants: &[ALPHA_MIN],
        local_size: Some(64),
    },
    doc: "One thread owns one splat; a workgroup owns 64 consecutive splats.",
    dispatch: "one thread per splat",
    push: Push::FIELDS,
};
