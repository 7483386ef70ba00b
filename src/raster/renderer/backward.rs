//! The backward of a view: from the gradient of its image to gradients of the model, or to an optimiser step.

use super::{Renderer, Shot};
use crate::pass::camera::CameraPush;
use crate::pass::{adam, project_backward, project_backward_adam, slot_sum};
use crate::raster::kernels;
use crate::raster::planes::Planes;
use crate::raster::size::Size;
use crate::raster::target::Target;
use crate::raster::tiles::Lists;
use crate::raster::variants::{GradientSum, Variants};
use crate::vk::{self, Buffer, BufferSlice, Gpu, Groups, Memory, Part, Pipeline, Recorder, slices};

/// Whose gradients a backward pass computes, from what, and where they go.
#[derive(Clone, Copy)]
pub struct Gradients<'a> {
    /// The model that was rendered.
    pub model: &'a Planes,
    /// dL/d(image), a vec4 per pixel.
    pub of_image: &'a Buffer,
    /// dL/d(model), written.
    pub of_model: &'a Planes,
}

/// An optimiser step that takes the place of gradients: see [`Renderer::record_backward_step`].
#[derive(Clone, Copy)]
pub struct BackwardStep<'a> {
    /// The model that was rendered, and changes.
    pub model: &'a Planes,
    /// The first and second moments, or both in one, which change with it.
    pub moments: &'a [Planes],
    /// The pipeline of [`project_backward_adam`], or of its form for packed moments, with the optimiser's constants.
    pub pipeline: &'a Pipeline,
    /// The optimiser's settings.
    pub settings: &'a adam::Settings,
    /// Learning rates.
    pub rates: &'a project_backward_adam::Rates,
    /// How many steps have been taken.
    pub steps: project_backward_adam::Steps,
}

/// Pipelines and buffers of the backward.
pub(super) struct Backward {
    blend: Pipeline,
    slot_sum: Option<Pipeline>,
    project: Pipeline,
    pub(super) slot_grads: Buffer,
    pub(super) unused_normals: Buffer,
    /// Beginning of the buffer that the tile lists use before.
    pub(super) grad2d: Part,
}

impl Backward {
    pub(super) fn new(gpu: &Gpu, variants: Variants, size: &Size, grad2d: Part) -> Result<Self, vk::Error> {
        let chosen = kernels::blend_backward(gpu, variants)?;
        let slots = variants.gradients == GradientSum::Slots;
        let mut switches =
            vec![("COUNT", u32::from(size.count)), ("CLAMP_GRADIENT_PASSES", u32::from(size.clamp_gradient_passes))];
        switches.extend(chosen.constants);
        Ok(Self {
            blend: gpu.pipeline(&chosen.pass.kernel, &switches)?,
            slot_sum: if slots { Some(gpu.pipeline(&slot_sum::PASS.kernel, &[])?) } else { None },
            project: gpu.pipeline(&project_backward::PASS.kernel, &[])?,
            slot_grads: gpu.buffer(
                "slot_grads",
                if slots { 48 * u64::from(size.pairs) } else { 16 },
                Memory::Device,
            )?,
            unused_normals: gpu.buffer("unused_normals", 16, Memory::Device)?,
            grad2d,
        })
    }
}

impl Renderer {
    /// Gradients of a model from those of its image, after [`Self::record_forward`] of the same shot. Does nothing without a
    /// backward.
    pub fn record_backward(
        &self,
        recorder: &mut Recorder,
        lists: &Lists<'_>,
        gradients: &Gradients<'_>,
        shot: &Shot,
        target: &Target,
    ) -> Result<(), vk::Error> {
        self.record_blend_backward(recorder, lists, gradients.of_image, shot, target)?;
        self.record_project_backward(recorder, gradients.model, gradients.of_model, shot)
    }

