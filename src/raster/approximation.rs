//! What a picture may lose to be drawn faster.

use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use crate::pass::cutoffs::Cutoffs;

/// How the numbers of spherical harmonics are stored on the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ShStorage {
    /// In 32 bits.
    #[default]
    Full,
    /// In half floats, which take half the memory: for pictures, training needs all bits.
    Half,
}

impl ShStorage {
    /// Bits of a number.
    pub fn bits(self) -> u32 {
        match self {
            Self::Full => 32,
            Self::Half => 16,
        }
    }
}

/// What a picture may lose to be drawn faster. Unlike the other forms of the passes these change results by more than roundings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Approximation {
    /// A splat is skipped at a pixel where its alpha is below 1 / this, and listed only in tiles where it is not.
    pub alpha_cutoff: u32,
}

impl Default for Approximation {
    fn default() -> Self {
        Self::NONE
    }
}

impl Approximation {
    /// As published (Kerbl et al. 2023).
    pub const NONE: Self = Self { alpha_cutoff: 255 };

    /// Cut-offs of alpha that can be asked for.
    pub const ALPHA_CUTOFFS: RangeInclusive<u32> = 2..=65_535;

    /// What the passes get of it.
    pub fn cutoffs(&self) -> Cutoffs {
        let part = |of: u32| (1.0 / f64::from(of.max(1))) as f32;
        Cutoffs { alpha: part(self.alpha_cutoff) }
    }
}

#[cfg(test)]
mod tests {
    use super::{Approximation, Cutoffs};

    #[test]
    fn no_approximation_has_the_constants_of_the_shaders() {
        assert_eq!(Approximation::NONE.cutoffs(), Cutoffs::EXACT);
    }
}
