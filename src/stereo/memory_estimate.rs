//! The memory that matching takes.

use super::Settings;
use crate::pass::stereo::MOST_CHECKS;

/// Bytes per pixel on the host: luma, colour, whether the pixel is matched, its initial hypothesis, and its prior.
const HOST: u64 = 4 + 3 + 1 + 12 + PRIOR;
/// Bytes per pixel of [`super::Prior`].
const PRIOR: u64 = 4 + 12 + 4;
/// Bytes per pixel on the device: luma, hypotheses, and kept hypotheses.
const DEVICE: u64 = 4 + 16 + 16;
/// Bytes per pixel of the largest view: slots of the view and its sources, list of pixels, refined hypotheses.
const SLOTS: u64 = 16 * (MOST_CHECKS as u64 + 1) + 4 + 16;

/// Bytes that matching takes, without the photographs being decoded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MemoryEstimate {
    /// Bytes of host memory, results included.
    pub host: u64,
    /// Bytes of device memory.
    pub device: u64,
    /// Bytes of host memory that stay: depth, normals and confidence.
    pub results: u64,
}

impl MemoryEstimate {
    /// Estimate for photographs of the given sizes in pixels.
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
