//! Gradient maps of a render against those of the photograph or of another render.

use super::{Photograph, record_sum, sum_pipeline};
use crate::pass::gradient_map::{self, Push};
use crate::vk::{self, Buffer, Gpu, Groups, Memory, Pipeline, Recorder};

/// Weights of the terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GradientMapWeights {
    /// Weight of 1 - the mean correlation.
    pub correlation: f32,
    /// Weight of the residual's total variation; 0 leaves the term out.
    pub variation: f32,
}

/// The render of the loss, and what its gradient maps are compared with.
#[derive(Clone, Copy)]
pub struct MapImages<'a> {
    /// The render: a vec4 per pixel of the photograph.
    pub image: &'a Buffer,
    /// Another render of the same view, in place of the photograph.
    pub other: Option<&'a Buffer>,
}

impl<'a> From<&'a Buffer> for MapImages<'a> {
    fn from(image: &'a Buffer) -> Self {
        Self { image, other: None }
    }
}

/// The passes of the gradient map loss and the buffers between them.
pub struct GradientMapLoss {
    gpu: Gpu,
    sum: Pipeline,
    maps: Buffer,
    windows: Buffer,
    totals: Buffer,
    parts: Buffer,
    result: Buffer,
}

impl GradientMapLoss {
    /// For images of the given sizes.
    pub fn new(gpu: &Gpu, sizes: &[(u32, u32)]) -> Result<Self, vk::Error> {
        let most = |f: &dyn Fn(u32, u32) -> u32| sizes.iter().map(|(w, h)| f(*w, *h)).max().unwrap_or(1);
        let rows = |name, count: u32| gpu.buffer(name, 16 * u64::from(count.max(1)), Memory::Device);
        Ok(Self {
            gpu: gpu.clone(),
            sum: sum_pipeline(gpu)?,
            maps: rows("gradient_maps", most(&|w, h| w * h))?,
            windows: rows("gradient_windows", most(&gradient_map::windows))?,
            totals: rows("gradient_totals", 1)?,
            parts: rows("gradient_parts", most(&gradient_map::parts))?,
            result: rows("gradient_loss", 1)?,
        })
    }

    /// Records the loss of `images`, and adds dL/d(image) to `grad_image`. A window's weight is the sum of the
    /// photograph's mask over its pixels, or its number of pixels without a mask. The residual is that from the
    /// photograph, whatever maps are compared with. With exposures, a render that is compared with the photograph is
    /// the one after the photograph's exposure.
    pub fn record<'a>(
        &self,
        recorder: &mut Recorder,
        images: impl Into<MapImages<'a>>,
        photograph: &Photograph<'_>,
        weights: &GradientMapWeights,
        grad_image: &Buffer,
    ) -> Result<(), vk::Error> {
        let MapImages { image, other } = images.into();
        let (width, height) = photograph.size;
        let (mask_buffer, mask_size) = photograph.mask_to_bind();
        let push = Push {
            width,
            height,
            mask_width: mask_size.0,
            mask_height: mask_size.1,
            weight: weights.correlation,
            tv_weight: weights.variation,
            values: photograph.values,
        };
        let bits = ("PHOTOGRAPH_BITS", photograph.bits);
        let sobel = self.gpu.pipeline(&gradient_map::SOBEL.kernel, &[bits, ("OTHER", u32::from(other.is_some()))])?;
        let correlate =
            self.gpu.pipeline(&gradient_map::WINDOWS.kernel, &[("MASK", u32::from(photograph.mask.is_some()))])?;
        let variation = ("VARIATION", u32::from(weights.variation != 0.0));
        let grad = self.gpu.pipeline(&gradient_map::GRAD.kernel, &[variation, bits])?;

        let target = photograph.buffer;
        let pixels = u64::from(width) * u64::from(height);
        recorder.dispatch(
            &sobel,
            &[image, target, other.unwrap_or(image), &self.maps],
            &push,
            Groups::Items(pixels),
        )?;
        let count = gradient_map::windows(width, height);
        let buffers = [mask_buffer, &self.maps, &self.windows];
        recorder.dispatch(&correlate, &buffers, &push, Groups::Workgroups(u64::from(count)))?;
        record_sum(recorder, &self.sum, [&self.windows, &self.totals], count)?;
        let buffers = [image, target, &self.maps, &self.totals, grad_image, &self.parts];
        let groups = Groups::Workgroups(u64::from(gradient_map::groups(width, height)));
        recorder.dispatch(&grad, &buffers, &push, groups)?;
        record_sum(recorder, &self.sum, [&self.parts, &self.result], gradient_map::parts(width, height))
    }

    /// Four floats of the last recorded view: the weighted correlation term, the weighted variation term, the mean
    /// correlation, and the sum of both terms.
    pub fn result(&self) -> &Buffer {
        &self.result
    }

    /// Bytes of the loss's buffers: about 16 per pixel.
    pub fn bytes(&self) -> u64 {
        [&self.maps, &self.windows, &self.totals, &self.parts, &self.result].into_iter().map(Buffer::size).sum()
    }
}
