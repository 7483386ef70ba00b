//! Indices into the `counters` buffer, as in `glsl/include/counters.glsl`.

/// [`PAIRS_BIT`] and [`SPLATS_BIT`], sticky until the host clears them.
pub const STATUS: usize = 0;
/// Splats in the model.
pub const SPLATS: usize = 1;
/// Splats on screen in this event.
pub const VISIBLE: usize = 2;
/// (splat, tile) pairs of this event, counted past the capacity.
pub const PAIRS: usize = 3;
/// Number of the last finished event.
pub const DONE: usize = 4;
/// Largest pair count seen.
pub const WANT_PAIRS: usize = 5;
/// Largest splat count asked for by density control.
pub const WANT_SPLATS: usize = 6;
/// Splats with a non-finite value met since the start.
pub const BAD_SPLATS: usize = 7;
/// Splats cloned by the last density change.
pub const CLONED: usize = 8;
/// Splats split by the last density change.
pub const SPLIT: usize = 9;
/// Splats pruned by the last density change.
pub const PRUNED: usize = 10;
/// Identity of the next splat to be born.
pub const NEXT_ID: usize = 11;
/// Total of the last prefix sum.
pub const SCAN_TOTAL: usize = 12;
/// Splats with an identity below this are the constrained set: those that were there at the end of the low-frequency
/// stage.
pub const CONSTRAINED: usize = 13;
/// Splats in the last rows, whose harmonics end at degree 1: the planes of the others end before them.
pub const PLAIN: usize = 14;
/// Step of the optimiser, modulo 2^16, with which every splat was caught up: what it has missed counts from there on.
pub const CAUGHT_UP: usize = 15;
/// Words in the buffer.
pub const COUNT: usize = 16;

/// Status bit: more pairs than the pair buffers hold.
pub const PAIRS_BIT: u32 = 1;
/// Status bit: more splats than the planes hold.
pub const SPLATS_BIT: u32 = 2;

/// Rows from this one on have harmonics up to degree 1 alone.
pub fn full_rows(counters: &[u32]) -> usize {
    counters[SPLATS].saturating_sub(counters[PLAIN]) as usize
}
