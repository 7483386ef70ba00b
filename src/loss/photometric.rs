//! L1 and SSIM between the render as the photograph would show it and the photograph.

use super::Photograph;
use crate::dataset::Depth;
use crate::pass::loss::{self, LossLayout, Push, SumPush};
use crate::vk::{self, Buffer, Caps, DeviceKind, Gpu, Groups, Memory, Pipeline, Recorder, Subgroup};

/// L1 + SSIM between a render and a photograph, value and gradient.
pub struct PhotometricLoss {
    lambda: f32,
    /// Layout of the largest image. Strips of other images have the same numbers of rows and channels.
    layout: LossLayout,
    /// For photographs with 8 bits per channel.
    eight: Passes,
    /// For photographs with 16 bits per channel, where there are any.
    sixteen: Option<Passes>,
    sum: Pipeline,
    planes: [Buffer; 3],
    ssim_parts: Buffer,
    l1_parts: Buffer,
    grad_image: Buffer,
    result: Buffer,
}

/// Weights of pixels in the gradient.
#[derive(Clone, Copy)]
pub struct PixelWeights<'a> {
    /// A value per pixel, from 0 to 1.
    pub saliency: &'a Buffer,
    /// Weights at saliency 0 and at saliency 1.
    pub of: [f32; 2],
}

/// The passes for one bit depth of photographs.
struct Passes {
    /// Without pixel weights, and with pixel weights where training has any.
    strips: [Option<Pipeline>; 2],
    grad: [Option<Pipeline>; 2],
}

impl PhotometricLoss {
    /// For images of the given sizes. `deep`: some photographs have 16 bits per channel. `weighted`: pixels may have
    /// weights. `lambda`: the weight of 1 - SSIM; L1 has the weight 1 - `lambda`.
    pub fn new(gpu: &Gpu, sizes: &[(u32, u32)], deep: bool, weighted: bool, lambda: f64) -> Result<Self, vk::Error> {
        let (constant, lanes) = match gpu.caps().subgroup {
            Subgroup::Hardware(width) if width >= loss::LEAST_LANES => ("LOCAL_SIZE", width),
            _ => ("EMULATED_WIDTH", loss::EMULATED_LANES),
        };
        let (width, height) = sizes.iter().copied().max_by_key(|&(w, h)| u64::from(w) * u64::from(h)).unwrap_or((1, 1));
        let mut layout = LossLayout::new(width, height, lanes);
        let (strips, grad) = if constant == "EMULATED_WIDTH" {
            layout.apart = 3;
            (&loss::STRIPS_EMULATED, &loss::GRAD_EMULATED)
        } else if layout.apart == 3 {
            (&loss::STRIPS_APART, &loss::GRAD_APART)
        } else {
            (&loss::STRIPS_SUBGROUP, &loss::GRAD_SUBGROUP)
        };
        let passes = |depth: Depth| -> Result<Passes, vk::Error> {
            let (lanes, bits) = ((constant, lanes), ("PHOTOGRAPH_BITS", depth.bits()));
            let segment = ("SEGMENT", layout.segment);
            let one = |weights: u32| -> Result<[Option<Pipeline>; 2], vk::Error> {
                let weights = ("WEIGHTED", weights);
                let strips = gpu.pipeline(&strips.kernel, &[lanes, segment, bits, weights])?;
                let mut of_grad = vec![lanes, bits, weights];
                of_grad.extend((layout.apart > 1).then_some(segment));
                Ok([Some(strips), Some(gpu.pipeline(&grad.kernel, &of_grad)?)])
            };
            let [plain_strips, plain_grad] = one(0)?;
            let [strips, grad] = if weighted { one(1)? } else { [None, None] };
            Ok(Passes { strips: [plain_strips, strips], grad: [plain_grad, grad] })
        };
        let most = |f: &dyn Fn(LossLayout) -> u64| {
            let layouts = sizes.iter().map(|&(width, height)| LossLayout { width, height, ..layout });
            layouts.map(f).max().unwrap_or(1)
        };
        let pixels = most(&|l| u64::from(l.width) * u64::from(l.height));
        let plane = |name| gpu.buffer(name, 4 * most(&|l| l.plane_floats()), Memory::Device);
        Ok(Self {
            lambda: lambda as f32,
            layout,
            eight: passes(Depth::Eight)?,
            sixteen: if deep { Some(passes(Depth::Sixteen)?) } else { None },
            sum: gpu.pipeline(&loss::SUM.kernel, &[("LOCAL_SIZE", sum_threads(gpu.caps()))])?,
            planes: [plane("red_planes")?, plane("green_planes")?, plane("blue_planes")?],
            ssim_parts: gpu.buffer("ssim_parts", 4 * most(&|l| u64::from(l.ssim_parts())), Memory::Device)?,
            l1_parts: gpu.buffer("l1_parts", 4 * most(&|l| u64::from(l.l1_parts())), Memory::Device)?,
            grad_image: gpu.buffer("grad_image", 16 * pixels, Memory::Device)?,
            result: gpu.buffer("loss", 4 * u64::from(loss::SLOT_FLOATS), Memory::Device)?,
        })
    }

