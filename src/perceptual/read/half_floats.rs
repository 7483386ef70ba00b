//! The number formats of stored weights.

use half::{bf16, f16};

/// A floating-point format, little-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FloatFormat {
    Half,
    Brain,
    Single,
    Double,
}

impl FloatFormat {
    /// Bytes of a number.
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::Half | Self::Brain => 2,
            Self::Single => 4,
            Self::Double => 8,
        }
    }

    /// The numbers that `bytes` hold.
    pub(super) fn numbers(self, bytes: &[u8]) -> Vec<f32> {
        let [chunks2, chunks4, chunks8] = [2, 4, 8].map(|n| bytes.chunks_exact(n));
        match self {
            Self::Half => chunks2.map(|b| f16::from_le_bytes([b[0], b[1]]).to_f32()).collect(),
            Self::Brain => chunks2.map(|b| bf16::from_le_bytes([b[0], b[1]]).to_f32()).collect(),
            Self::Single => chunks4.map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect(),
            Self::Double => {
                chunks8.map(|b| f64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]) as f32).collect()
            }
        }
    }
}
