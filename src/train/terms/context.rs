//! Everything that the passes of one step need.

use crate::loss::Photograph;
use crate::raster::tiles::FrameLists;
use crate::raster::{ImageGradients, Part, Planes, RenderView, Renderer, Subset, Target};
use crate::train::density::StatisticsInput;
use crate::train::learning::exposures::{ExposureStep, Exposures};
use crate::train::learning::optimiser::Stepping;
use crate::train::schedule::StepPlan;
use crate::vk::{self, Buffer, Groups, Recorder};

/// A photograph that a step looks at, and everything needed to compare the photograph with a render. Made for the
/// step's own view and for each view beside it.
pub(in crate::train) struct StepContext<'a> {
    /// What the step does.
    pub(in crate::train) plan: &'a StepPlan,
    /// Index of the training view.
    pub(in crate::train) view: usize,
    pub(in crate::train) renderer: &'a Renderer,
    pub(in crate::train) model: &'a Planes,
    /// Identities of the model's splats.
    pub(in crate::train) ids: &'a Buffer,
    /// Image that the render is written to.
    pub(in crate::train) target: &'a Target,
    /// Camera of the render: of the whole photograph, reduced where the plan says so, or of a band of rows.
    pub(in crate::train) shot: RenderView,
    /// The first row of the band ...
    pub(in crate::train) top: u32,
    /// ... and the height of the photograph that the band belongs to.
    pub(in crate::train) of_height: u32,
    /// The part of the photograph that is rendered.
    pub(in crate::train) photograph: Photograph<'a>,
    /// Saliency of the pixels, if the step needs it.
    pub(in crate::train) saliency: Option<&'a Buffer>,
    /// Centre of the perceptual window as shares of width and height, where the saliency mask is high.
    pub(in crate::train) center: [f32; 2],
    pub(in crate::train) exposures: Option<&'a Exposures>,
    /// The exposure's part of the step; its pixels are replaced by those of `shot`.
    pub(in crate::train) turn: ExposureStep,
    /// The exposed render.
    pub(in crate::train) shown: &'a Buffer,
    /// Gradient of `shown`; after the backward pass of the exposure, gradient of the render.
    pub(in crate::train) grad_image: &'a Buffer,
    /// Gradient of depth and normals, if a term has written it.
    pub(in crate::train) grad_aux: Option<&'a Buffer>,
}

impl<'a> StepContext<'a> {
    /// Pixels that are rendered.
    pub(in crate::train) fn pixels(&self) -> u32 {
        self.shot.camera.width * self.shot.camera.height
    }

    /// Records the render, with depth and normals if `aux`.
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
        self.renderer.record_forward_of(
            recorder,
            self.model,
            &self.shot,
            self.target,
            false,
            Some(Subset { ids: self.ids, part: Part::Low }),
        )
    }

    /// Records applying the photograph's exposure, and returns the exposed render; the render itself where exposures
    /// are off.
    pub(in crate::train) fn record_exposed(&self, recorder: &mut Recorder) -> Result<&'a Buffer, vk::Error> {
        let (image, turn) = (&self.target.image, self.turn());
        self.exposures.map_or(Ok(image), |exposures| exposures.record_apply(recorder, image, turn))
    }

    /// Records turning the gradient of the exposed render into that of the render, and a step of the photograph's
    /// exposure in the workgroups of `learn`.
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

    /// What the statistics of density control need of the step.
    pub(in crate::train) fn statistics_input(&self) -> StatisticsInput<'_> {
        StatisticsInput {
            model: self.model,
            shot: &self.shot,
            of_height: self.of_height,
            image: self.shown,
            photograph: &self.photograph,
            saliency: self.saliency,
        }
    }

    /// Inputs of the optimiser: `stats` are the splats' statistics, `beside` says whether gradients of other views are
    /// already in memory.
    pub(in crate::train) fn stepping<'s>(&'s self, stats: &'s Buffer, beside: bool) -> Stepping<'s> {
        let Self { plan, renderer, model, shot, .. } = self;
        Stepping { plan, renderer, model, shot, stats, aux: self.grad_aux.is_some(), beside }
    }

    fn turn(&self) -> ExposureStep {
        ExposureStep { pixels: self.pixels(), ..self.turn }
    }
}
