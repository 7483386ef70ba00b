//! Size of a renderer, and the limits from a device's buffer size.

use super::variants::{GradientSum, ListSort, Variants};
use crate::vk::Gpu;

/// Most splats that fit the device's largest buffer; each plane is one buffer.
pub fn most_splats(gpu: &Gpu) -> u32 {
    most(gpu, LARGEST_ROW)
}

/// Most (splat, tile) pairs that fit the device's largest buffer. With slots a pair takes 12 floats in a buffer,
/// otherwise two words, or one with sorts of all pairs.
pub fn most_pairs(gpu: &Gpu, variants: Variants) -> u32 {
    let row = match (variants.gradients, variants.lists) {
        (GradientSum::Slots, _) => LARGEST_ROW,
        (_, ListSort::Tiles) => 8,
        (_, ListSort::Global) => 4,
    };
    most(gpu, row)
}

/// Rows of `bytes` bytes in the largest buffer that a kernel can use. Word indices have 31 bits, because SPIR-V lets a
/// driver treat a 32-bit index as signed.
fn most(gpu: &Gpu, bytes: u64) -> u32 {
    let words = (gpu.caps().largest_buffer() / 4).min(i32::MAX as u64);
    (words / (bytes / 4)) as u32
}

/// Bytes of the largest row of a plane or of the gradients.
pub(crate) const LARGEST_ROW: u64 = 48;
/// Bytes of a row of the projected splats and of their gradients.
pub(super) const ROW_2D: u64 = 48;
/// Least size in bytes of the buffers with such rows, so that other users can place data there even with few splats.
pub const LEAST_2D: u64 = 16_384;

/// Capacity and features of a renderer.
#[derive(Clone, Copy, Debug)]
pub struct Size {
    /// Most splats.
    pub splats: u32,
    /// Most (splat, tile) pairs.
    pub pairs: u32,
    /// Most tiles of an image.
    pub tiles: u32,
    /// Whether the renderer has the auxiliary channels, depth and normals. They take 16 bytes more per splat; with
    /// `train`, 32 bytes more per splat, and with slots also 16 bytes per pair.
    pub aux: bool,
    /// Whether the renderer has a backward pass.
    pub train: bool,
    /// Whether splats on the image are listed in index order, for optimiser steps of only these splats. Takes a word
    /// more per splat.
    pub listed: bool,
    /// Whether the backward pass also sums absolute values of the means' gradients over pixels, in columns 10 and 11 of
    /// the gradients of the projected splats, for growth that is judged by them. Else the columns are 0.
    pub absolute: bool,
    /// Whether evaluated and blended (pixel, splat) pairs are counted (slower; for benchmarks).
    pub count: bool,
    /// Whether gradients pass through the clamp of alpha at 0.99, as in the 3DGS reference.
    pub clamp_gradient_passes: bool,
}

impl Size {
    /// Size for training on colour: only [`Size::train`], [`Size::absolute`] and [`Size::clamp_gradient_passes`] are on.
    pub const fn training(splats: u32, pairs: u32, tiles: u32) -> Self {
        let (aux, listed, count) = (false, false, false);
        Self { splats, pairs, tiles, aux, train: true, listed, absolute: true, count, clamp_gradient_passes: true }
    }
}
