//! Keeps renders for learning the width of the saliency filter. Adds nothing to the gradients.

use super::{LossTerm, Phase, StepContext};
use crate::raster::MemoryFootprint;
use crate::train::Error;
use crate::train::learning::sigma::SigmaTraining;
use crate::train::state::State;
use crate::vk::{Gpu, Recorder};

impl LossTerm for SigmaTraining {
    fn phases(&self) -> &'static [Phase] {
        &[Phase::BeforeRender, Phase::AfterExposure]
    }

    fn due(&self, step: &StepContext<'_>) -> bool {
        step.plan.learn_sigma
    }

    fn record<'a>(&'a self, phase: Phase, recorder: &mut Recorder, step: &mut StepContext<'a>) -> Result<(), Error> {
        let [full, low] = self.landing(step.plan.step);
        let (image, to) = match phase {
            Phase::BeforeRender if !self.wants_low() => return Ok(()),
            Phase::BeforeRender => {
                let _ = step.record_constrained_forward(recorder)?;
                (step.record_exposed(recorder)?, low)
            }
            _ => (step.shown, full),
        };
        Ok(recorder.copy(image, 0, to, 0, 16 * u64::from(step.pixels()))?)
    }

    fn save(&self, _: &Gpu, state: &mut State) -> Result<(), Error> {
        state.sigma = self.state()?;
        Ok(())
    }

    fn restore(&mut self, _: &Gpu, state: &State) -> Result<(), Error> {
        if state.sigma.is_empty() { Ok(()) } else { self.take_back(&state.sigma) }
    }

    /// The renders are kept in host memory.
    fn footprint(&self) -> MemoryFootprint {
        MemoryFootprint::default()
    }
}
