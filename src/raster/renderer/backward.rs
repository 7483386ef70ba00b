//! Backward pass of a view: from the gradient of the image to gradients of the model, or to an optimiser step.

use super::kept::KeptForm;
use super::{RenderView, Renderer, entry};
use crate::pass::camera::CameraPush;
use crate::pass::project_backward::Penalties;
use crate::pass::turns::per_turn;
use crate::pass::{adam, alpha_min, project_backward, project_backward_adam, slot_sum};
use crate::raster::pass_select;
use crate::raster::planes::Planes;
use crate::raster::planes::ShStorage;
use crate::raster::size::Size;
use crate::raster::target::Target;
use crate::raster::tiles::FrameLists;
use crate::raster::variants::{GradientSum, Variants};
use crate::vk::{self, Buffer, BufferRange, BufferSlice, Gpu, Groups, Memory, Pipeline, Recorder, slices};

/// Gradients of the outputs of a forward pass. A buffer with the gradient of the image converts into this type.
#[derive(Clone, Copy)]
pub struct ImageGradients<'a> {
    /// dL/d(image), a vec4 per pixel: the gradient of the colour, and the gradient of the final transmittance apart
    /// from the transmittance's effect on the background colour.
    pub of_image: &'a Buffer,
    /// dL/d(auxiliary image), a vec4 per pixel: the gradients of the weighted sums of depth and normals. Needs a
    /// forward pass with `aux`, and a renderer with auxiliary channels ([`Size::aux`]).
    pub of_aux: Option<&'a Buffer>,
}

impl<'a> From<&'a Buffer> for ImageGradients<'a> {
    fn from(of_image: &'a Buffer) -> Self {
        Self { of_image, of_aux: None }
    }
}

/// Inputs and outputs of a backward pass.
#[derive(Clone, Copy)]
pub struct Gradients<'a> {
    /// The rendered model.
    pub model: &'a Planes,
    /// Gradients of the forward pass's outputs.
    pub of_image: ImageGradients<'a>,
    /// dL/d(model); written.
    pub of_model: &'a Planes,
}

/// Terms of a model's gradients beyond colour.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GradientTerms {
    /// Gradients of depth and normals, after a blend backward pass with auxiliary channels.
    pub aux: bool,
    /// Losses on the splats themselves.
    pub penalties: Penalties,
    /// Whether the gradients are added to the model's gradients instead of overwriting them.
    pub add: bool,
}

/// An optimiser step fused with the backward pass: see [`Renderer::record_backward_step`].
#[derive(Clone, Copy)]
pub struct BackwardStep<'a> {
    /// The rendered model, which the step updates.
    pub model: &'a Planes,
    /// The first and second moments, or both packed in one set of planes. Updated with the model.
    pub moments: &'a [Planes],
    /// The pipeline of [`project_backward_adam`], or of its variant for packed moments, with the optimiser's constants.
    /// `AUX` is on if and only if the blend backward pass had auxiliary channels; `LISTED` if and only if the renderer
    /// lists the splats on the image ([`Size::listed`]).
    pub pipeline: &'a Pipeline,
    /// The optimiser's settings.
    pub settings: &'a adam::AdamSettings,
    /// Learning rates.
    pub rates: &'a project_backward_adam::LearningRates,
    /// Number of steps taken.
    pub steps: project_backward_adam::StepCounts,
    /// Whether [`Penalties::decide`] counts.
    pub decides: bool,
    /// Rows of four numbers per splat. The last number is the last step of the splat, modulo 2^16; used only with
    /// `LISTED` and `CATCHES_UP`.
    pub stats: &'a Buffer,
    /// Whether the pipeline has `CATCHES_UP`.
    pub catches_up: bool,
}

/// Backward pipelines that depend on the auxiliary channels (depth, normals) and on the alpha cutoff.
#[derive(Clone)]
struct BackwardPipelines {
    blend: Pipeline,
    slot_sum: Option<Pipeline>,
}

impl BackwardPipelines {
    /// `cutoff`: see [`alpha_min`].
    fn new(
        gpu: &Gpu,
        variants: Variants,
        cutoff: Option<u32>,
        aux: bool,
        form: BackwardConstants,
    ) -> Result<Self, vk::Error> {
        let chosen = pass_select::blend_backward(gpu, variants)?;
        let aux = ("AUX", u32::from(aux));
        let mut switches = vec![
            aux,
            ("COUNT", u32::from(form.count)),
            ("ABS", u32::from(form.absolute)),
            ("CLAMP_GRADIENT_PASSES", u32::from(form.clamp_gradient_passes)),
            alpha_min::constant(cutoff),
        ];
        switches.extend(&chosen.constants);
        switches.extend(form.kept.of_backward());
        let summed = || gpu.pipeline(&slot_sum::PASS.kernel, &[aux, form.turn]);
        Ok(Self {
            blend: gpu.pipeline(&chosen.pass.kernel, &switches)?,
            slot_sum: (variants.gradients == GradientSum::Slots).then(summed).transpose()?,
        })
    }
}

