//! Indices into the `counters` buffer, as in `glsl/include/counters.glsl`.

/// [`PAIRS_BIT`] and [`SPLATS_BIT`], sticky until the host clears them.
pub const STATUS: usize = 0;
/// Splats in the model.
pub const SPLATS: usize = 1;
/// Visible splats in this event.
pub const VISIBLE: usize = 2;
/// (splat, tile) pairs of this event, including pairs beyond the capacity.
pub const PAIRS: usize = 3;
/// Number of the last finished event.
pub const DONE: usize = 4;
/// Largest pair count seen.
pub const WANT_PAIRS: usize = 5;
/// Largest splat count that density control has requested.
pub const WANT_SPLATS: usize = 6;
/// Number of encountered splats with a non-finite value since the start.
pub const BAD_SPLATS: usize = 7;
/// Splats cloned by the last density change.
pub const CLONED: usize = 8;
/// Splats split by the last density change.
pub const SPLIT: usize = 9;
/// Splats pruned by the last density change.
pub const PRUNED: usize = 10;
/// Identity of the next new splat.
pub const NEXT_ID: usize = 11;
/// Total of the last prefix sum.
pub const SCAN_TOTAL: usize = 12;
/// Splats with an identity below this value are the constrained set: the splats that existed at the end of the
/// low-frequency stage.
pub const CONSTRAINED: usize = 13;
/// Number of splats, in the last rows, without sh coefficients above degree 1. The planes above degree 1 end before
/// these rows.
pub const PLAIN: usize = 14;
/// Optimiser step, modulo 2^16, at which every splat was last caught up. Missed steps count from here.
pub const CAUGHT_UP: usize = 15;
/// Words in the buffer.
pub const COUNT: usize = 16;

/// Status bit: more pairs than the pair buffers hold.
pub const PAIRS_BIT: u32 = 1;
/// Status bit: more splats than the planes hold.
pub const SPLATS_BIT: u32 = 2;

/// Number of splats with sh coefficients above degree 1; later rows have coefficients only up to degree 1.
pub fn full_rows(counters: &[u32]) -> usize {
    counters[SPLATS].saturating_sub(counters[PLAIN]) as usize
}
