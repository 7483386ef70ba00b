//! What one step is about.

use crate::loss::Photograph;
use crate::raster::tiles::FrameLists;
use crate::raster::{ImageGradients, Planes, RenderView, Renderer, Target};
use crate::train::density::Seen;
use crate::train::learning::exposures::{ExposureStep, Exposures};
use crate::train::learning::optimiser::Stepping;
use crate::train::schedule::StepPlan;
use crate::vk::{self, Buffer, Groups, Recorder};

/// A photograph that a step looks at, with all that takes part in comparing it with a render. Made once for the step's own view, and once for
/// each view beside it.
pub(in crate::train) struct StepContext<'a> {
    /// What the step does.
    pub(in crate::train) plan: &'a StepPlan,
    /// The view, by its position among those that are trained on.
    pub(in crate::train) view: usize,
    pub(in crate::train) renderer: &'a Renderer,
    pub(in crate::train) model: &'a Planes,
    /// Identities of the model's splats.
    pub(in crate::train) ids: &'a Buffer,
    /// What the render is written to.
    pub(in crate::train) target: &'a Target,
    /// What is rendered: the whole photograph, reduced where the plan says so, or a band of rows of it.
    pub(in crate::train) shot: RenderView,
    /// The first row of the band ...
    pub(in crate::train) top: u32,
    /// ... and the rows of the image that the band belongs to.
    pub(in crate::train) of_height: u32,
    /// The part of the photograph that is rendered.
    pub(in crate::train) photograph: Photograph<'a>,
    /// Saliency of the pixels, where the step needs it.
    pub(in crate::train) saliency: Option<&'a Buffer>,
    /// A place where the photograph's mask is rich, as shares of width and height.
    pub(in crate::train) center: [f32; 2],
    pub(in crate::train) exposures: Option<&'a Exposures>,
    /// The part of the view in learning exposures; the pixels are those of `shot`.
    pub(in crate::train) turn: ExposureStep,
    /// The render as the photograph would show it, once it is rendered.
    pub(in crate::train) shown: &'a Buffer,
    /// The gradient of `shown`; after the backward of the exposure that of the render.
    pub(in crate::train) grad_image: &'a Buffer,
    /// The gradient of depth and normals, where a term has written it.
    pub(in crate::train) grad_aux: Option<&'a Buffer>,
}

impl<'a> StepContext<'a> {
    /// Pixels that are rendered.
    pub(in crate::train) fn pixels(&self) -> u32 {
        self.shot.camera.width * self.shot.camera.height
    }

    /// Records the render, with depth and normals where `aux`.
    pub(in crate::train) fn record_forward(
        &self,
        recorder: &mut Recorder,
        aux: bool,
    ) -> Result<FrameLists<'a>, vk::Error> {
        self.renderer.record_forward(recorder, self.model, &self.shot, self.target, aux)
    }

    /// Records the render of the constrained set alone.
    pub(in crate::train) fn record_constrained_forward(
        &self,
        recorder: &mut Recorder,
    ) -> Result<FrameLists<'a>, vk::Error> {
        self.renderer.record_forward_of(recorder, self.model, &self.shot, self.target, false, Some(self.ids))
    }

    /// Records what is rendered as the photograph would show it, where exposures are learned, and gives that.
    pub(in crate::train) fn record_exposed(&self, recorder: &mut Recorder) -> Result<&'a Buffer, vk::Error> {
        let (image, turn) = (&self.target.image, self.turn());
        self.exposures.map_or(Ok(image), |exposures| exposures.record_apply(recorder, image, turn))
    }

    /// Records turning the gradient of the exposed render into that of the render, and a step of the photograph's exposure by as many
    /// workgroups as `learn` says.
    pub(in crate::train) fn record_exposure_backward(
        &self,
        recorder: &mut Recorder,
        learn: Option<Groups<'_>>,
    ) -> Result<(), vk::Error> {
        let Some(exposures) = self.exposures else { return Ok(()) };
        exposures.record_backward(recorder, &self.target.image, self.grad_image, self.turn(), learn)
    }

    /// Records the gradients of the projected splats from those of the image.
    pub(in crate::train) fn record_blend_backward(
        &self,
        recorder: &mut Recorder,
        lists: &FrameLists<'_>,
    ) -> Result<(), vk::Error> {
        let gradients = ImageGradients { of_image: self.grad_image, of_aux: self.grad_aux };
        self.renderer.record_blend_backward(recorder, lists, gradients, &self.shot, self.target)
    }

    /// What density control wants to know of the step.
    pub(in crate::train) fn seen(&self) -> Seen<'_> {
        Seen {
            model: self.model,
            shot: &self.shot,
            of_height: self.of_height,
            image: self.shown,
            photograph: &self.photograph,
            saliency: self.saliency,
        }
    }

    /// What the optimiser takes the step by: `stats` are the splats' statistics, `beside` says whether other views have had their part.
    pub(in crate::train) fn stepping<'s>(&'s self, stats: &'s Buffer, beside: bool) -> Stepping<'s> {
        let Self { plan, renderer, model, shot, .. } = self;
        Stepping { plan, renderer, model, shot, stats, aux: self.grad_aux.is_some(), beside }
    }

    fn turn(&self) -> ExposureStep {
        ExposureStep { pixels: self.pixels(), ..self.turn }
    }
}
