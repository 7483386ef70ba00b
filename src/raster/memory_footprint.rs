//! What buffers cost, by what they grow with.

/// Bytes allocated, by what their number follows from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MemoryFootprint {
    /// By splats.
    pub splats: u64,
    /// By (splat, tile) pairs.
    pub pairs: u64,
    /// By pixels, or by tiles.
    pub pixels: u64,
    /// Only because gradients are summed in slots: by pairs ...
    pub slot_pairs: u64,
    /// ... and by splats.
    pub slot_splats: u64,
    /// By nothing.
    pub fixed: u64,
}

impl std::ops::Add for MemoryFootprint {
    type Output = MemoryFootprint;
    fn add(self, other: MemoryFootprint) -> MemoryFootprint {
        MemoryFootprint {
            splats: self.splats + other.splats,
            pairs: self.pairs + other.pairs,
            pixels: self.pixels + other.pixels,
            slot_pairs: self.slot_pairs + other.slot_pairs,
            slot_splats: self.slot_splats + other.slot_splats,
            fixed: self.fixed + other.fixed,
        }
    }
}

impl MemoryFootprint {
    /// All of it.
    pub fn total(&self) -> u64 {
        self.splats + self.pairs + self.pixels + self.slot_pairs + self.slot_splats + self.fixed
    }
}
