//! Device memory of a training by splat, pair and pixel.

use serde::Serialize;

use crate::raster::MemoryFootprint;

/// Device memory of a training: bytes of the buffers divided by their capacities.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MemoryCost {
    /// Bytes per splat of the capacity: parameters, moments, statistics, projected splats.
    pub per_splat: f64,
    /// Bytes per (splat, tile) pair of the capacity: keys and values of the tile sort.
    pub per_pair: f64,
    /// Bytes per pixel of the largest photograph: image, loss and their gradients, ranges of the tiles.
    pub per_pixel: f64,
    /// Additional bytes for sums of gradients in slots, as in deterministic training: per pair ...
    pub slots_per_pair: f64,
    /// ... and per splat.
    pub slots_per_splat: f64,
    /// Capacity of splats.
    pub splats: u32,
    /// Capacity of pairs.
    pub pairs: u32,
    /// Capacity of pixels.
    pub pixels: u32,
    /// Bytes of the photographs.
    pub photographs: u64,
    /// Bytes of all buffers together.
    pub total: u64,
}

impl MemoryCost {
    pub(in crate::train) fn new(held: MemoryFootprint, [splats, pairs, pixels]: [u32; 3], photographs: u64) -> Self {
        let per = |bytes: u64, count: u32| bytes as f64 / f64::from(count.max(1));
        Self {
            per_splat: per(held.splats, splats),
            per_pair: per(held.pairs, pairs),
            per_pixel: per(held.pixels, pixels),
            slots_per_pair: per(held.slot_pairs, pairs),
            slots_per_splat: per(held.slot_splats, splats),
            splats,
            pairs,
            pixels,
            photographs,
            total: held.total() + photographs,
        }
    }
}
