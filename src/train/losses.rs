//! The image loss on the device.

use crate::pass::loss::{self, Push, SumPush};
use crate::vk::{self, Buffer, Gpu, Groups, Memory, Pipeline, Recorder};

/// L1 + SSIM between a render and a photograph, value and gradient.
pub(super) struct Losses {
    lambda: f32,
    rows: Pipeline,
    columns: Pipeline,
    grad: Pipeline,
    sum: Pipeline,
    planes: Buffer,
    ssim_parts: Buffer,
    l1_parts: Buffer,
    grad_image: Buffer,
    result: Buffer,
}

impl Losses {
    /// For images of the given sizes; `lambda` is the weight of 1 - SSIM, L1 has the rest.
    pub(super) fn new(gpu: &Gpu, sizes: &[(u32, u32)], lambda: f64) -> Result<Self, vk::Error> {
        let most = |f: &dyn Fn(u32, u32) -> u32| u64::from(sizes.iter().map(|&(w, h)| f(w, h)).max().unwrap_or(1));
        let pixels = most(&|w, h| w * h);
        Ok(Self {
            lambda: lambda as f32,
            rows: gpu.pipeline(&loss::ROWS.kernel, &[])?,
            columns: gpu.pipeline(&loss::COLUMNS.kernel, &[])?,
            grad: gpu.pipeline(&loss::GRAD.kernel, &[])?,
            sum: gpu.pipeline(&loss::SUM.kernel, &[])?,
            planes: gpu.buffer("loss_planes", 16 * pixels, Memory::Device)?,
            ssim_parts: gpu.buffer("ssim_parts", 4 * most(&|w, _| loss::ssim_parts(w)), Memory::Device)?,
            l1_parts: gpu.buffer("l1_parts", 4 * most(&loss::l1_parts), Memory::Device)?,
            grad_image: gpu.buffer("grad_image", 16 * pixels, Memory::Device)?,
            result: gpu.buffer("loss", 4 * u64::from(loss::SLOT_FLOATS), Memory::Device)?,
        })
    }

    /// Records the loss of `image` against `photograph` (RGBA8), both of the given size.
    pub(super) fn record(
        &self,
        recorder: &mut Recorder,
        image: &Buffer,
        photograph: &Buffer,
        width: u32,
        height: u32,
    ) -> Result<(), vk::Error> {
        let runs = Groups::Items(u64::from(loss::runs(width, height)));
        for channel in 0..3 {
            let push = Push { width, height, channel, lambda: self.lambda };
            recorder.dispatch(&self.rows, &[image, photograph, &self.planes], &push, runs)?;
            let columns = Groups::Items(u64::from(width));
            recorder.dispatch(&self.columns, &[&self.planes, &self.ssim_parts], &push, columns)?;
            let buffers = [image, photograph, &self.planes, &self.grad_image, &self.l1_parts];
            recorder.dispatch(&self.grad, &buffers, &push, runs)?;
        }
        let push = SumPush {
            width,
            height,
            ssim_count: loss::ssim_parts(width),
            l1_count: loss::l1_parts(width, height),
            slot: 0,
            lambda: self.lambda,
        };
        let buffers = [&self.ssim_parts, &self.l1_parts, &self.result];
        recorder.dispatch(&self.sum, &buffers, &push, Groups::Workgroups(1))
    }

    /// dL/d(image), the layout of the image; the fourth component is zero.
    pub(super) fn grad_image(&self) -> &Buffer {
        &self.grad_image
    }

    /// Total, L1 and SSIM of the last recorded view.
    pub(super) fn result(&self) -> &Buffer {
        &self.result
    }
}
