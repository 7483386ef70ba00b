//! Extrapolation of a view's depths.

use glam::{DMat3, DVec3};

use super::prior::normal;
use super::{Prior, StereoView};

/// Side in pixels of the blocks over which known depths are averaged before the extrapolation.
const BLOCK: usize = 8;
/// Smallest number of known pixels for an extrapolation.
const LEAST_KNOWN: usize = 64;
/// Inverse depths are clamped to the known range, widened by this factor at both ends.
const BEYOND: f64 = 2.0;

/// The known pixels of a block.
struct Block {
    /// Mean position of the known pixels.
    place: [f64; 2],
    /// Mean difference of the inverse depths from the plane, and mean squared difference.
    differs: [f64; 2],
    known: f64,
}

/// Inverse depths over the whole image plane of a view, extrapolated from the known pixels. The inverse depth of a
/// plane in space is linear in pixel coordinates. The extrapolation is therefore a plane fitted to all known pixels
/// plus a mean of their differences from the plane, weighted by nearness.
pub(super) struct ExtrapolatedDepths<'a> {
    view: &'a StereoView,
    /// Inverse depth at (u, v) is the dot product with (u, v, 1).
    plane: DVec3,
    blocks: Vec<Block>,
    /// Smallest and largest inverse depth.
    range: [f64; 2],
}

impl<'a> ExtrapolatedDepths<'a> {
    /// `None` where too few pixels are known, or the prior's size is not the view's.
    pub(super) fn new(view: &'a StereoView, prior: &Prior) -> Option<Self> {
        let size = (view.camera.width, view.camera.height);
        if (prior.width, prior.height) != size || prior.depth.len() != view.pixels() {
            return None;
        }
        let place = |pixel: usize| {
            let (u, v) = middle(prior.width, pixel);
            DVec3::new(u, v, 1.0)
        };
        let known: Vec<(DVec3, f64)> = (0..prior.depth.len())
            .filter(|&pixel| prior.depth[pixel] > 0.0)
            .map(|pixel| (place(pixel), 1.0 / f64::from(prior.depth[pixel])))
            .collect();
        if known.len() < LEAST_KNOWN {
            return None;
        }
        let (mut products, mut with) = (DMat3::ZERO, DVec3::ZERO);
        for (x, q) in &known {
            products += DMat3::from_cols(*x * x.x, *x * x.y, *x * x.z);
            with += *x * *q;
        }
        let plane = products.inverse() * with;
        if !plane.is_finite() {
            return None;
        }
        let across = (prior.width as usize).div_ceil(BLOCK);
        let mut sums = vec![[0.0; 5]; across * (prior.height as usize).div_ceil(BLOCK)];
        for (x, q) in &known {
            let differs = q - plane.dot(*x);
            let sum = &mut sums[(x.y as usize / BLOCK) * across + x.x as usize / BLOCK];
            for (sum, value) in sum.iter_mut().zip([x.x, x.y, differs, differs * differs, 1.0]) {
                *sum += value;
            }
        }
        let block = |[x, y, differs, squares, known]: &[f64; 5]| Block {
            place: [x / known, y / known],
            differs: [differs / known, squares / known],
            known: *known,
        };
        let blocks = sums.iter().filter(|sum| sum[4] > 0.0).map(block).collect();
        let least = known.iter().map(|k| k.1).fold(f64::INFINITY, f64::min);
        let most = known.iter().map(|k| k.1).fold(0.0, f64::max);
        Some(Self { view, plane, blocks, range: [least / BEYOND, most * BEYOND] })
    }

    /// Inverse depth at a position inside or outside the photograph, and the standard deviation about the plane of the
    /// depths used, as a share of the inverse depth.
    pub(super) fn inverse_depth(&self, u: f64, v: f64) -> (f64, f64) {
        let squared = |b: &Block| (b.place[0] - u).powi(2) + (b.place[1] - v).powi(2);
        let nearest = self.blocks.iter().map(squared).fold(f64::INFINITY, f64::min);
        // The weights are as wide as the nearest block is far: a distant position averages over more blocks.
        let reach = nearest.max((BLOCK * BLOCK) as f64);
        let (mut sum, mut squares, mut weights) = (0.0, 0.0, 0.0);
        for block in &self.blocks {
            let weight = block.known * (0.5 * (nearest - squared(block)) / reach).exp();
            sum += weight * block.differs[0];
            squares += weight * block.differs[1];
            weights += weight;
        }
        let (mean, square) = (sum / weights, squares / weights);
        let q = (self.plane.dot(DVec3::new(u, v, 1.0)) + mean).clamp(self.range[0], self.range[1]);
        (q, (square - mean * mean).max(0.0).sqrt() / q)
    }

    /// The unit normal at the position in the camera frame, towards the camera.
    pub(super) fn normal(&self, u: f64, v: f64, inverse_depth: f64) -> [f32; 3] {
        let hypothesis = [inverse_depth, self.plane.x, self.plane.y].map(|h| h as f32);
        normal(&self.view.camera, [u, v], hypothesis)
    }
}

/// The centre of a pixel.
pub(super) fn middle(width: u32, pixel: usize) -> (f64, f64) {
    let width = width as usize;
    ((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5)
}