    /// Records the loss of `image` against `photograph`. For a part of a photograph, the gradient is the part's share
    /// of the whole photograph's gradient, and the value is the loss of the part alone.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        image: &Buffer,
        photograph: &Photograph<'_>,
        weights: Option<PixelWeights<'_>>,
    ) -> Result<(), vk::Error> {
        let (width, height) = photograph.size;
        let layout = LossLayout { width, height, ..self.layout };
        let passes = self.sixteen.as_ref().filter(|_| photograph.bits == 16).unwrap_or(&self.eight);
        let form = usize::from(weights.is_some());
        let (Some(strips), Some(grad)) = (&passes.strips[form], &passes.grad[form]) else { return Ok(()) };
        let (saliency, [low_weight, high_weight]) =
            weights.map_or((&self.result, [1.0; 2]), |weights| (weights.saliency, weights.of));
        let push = Push { width, height, lambda: self.lambda, values: photograph.values, low_weight, high_weight };
        let [red, green, blue] = &self.planes;
        let buffers = [image, photograph.buffer, red, green, blue, &self.ssim_parts, saliency];
        recorder.dispatch(strips, &buffers, &push, Groups::Items(layout.strip_threads()))?;
        let buffers = [image, photograph.buffer, red, green, blue, &self.grad_image, &self.l1_parts, saliency];
        recorder.dispatch(grad, &buffers, &push, Groups::Items(layout.grad_threads()))?;
        let push = SumPush {
            values: photograph.part_values,
            ssim_count: layout.ssim_parts(),
            l1_count: layout.l1_parts(),
            slot: 0,
            lambda: self.lambda,
        };
        let buffers = [&self.ssim_parts, &self.l1_parts, &self.result];
        recorder.dispatch(&self.sum, &buffers, &push, Groups::Workgroups(1))
    }

    /// Bytes of the loss's buffers.
    pub fn bytes(&self) -> u64 {
        let rest = [&self.ssim_parts, &self.l1_parts, &self.grad_image, &self.result];
        self.planes.iter().chain(rest).map(Buffer::size).sum()
    }

    /// dL/d(image), in the layout of the image; the fourth component is zero.
    pub fn grad_image(&self) -> &Buffer {
        &self.grad_image
    }

    /// Total, L1 and SSIM of the last recorded view.
    pub fn result(&self) -> &Buffer {
        &self.result
    }
}

/// Threads that sum the partial losses.
fn sum_threads(caps: &Caps) -> u32 {
    const MOST: u32 = 1024;
    match caps.kind {
        DeviceKind::Cpu => loss::SUM_THREADS,
        _ => caps.limits.workgroup_size.clamp(loss::SUM_THREADS, MOST) / loss::SUM_THREADS * loss::SUM_THREADS,
    }
}
