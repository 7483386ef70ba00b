//! The alpha cutoff: a splat is skipped at a pixel where its alpha is lower. A specialization constant of the passes
//! that project, list tiles and blend.

use crate::scene::tile;
use crate::vk::Constant;

/// The constant, as the bits of a float.
pub(super) const ALPHA_MIN: Constant = Constant { id: 20, name: "ALPHA_MIN", default: tile::ALPHA_MIN.to_bits() };

/// The alpha cutoff 1 / `cutoff`; for `None` 1/255 (Kerbl et al. 2023).
pub fn alpha_min(cutoff: Option<u32>) -> f32 {
    cutoff.map_or(tile::ALPHA_MIN, |n| (1.0 / f64::from(n.max(1))) as f32)
}

/// The specialization constant for `cutoff`.
pub fn constant(cutoff: Option<u32>) -> (&'static str, u32) {
    (ALPHA_MIN.name, alpha_min(cutoff).to_bits())
}

#[cfg(test)]
mod tests {
    use super::alpha_min;

    #[test]
    fn a_cutoff_of_255_is_the_default() {
        assert_eq!(alpha_min(None), alpha_min(Some(255)));
    }
}
