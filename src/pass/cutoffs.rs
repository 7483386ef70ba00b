//! What blending leaves out: specialization constants of the passes that list tiles and blend.

use crate::vk::Constant;

/// A splat is skipped where its alpha is below this (a float).
pub(super) const ALPHA_MIN: Constant = Constant { id: 20, name: "ALPHA_MIN", default: Cutoffs::EXACT.alpha.to_bits() };

/// The constants together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cutoffs {
    /// A splat is skipped where its alpha is below this.
    pub alpha: f32,
}

impl Cutoffs {
    /// Those of Kerbl et al. (2023).
    pub const EXACT: Self = Self { alpha: crate::scene::tile::ALPHA_MIN };

    /// From the constants as a kernel gets them.
    pub fn of_bits(alpha: u32) -> Self {
        Self { alpha: f32::from_bits(alpha) }
    }

    /// For the passes that project, list tiles and blend.
    pub fn constants(&self) -> [(&'static str, u32); 1] {
        [(ALPHA_MIN.name, self.alpha.to_bits())]
    }
}
