//! How spherical harmonics are stored on the device.

use serde::{Deserialize, Serialize};

/// How the numbers of spherical harmonics are stored on the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ShStorage {
    /// In 32 bits.
    #[default]
    Full,
    /// In half floats, which take half the memory: for pictures, training needs all bits.
    Half,
}

impl ShStorage {
    /// Bits of a number.
    pub fn bits(self) -> u32 {
        match self {
            Self::Full => 32,
            Self::Half => 16,
        }
    }
}
