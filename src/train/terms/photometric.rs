//! L1 and SSIM between the render as the photograph would show it and the photograph.

use super::{LossTerm, Phase, StepContext};
use crate::dataset::Depth;
use crate::pass::loss::{self, Layout, Push, SumPush};
use crate::raster::Held;
use crate::scene::Camera;
use crate::train::Error;
use crate::train::photographs::Shown;
use crate::train::schedule::StepPlan;
use crate::train::settings::Frequencies;
use crate::vk::{self, Buffer, Caps, DeviceKind, Gpu, Groups, Memory, Pipeline, Recorder, Subgroup};

/// L1 + SSIM between a render and a photograph, value and gradient.
pub(in crate::train) struct PhotometricLoss {
    lambda: f32,
    /// Of the largest image: strips of the others have as many rows and channels.
    layout: Layout,
    /// For photographs with 8 bits per channel, and with 16 where there are any.
    eight: Passes,
    sixteen: Option<Passes>,
    sum: Pipeline,
    planes: [Buffer; 3],
    ssim_parts: Buffer,
    l1_parts: Buffer,
    grad_image: Buffer,
    result: Buffer,
    low_stage: Option<LowStageWeights>,
}

/// Weights of pixels in the gradient, in the steps of the low-frequency stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LowStageWeights {
    /// Weight of saliency 0, and of 1.
    of: [f32; 2],
}

impl LowStageWeights {
    /// Where the settings have such a stage, and weigh pixels in it.
    pub(super) fn of(frequencies: &Frequencies) -> Option<Self> {
        let weighs = frequencies.low_stage > 0.0 && frequencies.low_texture_weight != 1.0;
        weighs.then_some(Self { of: [1.0, frequencies.low_texture_weight as f32] })
    }
}

/// The passes for one depth of photographs.
struct Passes {
    /// Without weights, and with them where there are any.
    strips: [Option<Pipeline>; 2],
    grad: [Option<Pipeline>; 2],
}

impl PhotometricLoss {
    /// For images of the given sizes, `deep` if some photographs have 16 bits per channel; `lambda` is the weight of 1 - SSIM, L1 has the
    /// rest.
    pub(super) fn new(
        gpu: &Gpu,
        sizes: &[(u32, u32)],
        deep: bool,
        low_stage: Option<LowStageWeights>,
        lambda: f64,
    ) -> Result<Self, vk::Error> {
        let (constant, lanes) = match gpu.caps().subgroup {
            Subgroup::Hardware(width) if width >= loss::LEAST_LANES => ("LOCAL_SIZE", width),
            _ => ("EMULATED_WIDTH", loss::EMULATED_LANES),
        };
        let (width, height) = sizes.iter().copied().max_by_key(|&(w, h)| u64::from(w) * u64::from(h)).unwrap_or((1, 1));
        let mut layout = Layout::new(width, height, lanes);
        let (strips, grad) = if constant == "EMULATED_WIDTH" {
            layout.apart = 3;
            (&loss::STRIPS_EMULATED, &loss::GRAD_EMULATED)
        } else if layout.apart == 3 {
            (&loss::STRIPS_SUBGROUP_APART, &loss::GRAD_SUBGROUP)
        } else if gpu.caps().kind == DeviceKind::Cpu {
            (&loss::STRIPS_SUBGROUP_THREE, &loss::GRAD_SUBGROUP)
        } else {
            (&loss::STRIPS_SUBGROUP, &loss::GRAD_SUBGROUP)
        };
        let passes = |depth: Depth| -> Result<Passes, vk::Error> {
            let (lanes, bits) = ((constant, lanes), ("PHOTOGRAPH_BITS", depth.bits()));
            let segment = ("SEGMENT", layout.segment);
            let one = |weights: u32| -> Result<[Option<Pipeline>; 2], vk::Error> {
                let weights = ("WEIGHTED", weights);
                let strips = gpu.pipeline(&strips.kernel, &[lanes, segment, bits, weights])?;
                Ok([Some(strips), Some(gpu.pipeline(&grad.kernel, &[lanes, bits, weights])?)])
            };
            let [plain_strips, plain_grad] = one(0)?;
            let [strips, grad] = if low_stage.is_some() { one(1)? } else { [None, None] };
            Ok(Passes { strips: [plain_strips, strips], grad: [plain_grad, grad] })
        };
        let most = |f: &dyn Fn(Layout) -> u64| {
            let layouts = sizes.iter().map(|&(width, height)| Layout { width, height, ..layout });
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
            low_stage,
        })
    }

    /// Weights of the pixels of a step, where they have any.
    pub(super) fn weights_of(&self, plan: &StepPlan) -> Option<LowStageWeights> {
        self.low_stage.filter(|weights| plan.low && weights.of[1] != 1.0)
    }

    /// dL/d(image), the layout of the image; the fourth component is zero.
    pub(in crate::train) fn grad_image(&self) -> &Buffer {
        &self.grad_image
    }

    /// Total, L1 and SSIM of the last recorded view.
    pub(in crate::train) fn result(&self) -> &Buffer {
        &self.result
    }
}

