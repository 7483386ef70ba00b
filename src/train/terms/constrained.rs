//! The constrained set beside the full one: the splats that were there at the end of the low-frequency stage are rendered alone,
//! for the same view, and their gradient maps compared with the photograph's.

use std::sync::Arc;

use super::{LossTerm, Phase, StepContext};
use crate::loss::{GradientMapLoss, GradientMapWeights};
use crate::pass::constrain::{ADD, KEEP};
use crate::raster::{MemoryFootprint, Renderer};
use crate::train::Error;
use crate::vk::{self, Buffer, Gpu, Memory, Pipeline, Recorder, slices};

/// Bytes of the gradients of a projected splat.
const ROW: u64 = 48;

/// Room for the gradients of the constrained set while the full one is rendered.
pub(super) struct Constrained {
    maps: Arc<GradientMapLoss>,
    weight: f64,
    kept: Buffer,
    keep: Pipeline,
    add: Pipeline,
}

impl Constrained {
    /// For `splats` splats.
    pub(super) fn new(gpu: &Gpu, splats: u32, maps: Arc<GradientMapLoss>, weight: f64) -> Result<Self, vk::Error> {
        Ok(Self {
            maps,
            weight,
            kept: room(gpu, splats)?,
            keep: gpu.pipeline(&KEEP.kernel, &[])?,
            add: gpu.pipeline(&ADD.kernel, &[])?,
        })
    }

    /// Room for as many splats; what is there is lost.
    pub(super) fn resize(&mut self, gpu: &Gpu, splats: u32) -> Result<(), vk::Error> {
        self.kept = room(gpu, splats)?;
        Ok(())
    }

    /// Records the render of the constrained set, and keeps the gradients of the correlation of its gradient maps with the photograph's.
    /// Overwrites the target and the gradient of the image.
    fn record_keep(&self, recorder: &mut Recorder, step: &StepContext<'_>) -> Result<(), vk::Error> {
        let lists = step.record_constrained_forward(recorder)?;
        recorder.fill(step.grad_image, 0)?;
        let weight = (self.weight * step.plan.gradients.unwrap_or(0.0)) as f32;
        let weights = GradientMapWeights { correlation: weight, variation: 0.0 };
        self.maps.record(recorder, &step.target.image, &step.photograph, &weights, step.grad_image)?;
        step.record_blend_backward(recorder, &lists)?;
        let renderer = step.renderer;
        let Some(grad2d) = renderer.grad2d() else { return Ok(()) };
        let [counts, tile_counts, kept] = slices([&renderer.counters, &renderer.tile_counts, &self.kept]);
        recorder.dispatch(&self.keep, &[counts, tile_counts, grad2d, kept], &(), renderer.per_splat())
    }

    /// Records adding what is kept to the gradients of the full set's projected splats.
    fn record_add(&self, recorder: &mut Recorder, renderer: &Renderer) -> Result<(), vk::Error> {
        let Some(grad2d) = renderer.grad2d() else { return Ok(()) };
        let [counts, tile_counts, kept] = slices([&renderer.counters, &renderer.tile_counts, &self.kept]);
        recorder.dispatch(&self.add, &[counts, tile_counts, kept, grad2d], &(), renderer.per_splat())
    }
}

impl LossTerm for Constrained {
    fn phases(&self) -> &'static [Phase] {
        &[Phase::BeforeRender, Phase::AfterBlendBackward]
    }

    fn due(&self, step: &StepContext<'_>) -> bool {
        step.plan.gradients.is_some()
    }

    fn record<'a>(&'a self, phase: Phase, recorder: &mut Recorder, step: &mut StepContext<'a>) -> Result<(), Error> {
        match phase {
            Phase::BeforeRender => self.record_keep(recorder, step)?,
            _ => self.record_add(recorder, step.renderer)?,
        }
        Ok(())
    }

    fn footprint(&self) -> MemoryFootprint {
        MemoryFootprint { splats: self.kept.size(), ..MemoryFootprint::default() }
    }
}

fn room(gpu: &Gpu, splats: u32) -> Result<Buffer, vk::Error> {
    gpu.buffer("constrained_grad2d", ROW * u64::from(splats.max(1)), Memory::Device)
}
