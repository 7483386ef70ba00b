//! Windows of views that a step looks at beside its own, for the perceptual distance.

use super::Engine;
use crate::train::Error;
use crate::train::photographs::Visit;
use crate::train::schedule::{Adam, StepPlan};
use crate::vk::Recorder;

/// Bytes of a pixel of an image.
const PIXEL: u64 = 16;

impl Engine {
    /// Records the gradients of the model for windows of the views that a step looks at beside its own. Returns whether
    /// there are any. Record the step's own view next.
    pub(super) fn record_beside(&self, recorder: &mut Recorder, plan: &StepPlan) -> Result<bool, Error> {
        let (Some(perceptual), Some(planned)) = (&self.terms.perceptual, plan.perceptual) else { return Ok(false) };
        if plan.adam == Adam::None {
            return Ok(false);
        }
        let mut first = true;
        for other in planned.beside() {
            // Another landing than that of the step's own photograph.
            let recording = self.reports.recorded() + 1;
            let visit = Visit { view: other.view, step: plan.step, band: None, recording };
            let mut step = self.look_at(recorder, plan, &visit, other.seen)?;
            let Some(window) = perceptual.window(&step) else { continue };
            step.shot = step.shot.window(window.at, (window.side, window.side));
            let lists = step.record_forward(recorder, false)?;
            step.shown = step.record_exposed(recorder)?;
            recorder.fill(step.grad_image.slice(0..PIXEL * u64::from(step.pixels())), 0)?;
            perceptual.record_window(recorder, &step, window, true)?;
            step.record_exposure_backward(recorder, None)?;
            step.record_blend_backward(recorder, &lists)?;
            self.optimiser.record_beside(
                recorder,
                &self.renderer,
                &self.model,
                &step.shot,
                self.optimiser.terms_beside(plan, first),
            )?;
            first = false;
        }
        Ok(!first)
    }
}
