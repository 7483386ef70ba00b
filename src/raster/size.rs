//! How large a renderer is, and the most that a device's buffers hold.

use super::variants::{GradientSum, Variants};
use crate::vk::Gpu;

/// Most splats that fit the buffers of the device, each plane being used whole.
pub fn most_splats(gpu: &Gpu) -> u32 {
    most(gpu, LARGEST_ROW)
}

/// Most pairs that fit the buffers of the device: slots are rows of 12 floats per pair,
/// all else is no more than a word.
pub fn most_pairs(gpu: &Gpu, variants: Variants) -> u32 {
    let row = if variants.gradients == GradientSum::Slots { LARGEST_ROW } else { 4 };
    most(gpu, row)
}

/// Rows of `bytes` bytes in the largest buffer that a kernel can use. Words are indexed with 32 bits, of which SPIR-V
/// lets a driver take the highest as a sign.
fn most(gpu: &Gpu, bytes: u64) -> u32 {
    let words = (gpu.caps().largest_buffer() / 4).min(i32::MAX as u64);
    (words / (bytes / 4)) as u32
}

/// Bytes of the largest row of a plane or of the gradients.
pub(crate) const LARGEST_ROW: u64 = 48;
/// Bytes of a row of the projected splats and of their gradients.
pub(super) const ROW_2D: u64 = 48;
/// Least bytes of those buffers, so that others can lay out parts in them when there are few splats.
pub const LEAST_2D: u64 = 16_384;

/// How large a renderer is.
#[derive(Clone, Copy, Debug)]
pub struct Size {
    /// Splats that fit.
    pub splats: u32,
    /// (splat, tile) pairs that fit.
    pub pairs: u32,
    /// Tiles of the largest image.
    pub tiles: u32,
    /// Whether depth and normals can be rendered and, with a backward, have gradients. That takes 16 bytes more per
    /// splat, with the backward 32, and with sums in slots 16 per pair.
    pub aux: bool,
    /// Whether there is a backward.
    pub train: bool,
    /// Whether the splats on the image are listed in the order of their index, for optimiser steps of them alone:
    /// a word more per splat.
    pub listed: bool,
    /// Whether evaluated and blended pixel-splats are counted (slower; for benchmarks).
    pub count: bool,
    /// Whether gradients pass through the clamp of alpha at 0.99, as in the 3DGS reference.
    pub clamp_gradient_passes: bool,
}

impl Size {
    /// Room to train colours, with nothing beside: [`Size::train`] and [`Size::clamp_gradient_passes`] alone are on.
    pub const fn training(splats: u32, pairs: u32, tiles: u32) -> Self {
        Self { splats, pairs, tiles, aux: false, train: true, listed: false, count: false, clamp_gradient_passes: true }
    }
}