    /// Gradients of `model`, written to `of_model`, after [`Self::record_blend_backward`] of the same shot. Does nothing without
    /// a backward.
    pub fn record_project_backward(
        &self,
        recorder: &mut Recorder,
        model: &Planes,
        of_model: &Planes,
        shot: &Shot,
    ) -> Result<(), vk::Error> {
        let Some(backward) = &self.backward else { return Ok(()) };
        let push = CameraPush::new(&shot.camera, &shot.projection);
        let [counts, splat2d, tile_counts, unused] =
            slices([&self.counters, &self.splat2d, &self.tile_counts, &backward.unused_normals]);
        let mut buffers = vec![counts];
        buffers.extend(model.buffers().iter().map(BufferSlice::from));
        buffers.extend([splat2d, tile_counts, backward.grad2d.slice(), unused]);
        buffers.extend(of_model.buffers().iter().map(BufferSlice::from));
        recorder.dispatch(&backward.project, &buffers, &push, self.per_splat())
    }

    /// One optimiser step, after [`Self::record_blend_backward`] of the same shot: what gradients of the model and the optimiser
    /// would do, without gradients in memory. Does nothing without a backward.
    pub fn record_backward_step(
        &self,
        recorder: &mut Recorder,
        step: &BackwardStep<'_>,
        shot: &Shot,
    ) -> Result<(), vk::Error> {
        let Some(backward) = &self.backward else { return Ok(()) };
        let camera = CameraPush::new(&shot.camera, &shot.projection);
        let push = project_backward_adam::Push::new(&camera, step.settings, step.rates, step.steps);
        let [counts, splat2d, tile_counts, unused] =
            slices([&self.counters, &self.splat2d, &self.tile_counts, &backward.unused_normals]);
        let mut buffers = vec![counts, splat2d, tile_counts, backward.grad2d.slice(), unused];
        for planes in std::iter::once(step.model).chain(step.moments) {
            buffers.extend(planes.buffers().iter().map(BufferSlice::from));
        }
        recorder.dispatch(step.pipeline, &buffers, &push, self.per_splat())
    }

    /// Gradients of the projected splats ([`Self::grad2d`]) from those of the image, after [`Self::record_forward`] of the same
    /// shot. Does nothing without a backward.
    pub fn record_blend_backward(
        &self,
        recorder: &mut Recorder,
        lists: &Lists<'_>,
        of_image: &Buffer,
        shot: &Shot,
        target: &Target,
    ) -> Result<(), vk::Error> {
        let Some(backward) = &self.backward else { return Ok(()) };
        let (width, height) = (shot.camera.width, shot.camera.height);
        let push = shot.blend_push();
        let [splat2d, normals, image, last, of_image] =
            slices([&self.splat2d, &self.normals, &target.image, &target.last, of_image]);
        let [unused, slot_grads, counted] = slices([&backward.unused_normals, &backward.slot_grads, &self.pair_counts]);
        let grad2d = backward.grad2d.slice();
        // Without the auxiliary channels these stand for what is not read; another buffer stands for what is not written.
        let unread = normals;
        let mut buffers = vec![splat2d, normals, lists.sorted_splats, lists.tile_ranges, image, last, of_image, unread];
        let groups = Groups::Workgroups(self.tiles(width, height));
        if let (Some(slot_sum), Some(slots)) = (&backward.slot_sum, &lists.slots) {
            buffers.extend([slots.sorted_slots, slot_grads, unused, counted]);
            recorder.dispatch(&backward.blend, &buffers, &push, groups)?;
            let [counts, tile_counts] = slices([&self.counters, &self.tile_counts]);
            let buffers = [counts, slots.order, slots.pair_offsets, tile_counts, slot_grads, unread, grad2d, unused];
            recorder.dispatch(slot_sum, &buffers, &(), lists.slot_sums)
        } else {
            recorder.fill(grad2d, 0)?;
            buffers.extend([grad2d, unused, counted]);
            recorder.dispatch(&backward.blend, &buffers, &push, groups)
        }
    }

    /// Gradients of the projected splats; `None` without a backward.
    pub fn grad2d(&self) -> Option<BufferSlice<'_>> {
        self.backward.as_ref().map(|b| b.grad2d.slice())
    }
}