impl LossTerm for PhotometricLoss {
    fn phases(&self) -> &'static [Phase] {
        &[Phase::AfterExposure]
    }

    fn due(&self, _: &StepContext<'_>) -> bool {
        true
    }

    /// Of a part of a photograph the gradient is the part's share in that of all of it, and the loss that of the part.
    fn record<'a>(&'a self, _: Phase, recorder: &mut Recorder, step: &mut StepContext<'a>) -> Result<(), Error> {
        let Camera { width, height, .. } = step.shot.camera;
        let layout = Layout { width, height, ..self.layout };
        let Shown { buffer: photograph, depth, values, shown } = step.photograph;
        let passes = match (depth, &self.sixteen) {
            (Depth::Sixteen, Some(passes)) => passes,
            _ => &self.eight,
        };
        let weights = step.saliency.zip(self.weights_of(step.plan));
        let form = usize::from(weights.is_some());
        let (Some(strips), Some(grad)) = (&passes.strips[form], &passes.grad[form]) else { return Ok(()) };
        let (saliency, [low_weight, high_weight]) =
            weights.map_or((&self.result, [1.0; 2]), |(saliency, weights)| (saliency, weights.of));
        let push = Push { width, height, lambda: self.lambda, values, low_weight, high_weight };
        let [red, green, blue] = &self.planes;
        let buffers = [step.shown, photograph, red, green, blue, &self.ssim_parts, saliency];
        recorder.dispatch(strips, &buffers, &push, Groups::Items(layout.strip_threads()))?;
        let buffers = [step.shown, photograph, red, green, blue, &self.grad_image, &self.l1_parts, saliency];
        recorder.dispatch(grad, &buffers, &push, Groups::Items(layout.grad_threads()))?;
        let push = SumPush {
            values: shown,
            ssim_count: layout.ssim_parts(),
            l1_count: layout.l1_parts(),
            slot: 0,
            lambda: self.lambda,
        };
        let buffers = [&self.ssim_parts, &self.l1_parts, &self.result];
        Ok(recorder.dispatch(&self.sum, &buffers, &push, Groups::Workgroups(1))?)
    }

    fn footprint(&self) -> Held {
        let rest = [&self.ssim_parts, &self.l1_parts, &self.grad_image, &self.result];
        Held { pixels: self.planes.iter().chain(rest).map(Buffer::size).sum(), ..Held::default() }
    }
}

/// Threads that add the parts of the loss up.
fn sum_threads(caps: &Caps) -> u32 {
    const MOST: u32 = 1024;
    match caps.kind {
        DeviceKind::Cpu => loss::SUM_THREADS,
        _ => caps.limits.workgroup_size.clamp(loss::SUM_THREADS, MOST) / loss::SUM_THREADS * loss::SUM_THREADS,
    }
}
