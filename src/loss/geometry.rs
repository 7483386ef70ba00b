//! Depth and normals of a render against those of a prior.

use super::{Photograph, record_sum, sum_pipeline};
use crate::pass::geometry::{self, Push};
use crate::raster::Target;
use crate::vk::{self, Buffer, Gpu, Groups, Memory, Pipeline, Recorder};

/// A view's known depths and normals, on the device.
#[derive(Clone, Copy)]
pub struct Prior<'a> {
    /// Two words per pixel: see [`geometry::pack_prior`].
    pub buffer: &'a Buffer,
    /// The prior's own width and height in pixels, at least 1 each. The prior covers the photograph's whole view.
    pub size: (u32, u32),
    /// Median depth of the view in scene units.
    pub median: f32,
}

/// A render with the photograph and the prior to compare it with.
#[derive(Clone, Copy)]
pub struct Rendered<'a> {
    /// The render with its auxiliary channels, at the photograph's size.
    pub target: &'a Target,
    /// The photograph.
    pub photograph: &'a Photograph<'a>,
    /// The view's known depths and normals.
    pub prior: &'a Prior<'a>,
}

/// A prior in host memory, packed for upload.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedPrior {
    /// The content of [`Prior::buffer`].
    pub words: Vec<u32>,
    /// Width and height in pixels.
    pub size: (u32, u32),
    /// Median of the known depths, in the units of [`Self::new`]'s depths.
    pub median: f32,
}

impl PackedPrior {
    /// Packs depths in scene units (0: none), unit normals in the camera frame (zeros: none) and confidences from 0 to
    /// 1, row after row. `None` where no depth is known, or where depths, normals or confidences are not one per pixel.
    pub fn new(size: (u32, u32), depth: &[f32], normals: &[[f32; 3]], confidence: &[f32]) -> Option<Self> {
        let pixels = size.0 as usize * size.1 as usize;
        if [depth.len(), normals.len(), confidence.len()] != [pixels; 3] {
            return None;
        }
        let rows = || depth.iter().zip(normals).zip(confidence);
        let words = rows().flat_map(|((d, n), c)| geometry::pack_prior(*d, Some(*n), *c)).collect();
        let counts = |d: f32, c: f32| d.is_finite() && d > 0.0 && c > 0.0;
        let mut known: Vec<f32> = rows().filter(|((d, _), c)| counts(**d, **c)).map(|((d, _), _)| *d).collect();
        let middle = known.len() / 2;
        let median =
            if known.is_empty() { return None } else { *known.select_nth_unstable_by(middle, f32::total_cmp).1 };
        Some(Self { words, size, median })
    }
}

/// How edges of the photograph change the weight of depths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Edges {
    /// More weight at edges: 1 + beta |grad I| / (|grad I| + mean |grad I|).
    More(f32),
    /// Less weight at edges: exp(-gamma |grad I|), I from 0 to 1.
    Less(f32),
}

/// Weights and shapes of the terms. A term of weight 0 is left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeometryWeights {
    /// Weight of the depths' relative residuals.
    pub depth: f32,
    /// Relative residual at which the depths' Huber function turns linear.
    pub huber: f32,
    /// How edges change the weight of depths.
    pub edges: Edges,
    /// Weight of squared second differences of depth over the view's median depth.
    pub smooth: f32,
    /// Factor k of the smoothness term's weight exp(-k |grad I|), I from 0 to 1.
    pub edge_stop: f32,
    /// Weight of 1 - cosine between the normals.
    pub cosine: f32,
    /// Weight of the normals' L1 distance.
    pub l1: f32,
}

impl Default for GeometryWeights {
    fn default() -> Self {
        Self { depth: 0.1, huber: 0.015, edges: Edges::More(1.0), smooth: 1e-3, edge_stop: 4.0, cosine: 5e-3, l1: 5e-3 }
    }
}

/// The passes of the geometry loss and the buffers between them.
pub struct GeometryLoss {
    gpu: Gpu,
    sum: Pipeline,
    depth_map: Buffer,
    parts: Buffer,
    totals: Buffer,
    grad_aux: Buffer,
    result: Buffer,
}

