//! The constrained set beside the full one: the splats that were there at the end of the low-frequency stage are rendered alone,
//! for the same view, and their gradient maps compared with the photograph's.

use crate::losses::{GradientMapLoss, GradientMapWeights, Photograph};
use crate::pass::constrain::{ADD, KEEP};
use crate::raster::{Planes, Renderer, Shot, Target};
use crate::vk::{self, Buffer, Gpu, Memory, Pipeline, Recorder, slices};

/// Bytes of the gradients of a projected splat.
const ROW: u64 = 48;

/// Room for the gradients of the constrained set while the full one is rendered.
pub(in crate::train) struct Constrained {
    kept: Buffer,
    keep: Pipeline,
    add: Pipeline,
}

impl Constrained {
    /// For `splats` splats.
    pub(in crate::train) fn new(gpu: &Gpu, splats: u32) -> Result<Self, vk::Error> {
        Ok(Self {
            kept: gpu.buffer("constrained_grad2d", ROW * u64::from(splats.max(1)), Memory::Device)?,
            keep: gpu.pipeline(&KEEP.kernel, &[])?,
            add: gpu.pipeline(&ADD.kernel, &[])?,
        })
    }

    /// Records rendering the constrained set of a model with these identities, and the gradients of the correlation of its gradient
    /// maps with the photograph's. To be followed by the full set's render and backward of the same shot, and [`Self::record_add`].
    /// Overwrites `target` and `grad_image`.
    pub(in crate::train) fn record(
        &self,
        recorder: &mut Recorder,
        renderer: &Renderer,
        (model, ids): (&Planes, &Buffer),
        (shot, target): (&Shot, &Target),
        (maps, photograph, weight): (&GradientMapLoss, &Photograph<'_>, f32),
        grad_image: &Buffer,
    ) -> Result<(), vk::Error> {
        let lists = renderer.record_forward_of(recorder, model, shot, target, false, Some(ids))?;
        recorder.fill(grad_image, 0)?;
        let weights = GradientMapWeights { correlation: weight, variation: 0.0 };
        maps.record(recorder, &target.image, photograph, &weights, grad_image)?;
        renderer.record_blend_backward(recorder, &lists, grad_image, shot, target)?;
        let Some(grad2d) = renderer.grad2d() else { return Ok(()) };
        let [counts, tile_counts, kept] = slices([&renderer.counters, &renderer.tile_counts, &self.kept]);
        recorder.dispatch(&self.keep, &[counts, tile_counts, grad2d, kept], &(), renderer.per_splat())
    }

    /// Records adding what the constrained set has learned to the gradients of the full set's projected splats.
    pub(in crate::train) fn record_add(&self, recorder: &mut Recorder, renderer: &Renderer) -> Result<(), vk::Error> {
        let Some(grad2d) = renderer.grad2d() else { return Ok(()) };
        let [counts, tile_counts, kept] = slices([&renderer.counters, &renderer.tile_counts, &self.kept]);
        recorder.dispatch(&self.add, &[counts, tile_counts, kept, grad2d], &(), renderer.per_splat())
    }

    /// Bytes of its buffers.
    pub(in crate::train) fn bytes(&self) -> u64 {
        self.kept.size()
    }
}
