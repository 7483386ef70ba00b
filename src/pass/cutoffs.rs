//! What blending leaves out and how it takes the exponential: specialization constants of the passes that list tiles and blend.

use crate::vk::Constant;

/// A splat is skipped where its alpha is below this (a float).
pub(super) const ALPHA_MIN: Constant = Constant { id: 20, name: "ALPHA_MIN", default: Cutoffs::EXACT.alpha.to_bits() };
/// A pixel stops before the splat that would take its transmittance below this (a float).
pub(super) const TRANSMITTANCE_MIN: Constant =
    Constant { id: 21, name: "TRANSMITTANCE_MIN", default: Cutoffs::EXACT.transmittance.to_bits() };
/// Powers of two by a polynomial of degree 3, within 2.1e-4 of themselves (0 or 1).
pub(super) const CUBIC_EXPONENTIAL: Constant = Constant { id: 22, name: "CUBIC_EXPONENTIAL", default: 0 };

/// The constants together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cutoffs {
    /// A splat is skipped where its alpha is below this.
    pub alpha: f32,
    /// A pixel stops before the splat that would take its transmittance below this.
    pub transmittance: f32,
    /// Whether powers of two are those of the polynomial.
    pub cubic_exponential: bool,
}

impl Cutoffs {
    /// Those of Kerbl et al. (2023), with the device's exponential.
    pub const EXACT: Self =
        Self { alpha: crate::scene::tile::ALPHA_MIN, transmittance: 1e-4, cubic_exponential: false };

    /// From the constants as a kernel gets them.
    pub fn of_bits(alpha: u32, transmittance: u32, cubic: u32) -> Self {
        Self {
            alpha: f32::from_bits(alpha),
            transmittance: f32::from_bits(transmittance),
            cubic_exponential: cubic != 0,
        }
    }

    /// For the passes that list tiles.
    pub fn of_lists(&self) -> [(&'static str, u32); 1] {
        [(ALPHA_MIN.name, self.alpha.to_bits())]
    }

    /// For the forward pass.
    pub fn of_forward(&self) -> [(&'static str, u32); 3] {
        let [alpha, cubic] = self.of_backward();
        [alpha, (TRANSMITTANCE_MIN.name, self.transmittance.to_bits()), cubic]
    }

    /// For the backward pass, which stops where the forward pass stopped.
    pub fn of_backward(&self) -> [(&'static str, u32); 2] {
        [(ALPHA_MIN.name, self.alpha.to_bits()), (CUBIC_EXPONENTIAL.name, u32::from(self.cubic_exponential))]
    }
}
