//! The backward of a view: from the gradient of its image to gradients of the model, or to an optimiser step.

use super::{Renderer, Shot, entry};
use crate::pass::camera::CameraPush;
use crate::pass::turns::per_turn;
use crate::pass::{adam, alpha_min, project_backward, project_backward_adam, slot_sum};
use crate::raster::pass_select;
use crate::raster::planes::Planes;
use crate::raster::planes::ShStorage;
use crate::raster::size::Size;
use crate::raster::target::Target;
use crate::raster::tiles::Lists;
use crate::raster::variants::{GradientSum, Variants};
use crate::vk::{self, Buffer, BufferRange, BufferSlice, Gpu, Groups, Memory, Pipeline, Recorder, slices};

/// Gradients of what a forward pass wrote; of an image alone, its buffer turned into this.
#[derive(Clone, Copy)]
pub struct ImageGradients<'a> {
    /// dL/d(image), a vec4 per pixel: of the colour, and of the final transmittance beyond what the background's part
    /// of the colour says about it.
    pub of_image: &'a Buffer,
    /// dL/d(auxiliary image), a vec4 per pixel: of the sums of weighted depths and normals. The forward pass must have
    /// written them, and the renderer have the auxiliary channels ([`Size::aux`]).
    pub of_aux: Option<&'a Buffer>,
}

impl<'a> From<&'a Buffer> for ImageGradients<'a> {
    fn from(of_image: &'a Buffer) -> Self {
        Self { of_image, of_aux: None }
    }
}

/// Whose gradients a backward pass computes, from what, and where they go.
#[derive(Clone, Copy)]
pub struct Gradients<'a> {
    /// The model that was rendered.
    pub model: &'a Planes,
    /// dL/d(what was rendered).
    pub of_image: ImageGradients<'a>,
    /// dL/d(model), written.
    pub of_model: &'a Planes,
}

/// What the gradients of a model hold beyond those of its colour.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Terms {
    /// The depth's and the normals', after a blend backward with auxiliary channels.
    pub aux: bool,
    /// Those of a loss of this times the smallest standard deviation of every splat on the image, in scene units.
    pub flatten: f32,
    /// Those of a loss of this times half the squares of the view-dependent coefficients in use of every splat on the
    /// image.
    pub shrink: f32,
    /// Whether the gradients of the model are added to what is there, in place of being written.
    pub add: bool,
}

/// An optimiser step that takes the place of gradients: see [`Renderer::record_backward_step`].
#[derive(Clone, Copy)]
pub struct BackwardStep<'a> {
    /// The model that was rendered, and changes.
    pub model: &'a Planes,
    /// The first and second moments, or both in one, which change with it.
    pub moments: &'a [Planes],
    /// The pipeline of [`project_backward_adam`], or of its variant for packed moments, with the optimiser's constants:
    /// with `AUX` exactly after a blend backward of the auxiliary channels, and with `LISTED` exactly where the
    /// renderer lists the splats on the image ([`Size::listed`]).
    pub pipeline: &'a Pipeline,
    /// The optimiser's settings.
    pub settings: &'a adam::Settings,
    /// Learning rates.
    pub rates: &'a project_backward_adam::Rates,
    /// How many steps have been taken.
    pub steps: project_backward_adam::Steps,
    /// Rows of four, of which the last is the step in which a splat has last taken one, modulo 2^16; read and written
    /// with `LISTED` and `CATCHES_UP` alone.
    pub stats: &'a Buffer,
    /// Whether the pipeline has `CATCHES_UP`.
    pub catches_up: bool,
}

/// Pipelines that differ by whether depth and normals have gradients too, and by where alphas are cut off.
#[derive(Clone)]
struct Channels {
    blend: Pipeline,
    slot_sum: Option<Pipeline>,
}

impl Channels {
    /// `cutoff`: see [`alpha_min`].
    fn new(gpu: &Gpu, variants: Variants, cutoff: Option<u32>, aux: bool, form: Form) -> Result<Self, vk::Error> {
        let chosen = pass_select::blend_backward(gpu, variants)?;
        let aux = ("AUX", u32::from(aux));
        let mut switches = vec![
            aux,
            ("COUNT", u32::from(form.count)),
            ("CLAMP_GRADIENT_PASSES", u32::from(form.clamp_gradient_passes)),
            alpha_min::constant(cutoff),
        ];
        switches.extend(&chosen.constants);
        let summed = || gpu.pipeline(&slot_sum::PASS.kernel, &[aux, form.turn]);
        Ok(Self {
            blend: gpu.pipeline(&chosen.pass.kernel, &switches)?,
            slot_sum: (variants.gradients == GradientSum::Slots).then(summed).transpose()?,
        })
    }
}

