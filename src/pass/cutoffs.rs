//! What blending leaves out: specialization constants of the passes that list tiles and blend.

use crate::vk::Constant;

/// A splat is skipped where its alpha is below this (a float).
pub(super) const ALPHA_MIN: Constant = Constant { id: 20, name: "ALPHA_MIN", default: Cutoffs::EXACT.alpha.to_bits() };
/// A pixel stops before the splat that would take its transmittance below this (a float).
pub(super) const TRANSMITTANCE_MIN: Constant =
    Constant { id: 21, name: "TRANSMITTANCE_MIN", default: Cutoffs::EXACT.transmittance.to_bits() };

/// The constants together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cutoffs {
    /// A splat is skipped where its alpha is below this.
    pub alpha: f32,
    /// A pixel stops before the splat that would take its transmittance below this.
    pub transmittance: f32,
}

impl Cutoffs {
    /// Those of Kerbl et al. (2023).
    pub const EXACT: Self = Self { alpha: crate::scene::tile::ALPHA_MIN, transmittance: 1e-4 };

    /// From the constants as a kernel gets them.
    pub fn of_bits(alpha: u32, transmittance: u32) -> Self {
        Self { alpha: f32::from_bits(alpha), transmittance: f32::from_bits(transmittance) }
    }

    /// For the passes that list tiles, and for the backward pass, which stops where the forward pass stopped.
    pub fn of_lists(&self) -> [(&'static str, u32); 1] {
        [(ALPHA_MIN.name, self.alpha.to_bits())]
    }

    /// For the forward pass.
    pub fn of_forward(&self) -> [(&'static str, u32); 2] {
        let [alpha] = self.of_lists();
        [alpha, (TRANSMITTANCE_MIN.name, self.transmittance.to_bits())]
    }
}
