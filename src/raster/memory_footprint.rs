//! Memory of buffers, by the quantity that their size depends on.

/// Bytes allocated, by the quantity that they grow with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MemoryFootprint {
    /// Grow with splats.
    pub splats: u64,
    /// Grow with (splat, tile) pairs.
    pub pairs: u64,
    /// Grow with pixels or tiles.
    pub pixels: u64,
    /// Needed only for gradient sums in slots; grow with pairs.
    pub slot_pairs: u64,
    /// Needed only for gradient sums in slots; grow with splats.
    pub slot_splats: u64,
    /// Fixed size.
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
    /// Sum of all fields.
    pub fn total(&self) -> u64 {
        self.splats + self.pairs + self.pixels + self.slot_pairs + self.slot_splats + self.fixed
    }
}