impl GeometryLoss {
    /// For renders of up to `pixels` pixels.
    pub fn new(gpu: &Gpu, pixels: u32) -> Result<Self, vk::Error> {
        let rows = |name, count: u32| gpu.buffer(name, 16 * u64::from(count.max(1)), Memory::Device);
        Ok(Self {
            gpu: gpu.clone(),
            sum: sum_pipeline(gpu)?,
            depth_map: rows("depth_map", pixels)?,
            parts: rows("geometry_parts", geometry::parts(pixels, 1))?,
            totals: rows("geometry_totals", 1)?,
            grad_aux: rows("grad_aux", pixels)?,
            result: rows("geometry_loss", 1)?,
        })
    }

    /// Records the loss of a render. Adds the gradient of the transmittance (dL/dT) to `grad_image` and writes
    /// [`Self::grad_aux`]. Pixels where the photograph's mask is 1 do not count.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        rendered: Rendered<'_>,
        weights: &GeometryWeights,
        grad_image: &Buffer,
    ) -> Result<(), vk::Error> {
        let Rendered { target, photograph, prior } = rendered;
        let (width, height) = photograph.size;
        let (mask_buffer, mask_size) = photograph.mask_to_bind();
        let (edges, edge) = match weights.edges {
            Edges::More(beta) => (0, beta),
            Edges::Less(gamma) => (1, gamma),
        };
        let push = Push {
            width,
            height,
            prior_width: prior.size.0,
            prior_height: prior.size.1,
            mask_width: mask_size.0,
            mask_height: mask_size.1,
            pixels: photograph.values / 3.0,
            median: prior.median,
            depth_weight: weights.depth,
            huber: weights.huber,
            edge,
            smooth_weight: weights.smooth,
            edge_stop: weights.edge_stop,
            cosine_weight: weights.cosine,
            l1_weight: weights.l1,
        };
        let given = [("MASK", u32::from(photograph.mask.is_some())), ("PHOTOGRAPH_BITS", photograph.bits)];
        let depth = self.gpu.pipeline(&geometry::DEPTH.kernel, &given)?;
        let grad = self.gpu.pipeline(&geometry::GRAD.kernel, &[("EDGES", edges)])?;
        let groups = Groups::Workgroups(u64::from(geometry::groups(width, height)));
        let count = geometry::parts(width, height);
        let (image, aux) = (&target.image, &target.aux);
        let buffers = [image, aux, photograph.buffer, prior.buffer, mask_buffer, &self.depth_map, &self.parts];
        recorder.dispatch(&depth, &buffers, &push, groups)?;
        record_sum(recorder, &self.sum, [&self.parts, &self.totals], count)?;
        let buffers =
            [image, aux, prior.buffer, &self.depth_map, &self.totals, grad_image, &self.grad_aux, &self.parts];
        recorder.dispatch(&grad, &buffers, &push, groups)?;
        record_sum(recorder, &self.sum, [&self.parts, &self.result], count)
    }

    /// dL/d(auxiliary image), for [`crate::raster::ImageGradients::of_aux`].
    pub fn grad_aux(&self) -> &Buffer {
        &self.grad_aux
    }

    /// Four floats of the last recorded view: the weighted depth, smoothness and normal terms, and their sum.
    pub fn result(&self) -> &Buffer {
        &self.result
    }

    /// Bytes of the loss's buffers: about 32 per pixel.
    pub fn bytes(&self) -> u64 {
        [&self.depth_map, &self.parts, &self.totals, &self.grad_aux, &self.result].into_iter().map(Buffer::size).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::PackedPrior;

    #[test]
    fn priors_are_packed_with_the_median_of_what_counts() {
        let depth = [4.0, 0.0, 2.0, f32::NAN, 9.0, 100.0];
        let normals = [[0.0, 0.0, -1.0]; 6];
        let confidence = [0.5, 1.0, 1.0, 1.0, 0.2, 0.0];
        let prior = PackedPrior::new((3, 2), &depth, &normals, &confidence).unwrap();
        assert_eq!((prior.median, prior.words.len()), (4.0, 12));
        assert_eq!(f32::from_bits(prior.words[4]), 2.0);
        assert_eq!(PackedPrior::new((3, 2), &depth[1..], &normals, &confidence), None);
        assert_eq!(PackedPrior::new((3, 2), &[0.0; 6], &normals, &confidence), None);
    }
}
