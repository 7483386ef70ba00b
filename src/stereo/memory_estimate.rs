//! What matching takes of memory.

use super::Settings;
use crate::pass::stereo::MOST_CHECKS;

/// Bytes of a pixel on the host: luma, colour, whether it is matched, what it begins with, and what is found of it.
const HOST: u64 = 4 + 3 + 1 + 12 + PRIOR;
/// Bytes of a pixel of [`super::Prior`].
const PRIOR: u64 = 4 + 12 + 4;
/// Bytes of a pixel on the device: luma, hypotheses, and what of them was kept.
const DEVICE: u64 = 4 + 16 + 16;
/// Of a pixel of the largest view: it and its sources as rows, its place in the list, its refined hypothesis.
const SLOTS: u64 = 16 * (MOST_CHECKS as u64 + 1) + 4 + 16;

/// Bytes that matching takes, photographs that are being decoded apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MemoryEstimate {
    /// Of the host's memory, results included.
    pub host: u64,
    /// Of the device's memory.
    pub device: u64,
    /// What stays of the host's: depth, normals and confidence.
    pub results: u64,
}

impl MemoryEstimate {
    /// For photographs of these sizes.
    pub fn of(settings: &Settings, sizes: impl Iterator<Item = (u32, u32)>) -> Self {
        let (mut all, mut largest) = (0, 0);
        for (width, height) in sizes {
            let (width, height) = settings.size(width, height);
            let pixels = u64::from(width) * u64::from(height);
            all += pixels;
            largest = largest.max(pixels);
        }
        Self { host: HOST * all, device: DEVICE * all + SLOTS * largest, results: PRIOR * all }
    }
}
