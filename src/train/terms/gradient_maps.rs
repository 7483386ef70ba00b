//! Gradient maps of render and photograph, and the total variation of what is between them.

use super::Compared;
use crate::dataset::Depth;
use crate::pass::{gradient_map as pass, part_sum};
use crate::scene::Camera;
use crate::train::Error;
use crate::train::settings::Texture as Weights;
use crate::vk::{self, Buffer, Gpu, Groups, Memory, Pipeline, Recorder};

/// The passes, and what is between them.
pub(in crate::train) struct GradientMaps {
    maps: Buffer,
    windows: Buffer,
    parts: Buffer,
    sums: Buffer,
    eight: [Pipeline; 2],
    sixteen: Option<[Pipeline; 2]>,
    correlate: Pipeline,
    sum: Pipeline,
    weights: [f32; 2],
}

impl GradientMaps {
    /// For views of these cameras; `deep` if some photographs have 16 bits per channel, `masked` if there are masks.
    pub(in crate::train) fn new(
        gpu: &Gpu,
        cameras: &[Camera],
        deep: bool,
        masked: bool,
        weights: &Weights,
    ) -> Result<Self, vk::Error> {
        let most = |f: fn(u32, u32) -> u32| cameras.iter().map(|c| u64::from(f(c.width, c.height))).max().unwrap_or(1);
        let buffer = |name, bytes: u64| gpu.buffer(name, bytes.max(16), Memory::Device);
        let variation = ("VARIATION", u32::from(weights.lambda_variation > 0.0));
        let pipelines = |depth: Depth| -> Result<[Pipeline; 2], vk::Error> {
            let bits = ("PHOTOGRAPH_BITS", depth.bits());
            Ok([gpu.pipeline(&pass::SOBEL.kernel, &[bits])?, gpu.pipeline(&pass::GRAD.kernel, &[variation, bits])?])
        };
        Ok(Self {
            maps: buffer("gradient_maps", 16 * most(|w, h| w * h))?,
            windows: buffer("gradient_windows", 16 * most(pass::windows))?,
            parts: buffer("gradient_parts", 16 * most(pass::parts))?,
            sums: buffer("gradient_sums", 16)?,
            eight: pipelines(Depth::Eight)?,
            sixteen: deep.then(|| pipelines(Depth::Sixteen)).transpose()?,
            correlate: gpu.pipeline(&pass::WINDOWS.kernel, &[("MASK", u32::from(masked))])?,
            sum: gpu.pipeline(&part_sum::PASS.kernel, &[])?,
            weights: [weights.lambda_gradients as f32, weights.lambda_variation as f32],
        })
    }

    /// Records the gradient, times `times`.
    pub(in crate::train) fn record(
        &self,
        recorder: &mut Recorder,
        compared: &Compared<'_>,
        times: f64,
    ) -> Result<(), Error> {
        let ((width, height), [mask_width, mask_height]) = (compared.size(), compared.mask_size());
        let [weight, tv_weight] = self.weights.map(|w| w * times as f32);
        let values = compared.photograph.values;
        let push = pass::Push { width, height, mask_width, mask_height, weight, tv_weight, values };
        let [sobel, grad] = match (compared.photograph.depth, &self.sixteen) {
            (Depth::Sixteen, Some(pipelines)) => pipelines,
            _ => &self.eight,
        };
        let [image, photograph, maps, windows, parts, sums, grad_image] = vk::slices([
            compared.image,
            compared.photograph.buffer,
            &self.maps,
            &self.windows,
            &self.parts,
            &self.sums,
            compared.grad_image,
        ]);
        let mask = compared.mask.map_or(photograph, |(mask, _)| mask);
        let pixels = Groups::Items(u64::from(width) * u64::from(height));
        recorder.dispatch(sobel, &[image, photograph, maps], &push, pixels)?;
        let count = pass::windows(width, height);
        let groups = Groups::Workgroups(u64::from(count));
        recorder.dispatch(&self.correlate, &[mask, maps, windows], &push, groups)?;
        let count = part_sum::Push { count, slot: 0 };
        recorder.dispatch(&self.sum, &[windows, sums], &count, Groups::Workgroups(1))?;
        let buffers = [image, photograph, maps, sums, grad_image, parts];
        let groups = Groups::Workgroups(u64::from(pass::groups(width, height)));
        recorder.dispatch(grad, &buffers, &push, groups)?;
        Ok(())
    }

    /// Bytes per pixel of its buffers, and other bytes.
    pub(in crate::train) fn bytes(&self) -> [u64; 2] {
        [self.maps.size() + self.windows.size() + self.parts.size(), self.sums.size()]
    }
}
