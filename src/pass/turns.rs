//! Tiles per turn in the loops over a splat's tiles in `emit` and `slot_sum`: a specialization constant.
//!
//! lavapipe ends the loops of a thread after 65,535 turns in total, and a splat may cover more tiles. More tiles per
//! turn than necessary are slow: a CPU device loads and stores lane by lane, even for lanes without a tile.

use crate::vk::Constant;

/// Tiles per turn. The default suffices for 520,000 tiles.
pub(super) const PER_TURN: Constant = Constant { id: 23, name: "PER_TURN", default: 8 };

/// Most tiles for one tile per turn, with a reserve for rows of tiles without listed tiles.
const FEW: u64 = 32_767;
/// Upper bound on turns.
const MOST: u64 = 65_000;

/// The constant for images of up to `tiles` tiles.
pub fn per_turn(tiles: u64) -> (&'static str, u32) {
    let needed = u32::try_from(tiles.div_ceil(MOST)).unwrap_or(u32::MAX);
    (PER_TURN.name, if tiles <= FEW { 1 } else { needed.max(PER_TURN.default) })
}

#[cfg(test)]
mod tests {
    use super::per_turn;

    #[test]
    fn the_turns_of_a_splat_on_all_tiles_stay_below_the_limit() {
        for [width, height] in [[1u64, 1], [640, 360], [1920, 1080], [3840, 2160], [16_384, 16_384]] {
            let tiles = width.div_ceil(8) * height.div_ceil(8);
            let (_, each) = per_turn(tiles);
            assert!(tiles.div_ceil(u64::from(each)) <= 65_000, "{width}x{height}");
        }
        assert_eq!([640 * 360, 3840 * 2160].map(|pixels| per_turn(pixels / 64).1), [1, 8]);
    }
}
