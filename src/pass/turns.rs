//! How many tiles of a splat the loops of `emit` and `slot_sum` take a turn: a specialization constant.
//!
//! lavapipe ends the loops of a thread after 65,535 turns in all, and a splat may cover more tiles. More a turn than that needs is work
//! for nothing: a processor stores and loads lane by lane, also for lanes that have no tile left.

use crate::vk::Constant;

/// Tiles a turn. What a kernel has where nothing is told is enough for 524,280 tiles.
pub(super) const PER_TURN: Constant = Constant { id: 23, name: "PER_TURN", default: 8 };

/// Turns that are never exceeded, with room for rows of tiles that have none listed.
const MOST: u64 = 32_767;

/// The constant for images of up to `tiles` tiles.
pub fn per_turn(tiles: u64) -> (&'static str, u32) {
    (PER_TURN.name, u32::try_from(tiles.div_ceil(MOST).max(1)).unwrap_or(u32::MAX))
}

#[cfg(test)]
mod tests {
    use super::per_turn;

    #[test]
    fn the_turns_of_a_splat_on_all_tiles_stay_below_the_limit() {
        for [width, height] in [[1u64, 1], [640, 360], [1920, 1080], [3840, 2160], [16_384, 16_384]] {
            let tiles = width.div_ceil(8) * height.div_ceil(8);
            let (_, each) = per_turn(tiles);
            assert!(tiles.div_ceil(u64::from(each)) < 32_768, "{width}x{height}");
        }
        assert_eq!(per_turn(640 / 8 * 360 / 8).1, 1);
    }
}
