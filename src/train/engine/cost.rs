//! What a training costs in device memory.

use serde::Serialize;

use crate::raster::MemoryFootprint;

/// Device memory of a training: real allocations over the capacities they were made for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MemoryCost {
    /// Bytes per splat that fits: parameters, moments, statistics, what is between model and image.
    pub per_splat: f64,
    /// Bytes per (splat, tile) pair that fits: keys and values of the tile sort.
    pub per_pair: f64,
    /// Bytes per pixel of the largest photograph: image, loss and their gradients, the tiles' ranges.
    pub per_pixel: f64,
    /// Sums of gradients in slots, as in deterministic mode: bytes more per pair ...
    pub slots_per_pair: f64,
    /// ... and per splat.
    pub slots_per_splat: f64,
    /// Splats that fit.
    pub splats: u32,
    /// Pairs that fit.
    pub pairs: u32,
    /// Pixels that fit.
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
