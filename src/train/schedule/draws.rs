//! Random numbers that depend on what they are for and not on when they are asked for.

/// What a random number is for: streams of one seed are independent.
#[derive(Clone, Copy)]
pub(in crate::train) enum Stream {
    Views = 1,
    Background = 2,
    /// Places in a photograph.
    Places = 3,
}

/// A random number for (stream, major, minor), the same in whatever order numbers are asked for: the 64-bit finaliser of
/// SplitMix (Steele, Lea, Flood 2014) over each part in turn.
pub(in crate::train) fn draw(seed: u64, stream: Stream, major: u64, minor: u64) -> u64 {
    [stream as u64, major, minor].into_iter().fold(finalise(seed), |state, part| finalise(state ^ finalise(part)))
}

fn finalise(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// Maps 64 random bits to 0..n; the bias is below n / 2^64.
pub(super) fn bounded(bits: u64, n: usize) -> usize {
    ((u128::from(bits) * n as u128) >> 64) as usize
}