/// Constants shared by all backward pipelines.
#[derive(Clone, Copy)]
struct BackwardConstants {
    count: bool,
    absolute: bool,
    clamp_gradient_passes: bool,
    turn: (&'static str, u32),
    kept: KeptForm,
}

/// Pipelines and buffers of the backward pass.
pub(super) struct Backward {
    colour: BackwardPipelines,
    /// `None` without auxiliary channels.
    all: Option<BackwardPipelines>,
    form: BackwardConstants,
    pub(super) slot_grads: Buffer,
    /// A single entry when the auxiliary channels or the slots are off.
    pub(super) slot_normals: Buffer,
    /// A single entry when the auxiliary channels are off.
    pub(super) grad_normals: Buffer,
    /// Beginning of the buffer that the tile lists use before the backward pass.
    pub(super) grad2d: BufferRange,
}

/// Checks that the model is in 32 bits, as gradients require.
fn all_bits(model: &Planes) -> Result<(), vk::Error> {
    match model.sh() {
        ShStorage::Full => Ok(()),
        ShStorage::Half => Err(vk::Error::Interface {
            kernel: project_backward::PASS.kernel.name,
            what: "spherical harmonics in half floats have no gradients; upload the model in 32 bits".into(),
        }),
    }
}

impl Backward {
    pub(super) fn new(
        gpu: &Gpu,
        variants: Variants,
        size: &Size,
        grad2d: BufferRange,
        kept: KeptForm,
    ) -> Result<Self, vk::Error> {
        let slots = variants.gradients == GradientSum::Slots;
        let form = BackwardConstants {
            count: size.count,
            absolute: size.absolute,
            clamp_gradient_passes: size.clamp_gradient_passes,
            turn: per_turn(u64::from(size.tiles)),
            kept,
        };
        let channels = |aux: bool| BackwardPipelines::new(gpu, variants, None, aux, form);
        let rows = |name, there: bool, bytes: u64, count: u32| {
            gpu.buffer(name, if there { bytes * u64::from(count.max(1)) } else { 16 }, Memory::Device)
        };
        Ok(Self {
            colour: channels(false)?,
            all: size.aux.then(|| channels(true)).transpose()?,
            form,
            slot_grads: rows("slot_grads", slots, 48, size.pairs)?,
            slot_normals: rows("slot_normals", slots && size.aux, 16, size.pairs)?,
            grad_normals: rows("grad_normals", size.aux, 16, size.splats)?,
            grad2d,
        })
    }

    /// The pipelines for gradients of colour only, or of all channels.
    fn channels(&self, aux: bool) -> &BackwardPipelines {
        self.all.as_ref().filter(|_| aux).unwrap_or(&self.colour)
    }
}

impl Renderer {
    /// Computes the gradients of a model from the gradients of the image, after [`Self::record_forward`] of the same
    /// view. Does nothing unless [`Size::train`] is on.
    pub fn record_backward(
        &self,
        recorder: &mut Recorder,
        lists: &FrameLists<'_>,
        gradients: &Gradients<'_>,
        view: &RenderView,
        target: &Target,
    ) -> Result<(), vk::Error> {
        self.record_blend_backward(recorder, lists, gradients.of_image, view, target)?;
        let terms = GradientTerms { aux: gradients.of_image.of_aux.is_some(), ..GradientTerms::default() };
        self.record_project_backward_of(recorder, gradients.model, gradients.of_model, view, terms)
    }

    /// Writes the gradients of `model` to `of_model`, after [`Self::record_blend_backward`] of the same view without
    /// auxiliary channels. Does nothing unless [`Size::train`] is on.
    pub fn record_project_backward(
        &self,
        recorder: &mut Recorder,
        model: &Planes,
        of_model: &Planes,
        view: &RenderView,
    ) -> Result<(), vk::Error> {
        self.record_project_backward_of(recorder, model, of_model, view, GradientTerms::default())
    }

    /// Like [`Self::record_project_backward`], with further gradient terms.
    pub fn record_project_backward_of(
        &self,
        recorder: &mut Recorder,
        model: &Planes,
        of_model: &Planes,
        view: &RenderView,
        terms: GradientTerms,
    ) -> Result<(), vk::Error> {
        all_bits(model)?;
        let Some(backward) = &self.backward else { return Ok(()) };
        let mut constants = vec![("AUX", u32::from(terms.aux && self.with_aux)), ("ADD", u32::from(terms.add))];
        constants.extend(terms.penalties.constants());
        let pipeline = self.gpu.pipeline(&project_backward::PASS.kernel, &constants)?;
        let push = CameraPush::new(&view.camera, &view.projection);
        let [counts, splat2d, tile_counts, grad_normals] =
            slices([&self.counters, &self.splat2d, &self.tile_counts, &backward.grad_normals]);
        let mut buffers = vec![counts];
        buffers.extend(model.buffers().iter().map(BufferSlice::from));
        buffers.extend([splat2d, tile_counts, backward.grad2d.slice(), grad_normals]);
        buffers.extend(of_model.buffers().iter().map(BufferSlice::from));
        recorder.dispatch(&pipeline, &buffers, &push, self.per_splat())
    }

