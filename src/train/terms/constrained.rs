//! The loss of the constrained set: the splats that were there at the end of the low-frequency stage are also rendered
//! alone, and gradient maps of that render are compared with those of the photograph or of the full render.

use std::sync::Arc;

use super::{LossTerm, Phase, StepContext};
use crate::loss::{GradientMapLoss, GradientMapWeights, MapImages};
use crate::pass::constrain::{ADD, KEEP};
use crate::raster::{MemoryFootprint, Renderer};
use crate::train::Error;
use crate::train::settings::{ConstrainedAgainst, Texture};
use crate::vk::{self, Buffer, Gpu, Memory, Pipeline, Recorder, slices};

/// Bytes of the gradients of a projected splat.
const ROW: u64 = 48;
/// Bytes of a pixel of a render.
const PIXEL: u64 = 16;

/// Keeps the gradients of the constrained set while all splats are rendered.
pub(super) struct Constrained {
    maps: Arc<GradientMapLoss>,
    weight: f64,
    /// The render of the other set where both are compared with each other: first that of all splats, then that of the
    /// constrained set.
    other: Option<Buffer>,
    kept: Buffer,
    keep: Pipeline,
    add: Pipeline,
}

impl Constrained {
    /// For `splats` splats and pictures of `pixels` pixels.
    pub(super) fn new(
        gpu: &Gpu,
        splats: u32,
        pixels: u32,
        maps: Arc<GradientMapLoss>,
        texture: &Texture,
    ) -> Result<Self, vk::Error> {
        let picture = || gpu.buffer("constrained_other", PIXEL * u64::from(pixels.max(1)), Memory::Device);
        let both = texture.constrained_against == ConstrainedAgainst::Render;
        Ok(Self {
            maps,
            weight: texture.lambda_constrained,
            other: both.then(picture).transpose()?,
            kept: room(gpu, splats)?,
            keep: gpu.pipeline(&KEEP.kernel, &[])?,
            add: gpu.pipeline(&ADD.kernel, &[])?,
        })
    }

    /// Makes room for `splats` splats; contents are lost.
    pub(super) fn resize(&mut self, gpu: &Gpu, splats: u32) -> Result<(), vk::Error> {
        self.kept = room(gpu, splats)?;
        Ok(())
    }

    /// Records the render of the constrained set, and keeps the gradients of the correlation of gradient maps between
    /// that render and the other picture. Overwrites the target and the image gradient.
    fn record_keep(&self, recorder: &mut Recorder, step: &StepContext<'_>) -> Result<(), vk::Error> {
        let image = &step.target.image;
        let bytes = PIXEL * u64::from(step.pixels());
        if let Some(other) = &self.other {
            step.record_forward(recorder, false)?;
            recorder.copy(image, 0, other, 0, bytes)?;
        }
        let lists = step.record_constrained_forward(recorder)?;
        recorder.fill(step.grad_image, 0)?;
        self.record_maps(recorder, step)?;
        step.record_blend_backward(recorder, &lists)?;
        if let Some(other) = &self.other {
            recorder.copy(image, 0, other, 0, bytes)?;
        }
        let renderer = step.renderer;
        let Some(grad2d) = renderer.grad2d() else { return Ok(()) };
        let [counts, tile_counts, kept] = slices([&renderer.counters, &renderer.tile_counts, &self.kept]);
        recorder.dispatch(&self.keep, &[counts, tile_counts, grad2d, kept], &(), renderer.per_splat())
    }

    /// Records adding the gradient of the correlation between the present render and the other picture.
    fn record_maps(&self, recorder: &mut Recorder, step: &StepContext<'_>) -> Result<(), vk::Error> {
        let weight = (self.weight * step.plan.gradients.unwrap_or(0.0)) as f32;
        let weights = GradientMapWeights { correlation: weight, variation: 0.0 };
        let images = MapImages { image: &step.target.image, other: self.other.as_ref() };
        self.maps.record(recorder, images, &step.photograph, &weights, step.grad_image)
    }

    /// Records adding the kept gradients to the gradients of the projected splats.
    fn record_add(&self, recorder: &mut Recorder, renderer: &Renderer) -> Result<(), vk::Error> {
        let Some(grad2d) = renderer.grad2d() else { return Ok(()) };
        let [counts, tile_counts, kept] = slices([&renderer.counters, &renderer.tile_counts, &self.kept]);
        recorder.dispatch(&self.add, &[counts, tile_counts, kept, grad2d], &(), renderer.per_splat())
    }
}

impl LossTerm for Constrained {
    fn phases(&self) -> &'static [Phase] {
        &[Phase::BeforeRender, Phase::AfterExposureBackward, Phase::AfterBlendBackward]
    }

    fn due(&self, step: &StepContext<'_>) -> bool {
        step.plan.gradients.is_some()
    }

    fn record<'a>(&'a self, phase: Phase, recorder: &mut Recorder, step: &mut StepContext<'a>) -> Result<(), Error> {
        match phase {
            Phase::BeforeRender => self.record_keep(recorder, step)?,
            // Both renders are compared in the model's own colours.
            Phase::AfterExposureBackward if self.other.is_some() => self.record_maps(recorder, step)?,
            Phase::AfterExposureBackward => {}
            _ => self.record_add(recorder, step.renderer)?,
        }
        Ok(())
    }

    fn footprint(&self) -> MemoryFootprint {
        let pixels = self.other.as_ref().map_or(0, Buffer::size);
        MemoryFootprint { splats: self.kept.size(), pixels, ..MemoryFootprint::default() }
    }
}

fn room(gpu: &Gpu, splats: u32) -> Result<Buffer, vk::Error> {
    gpu.buffer("constrained_grad2d", ROW * u64::from(splats.max(1)), Memory::Device)
}
