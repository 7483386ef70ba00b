//! Random numbers that depend on their purpose and not on the order of the calls.

use crate::scene::random::hash;

/// Purpose of a random number: streams of one seed are independent.
#[derive(Clone, Copy)]
pub(in crate::train) enum Stream {
    Views = 1,
    Background = 2,
    /// Positions in a photograph.
    Places = 3,
}

/// The random number of (stream, major, minor): the 64-bit finaliser of SplitMix (Steele, Lea, Flood 2014) over each
/// part in turn.
pub(in crate::train) fn draw(seed: u64, stream: Stream, major: u64, minor: u64) -> u64 {
    [stream as u64, major, minor].into_iter().fold(hash(seed), |state, part| hash(state ^ hash(part)))
}

/// Maps 64 random bits to 0..n; the bias is below n / 2^64.
pub(super) fn bounded(bits: u64, n: usize) -> usize {
    ((u128::from(bits) * n as u128) >> 64) as usize
}
