//! Views that a step looks at beside its own: windows of them, for the perceptual distance.

use super::Engine;
use crate::losses;
use crate::train::Error;
use crate::train::learning::exposures::Turn;
use crate::train::schedule::{Adam, StepPlan};
use crate::vk::Recorder;

/// Bytes of a pixel of an image.
const PIXEL: u64 = 16;

impl Engine {
    /// Records the gradients of the model for the views that a step looks at beside its own, of which only the windows are rendered; gives
    /// whether there are any. To be followed by the step's own view.
    pub(super) fn record_beside(&self, recorder: &mut Recorder, plan: &StepPlan) -> Result<bool, Error> {
        let (Some(perceptual), Some(step)) = (&self.perceptual, plan.perceptual) else { return Ok(false) };
        if plan.adam == Adam::None {
            return Ok(false);
        }
        let (renderer, of_image) = (&self.renderer, self.losses.grad_image());
        let mut first = true;
        for other in step.beside() {
            let camera = self.cameras.get(other.view).ok_or(Error::NoViews)?;
            // Not where the step's own photograph comes to.
            let landing = self.recorded + 1;
            let photograph = self.photographs.record(&self.gpu, recorder, (other.view, plan.step), None, landing)?;
            let compared = losses::Photograph {
                buffer: photograph.buffer,
                bits: photograph.depth.bits(),
                size: (camera.width, camera.height),
                values: photograph.values,
                mask: None,
            };
            let Some(window) = perceptual.window(&compared, self.center(other.view, other.seen)) else { continue };
            let shot = self.shot(*camera, plan).window(window.at, (window.side, window.side));
            let lists = renderer.record_forward(recorder, &self.model, &shot, &self.target, false)?;
            let pixels = window.side * window.side;
            let turn = Turn { view: other.view, pixels, known: self.known(plan), seen: other.seen, rate: 0.0 };
            let image = &self.target.image;
            let shown = match &self.exposures {
                Some(exposures) => exposures.record_apply(recorder, image, turn)?,
                None => image,
            };
            recorder.fill(of_image.slice(0..PIXEL * u64::from(pixels)), 0)?;
            perceptual.record(recorder, (shown, of_image), &compared, (window, true), step.times)?;
            if let Some(exposures) = &self.exposures {
                exposures.record_backward(recorder, image, of_image, turn, None)?;
            }
            renderer.record_blend_backward(recorder, &lists, of_image, &shot, &self.target)?;
            self.optimiser.record_beside(recorder, renderer, &self.model, &shot, first)?;
            first = false;
        }
        Ok(!first)
    }

    /// The middle of the window of a view that has been looked at so often, as a share of width and height: where its mask is rich.
    pub(super) fn center(&self, view: usize, seen: u32) -> [f32; 2] {
        self.saliencies.as_ref().map_or([0.5; 2], |saliencies| saliencies.place(view, seen))
    }
}