/// What all of them have in common.
#[derive(Clone, Copy)]
struct Form {
    count: bool,
    clamp_gradient_passes: bool,
    turn: (&'static str, u32),
}

/// Pipelines and buffers of the backward.
pub(super) struct Backward {
    colour: Channels,
    /// Where the renderer has the auxiliary channels.
    all: Option<Channels>,
    form: Form,
    pub(super) slot_grads: Buffer,
    /// A single entry where the auxiliary channels or the slots are off.
    pub(super) slot_normals: Buffer,
    /// A single entry where the auxiliary channels are off.
    pub(super) grad_normals: Buffer,
    /// Beginning of the buffer that the tile lists use before.
    pub(super) grad2d: BufferRange,
}

/// Gradients are those of models in 32 bits.
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
    pub(super) fn new(gpu: &Gpu, variants: Variants, size: &Size, grad2d: BufferRange) -> Result<Self, vk::Error> {
        let slots = variants.gradients == GradientSum::Slots;
        let form = Form {
            count: size.count,
            clamp_gradient_passes: size.clamp_gradient_passes,
            turn: per_turn(u64::from(size.tiles)),
        };
        let channels = |aux: bool| Channels::new(gpu, variants, None, aux, form);
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

    /// The pipelines for gradients of colour alone, or of all channels.
    fn channels(&self, aux: bool) -> &Channels {
        self.all.as_ref().filter(|_| aux).unwrap_or(&self.colour)
    }
}

impl Renderer {
    /// Gradients of a model from those of its image, after [`Self::record_forward`] of the same shot. Does nothing
    /// without a backward.
    pub fn record_backward(
        &self,
        recorder: &mut Recorder,
        lists: &Lists<'_>,
        gradients: &Gradients<'_>,
        shot: &Shot,
        target: &Target,
    ) -> Result<(), vk::Error> {
        self.record_blend_backward(recorder, lists, gradients.of_image, shot, target)?;
        let terms = Terms { aux: gradients.of_image.of_aux.is_some(), ..Terms::default() };
        self.record_project_backward_of(recorder, gradients.model, gradients.of_model, shot, terms)
    }

    /// Gradients of `model`, written to `of_model`, after [`Self::record_blend_backward`] of the same shot without
    /// auxiliary channels. Does nothing without a backward.
    pub fn record_project_backward(
        &self,
        recorder: &mut Recorder,
        model: &Planes,
        of_model: &Planes,
        shot: &Shot,
    ) -> Result<(), vk::Error> {
        self.record_project_backward_of(recorder, model, of_model, shot, Terms::default())
    }

    /// The same with terms beyond the colour's.
    pub fn record_project_backward_of(
        &self,
        recorder: &mut Recorder,
        model: &Planes,
        of_model: &Planes,
        shot: &Shot,
        terms: Terms,
    ) -> Result<(), vk::Error> {
        all_bits(model)?;
        let Some(backward) = &self.backward else { return Ok(()) };
        let constants = [
            ("AUX", u32::from(terms.aux && self.with_aux)),
            ("FLATTEN", terms.flatten.to_bits()),
            ("ADD", u32::from(terms.add)),
            ("SHRINK", terms.shrink.to_bits()),
        ];
        let pipeline = self.gpu.pipeline(&project_backward::PASS.kernel, &constants)?;
        let push = CameraPush::new(&shot.camera, &shot.projection);
        let [counts, splat2d, tile_counts, grad_normals] =
            slices([&self.counters, &self.splat2d, &self.tile_counts, &backward.grad_normals]);
        let mut buffers = vec![counts];
        buffers.extend(model.buffers().iter().map(BufferSlice::from));
        buffers.extend([splat2d, tile_counts, backward.grad2d.slice(), grad_normals]);
        buffers.extend(of_model.buffers().iter().map(BufferSlice::from));
        recorder.dispatch(&pipeline, &buffers, &push, self.per_splat())
    }

    /// One optimiser step, after [`Self::record_blend_backward`] of the same shot: what gradients of the model and the
    /// optimiser would do, without gradients in memory. Does nothing without a backward.
    pub fn record_backward_step(
        &self,
        recorder: &mut Recorder,
        step: &BackwardStep<'_>,
        shot: &Shot,
    ) -> Result<(), vk::Error> {
        all_bits(step.model)?;
        let Some(backward) = &self.backward else { return Ok(()) };
        let camera = CameraPush::new(&shot.camera, &shot.projection);
        let push = project_backward_adam::Push::new(&camera, step.settings, step.rates, step.steps);
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

    /// Gradients of the projected splats ([`Self::grad2d`], and the normals' with auxiliary channels) from those of the
    /// image, after [`Self::record_forward`] of the same shot. Does nothing without a backward.
    pub fn record_blend_backward<'a>(
        &self,
        recorder: &mut Recorder,
        lists: &Lists<'_>,
        gradients: impl Into<ImageGradients<'a>>,
        shot: &Shot,
        target: &Target,
    ) -> Result<(), vk::Error> {
        let Some(backward) = &self.backward else { return Ok(()) };
        let ImageGradients { of_image, of_aux } = gradients.into();
        let of_aux = of_aux.filter(|_| self.with_aux);
        let aux = of_aux.is_some();
        let channels = match shot.projection.alpha_cutoff {
            cutoff @ Some(_) => Channels::new(&self.gpu, self.variants, cutoff, aux, backward.form)?,
            None => backward.channels(aux).clone(),
        };
        let (width, height) = (shot.camera.width, shot.camera.height);
        let push = shot.blend_push();
        // Without the auxiliary channels other buffers stand for what is not read; what is not written has its own.
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
        let groups = Groups::Workgroups(self.tiles(width, height));
        if let (Some(slot_sum), Some(slots)) = (&channels.slot_sum, &lists.slots) {
            buffers.extend([slots.sorted_slots, slot_grads, slot_normals, counted]);
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
            recorder.dispatch(&channels.blend, &buffers, &push, groups)
        }
    }

    /// Gradients of the projected splats; `None` without a backward.
    pub fn grad2d(&self) -> Option<BufferSlice<'_>> {
        self.backward.as_ref().map(|b| b.grad2d.slice())
    }

    /// Gradients of the projected splats' normals, a vec4 each; `None` without a backward of auxiliary channels.
    pub fn grad_normals(&self) -> Option<&Buffer> {
        self.backward.as_ref().filter(|_| self.with_aux).map(|b| &b.grad_normals)
    }
}