    /// One optimiser step, after [`Self::record_blend_backward`] of the same view. Equivalent to computing the
    /// gradients of the model and running the optimiser, but keeps no gradients in memory. Does nothing unless
    /// [`Size::train`] is on.
    pub fn record_backward_step(
        &self,
        recorder: &mut Recorder,
        step: &BackwardStep<'_>,
        view: &RenderView,
    ) -> Result<(), vk::Error> {
        all_bits(step.model)?;
        let Some(backward) = &self.backward else { return Ok(()) };
        let camera = CameraPush::new(&view.camera, &view.projection);
        let push =
            project_backward_adam::Push::new(&camera, step.settings, step.rates, step.steps).deciding(step.decides);
        let [counts, splat2d, tile_counts, grad_normals] =
            slices([&self.counters, &self.splat2d, &self.tile_counts, &backward.grad_normals]);
        let listed = self.lists.listed(&self.args, entry::TILES).filter(|_| !step.catches_up);
        let (on_image, groups) = listed.unwrap_or_else(|| (tile_counts, self.per_splat()));
        let mut buffers = vec![counts, splat2d, on_image, backward.grad2d.slice(), grad_normals];
        for planes in std::iter::once(step.model).chain(step.moments) {
            buffers.extend(planes.buffers().iter().map(BufferSlice::from));
        }
        buffers.push(step.stats.into());
        recorder.dispatch(step.pipeline, &buffers, &push, groups)
    }

    /// Computes the gradients of the projected splats ([`Self::grad2d`], and [`Self::grad_normals`] with auxiliary
    /// channels) from the gradients of the image, after [`Self::record_forward`] of the same view. Does nothing unless
    /// [`Size::train`] is on.
    pub fn record_blend_backward<'a>(
        &self,
        recorder: &mut Recorder,
        lists: &FrameLists<'_>,
        gradients: impl Into<ImageGradients<'a>>,
        view: &RenderView,
        target: &Target,
    ) -> Result<(), vk::Error> {
        let Some(backward) = &self.backward else { return Ok(()) };
        let ImageGradients { of_image, of_aux } = gradients.into();
        let of_aux = of_aux.filter(|_| self.with_aux);
        let aux = of_aux.is_some();
        let channels = match view.projection.alpha_cutoff {
            cutoff @ Some(_) => BackwardPipelines::new(&self.gpu, self.variants, cutoff, aux, backward.form)?,
            None => backward.channels(aux).clone(),
        };
        let (width, height) = (view.camera.width, view.camera.height);
        let push = view.blend_push();
        // Without auxiliary channels, placeholders are bound for unused inputs; unused outputs have buffers of their
        // own.
        let [splat2d, normals, image, last, of_image, of_aux] = slices([
            &self.splat2d,
            &self.normals,
            &target.image,
            &target.last,
            of_image,
            of_aux.unwrap_or(&self.normals),
        ]);
        let [slot_grads, slot_normals, grad_normals, counted] =
            slices([&backward.slot_grads, &backward.slot_normals, &backward.grad_normals, &self.pair_counts]);
        let grad2d = backward.grad2d.slice();
        let mut buffers = vec![splat2d, normals, lists.sorted_splats, lists.tile_ranges, image, last, of_image, of_aux];
        let groups = Groups::Workgroups(self.tiles(width, height) * backward.form.kept.groups_per_tile());
        let kept = self.kept.for_backward();
        if let (Some(slot_sum), Some(slots)) = (&channels.slot_sum, &lists.slots) {
            buffers.extend([slots.sorted_slots, slot_grads, slot_normals, counted]);
            buffers.extend(kept);
            recorder.dispatch(&channels.blend, &buffers, &push, groups)?;
            let [counts, tile_counts] = slices([&self.counters, &self.tile_counts]);
            let buffers =
                [counts, slots.listed, slots.slot_offsets, tile_counts, slot_grads, slot_normals, grad2d, grad_normals];
            recorder.dispatch(slot_sum, &buffers, &(), lists.slot_sums)
        } else {
            recorder.fill(grad2d, 0)?;
            if aux {
                recorder.fill(grad_normals, 0)?;
            }
            buffers.extend([grad2d, grad_normals, counted]);
            buffers.extend(kept);
            recorder.dispatch(&channels.blend, &buffers, &push, groups)
        }
    }

    /// Gradients of the projected splats, 12 floats each; `None` unless [`Size::train`] is on.
    pub fn grad2d(&self) -> Option<BufferSlice<'_>> {
        self.backward.as_ref().map(|b| b.grad2d.slice())
    }

    /// Gradients of the projected splats' normals, a vec4 each; `None` without backward pass or auxiliary channels.
    pub fn grad_normals(&self) -> Option<&Buffer> {
        self.backward.as_ref().filter(|_| self.with_aux).map(|b| &b.grad_normals)
    }
}
