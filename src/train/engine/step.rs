//! Records a training step.

use super::Engine;
use crate::train::Error;
use crate::train::learning::exposures::ExposureStep;
use crate::train::photographs::Visit;
use crate::train::schedule::{Adam, StepPlan};
use crate::train::terms::{Phase, StepContext};
use crate::vk::{Buffer, Recorder};

impl Engine {
    /// Records a step. Returns the optimiser step up to which all splats were caught up, if they were.
    pub(super) fn record_step(
        &self,
        recorder: &mut Recorder,
        plan: &StepPlan,
        view: usize,
    ) -> Result<Option<u32>, Error> {
        let beside = self.record_beside(recorder, plan)?;
        let visit = Visit { view, step: plan.step, band: plan.band, recording: self.reports.recorded() };
        let mut step = self.look_at(recorder, plan, &visit, plan.seen)?;
        step.saliency = self.record_saliency(recorder, &step)?;
        let terms = self.terms.due(&step);

        terms.record(Phase::BeforeRender, recorder, &mut step)?;
        let lists = step.record_forward(recorder, terms.read_aux())?;
        step.shown = step.record_exposed(recorder)?;
        terms.record(Phase::AfterExposure, recorder, &mut step)?;

        let learn = (plan.adam != Adam::None).then(|| self.renderer.once());
        step.record_exposure_backward(recorder, learn)?;
        terms.record(Phase::AfterExposureBackward, recorder, &mut step)?;
        step.record_blend_backward(recorder, &lists)?;
        if plan.accumulate {
            self.statistics.record(recorder, &self.renderer, step.statistics_input())?;
        }
        terms.record(Phase::AfterBlendBackward, recorder, &mut step)?;

        let stepping = step.stepping(self.statistics.stats(), beside);
        let caught_up = self.optimiser.record(recorder, &stepping)?;
        self.optimiser.record_noise(recorder, &stepping, &self.ids)?;
        Ok(caught_up)
    }

    /// Records bringing a photograph to the device, and returns the context for comparing a render with it; `seen` is
    /// how often the photograph has been looked at.
    pub(super) fn look_at<'a>(
        &'a self,
        recorder: &mut Recorder,
        plan: &'a StepPlan,
        visit: &Visit,
        seen: u32,
    ) -> Result<StepContext<'a>, Error> {
        let view = visit.view;
        let (photograph, camera) = self.views.record(&self.gpu, recorder, visit, plan)?;
        let mut shot = self.shot(camera, plan);
        let mut top = 0;
        if let Some(band) = visit.band {
            let (first, rows) = band.rows(camera.height);
            shot = shot.window((0, first), (camera.width, rows));
            top = first;
        }
        let known = plan.step.div_ceil(self.settings.run.bands.max(1));
        Ok(StepContext {
            plan,
            view,
            renderer: &self.renderer,
            model: &self.model,
            ids: &self.ids,
            target: &self.target,
            shot,
            top,
            of_height: camera.height,
            photograph,
            saliency: None,
            center: self.views.center(view, seen),
            exposures: self.exposures.as_ref(),
            turn: ExposureStep { view, pixels: 0, known, seen, rate: plan.lr_exposure },
            shown: &self.target.image,
            grad_image: self.terms.photometric.grad_image(),
            grad_aux: None,
        })
    }

    /// Records the upload of the view's learned mask, and the saliency of the rendered pixels if the step needs it.
    fn record_saliency<'a>(
        &'a self,
        recorder: &mut Recorder,
        step: &StepContext<'_>,
    ) -> Result<Option<&'a Buffer>, Error> {
        let Some(saliencies) = &self.views.saliencies else { return Ok(None) };
        let learned = self.terms.sigma.as_ref().and_then(|sigma| sigma.mask(step.view, step.plan.step));
        if let (Some(bytes), Some(mask)) = (learned, saliencies.mask(step.view)) {
            recorder.upload(mask.buffer, 0, bytes)?;
        }
        let scored = step.plan.accumulate && self.statistics.scores().is_some();
        if !scored && !self.terms.read_saliency(step.plan) {
            return Ok(None);
        }
        saliencies.record(recorder, step.view, &step.shot.camera, step.top, step.of_height).map(Some)
    }
}
