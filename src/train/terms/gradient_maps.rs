//! Gradient maps of the render against those of the photograph.

use std::sync::Arc;

use super::{LossTerm, Phase, StepContext};
use crate::loss::{GradientMapLoss, GradientMapWeights};
use crate::raster::MemoryFootprint;
use crate::train::Error;
use crate::train::settings::Texture;
use crate::vk::Recorder;

/// The comparison with its weights.
pub(in crate::train) struct GradientMaps {
    loss: Arc<GradientMapLoss>,
    /// Weights of the correlation and of the residual's total variation.
    weights: [f64; 2],
}

impl GradientMaps {
    /// With the weights of the settings.
    pub(in crate::train) fn new(loss: Arc<GradientMapLoss>, texture: &Texture) -> Self {
        Self { loss, weights: [texture.lambda_gradients, texture.lambda_variation] }
    }
}

impl LossTerm for GradientMaps {
    fn phases(&self) -> &'static [Phase] {
        &[Phase::AfterExposure]
    }

    fn due(&self, step: &StepContext<'_>) -> bool {
        step.plan.gradients.is_some()
    }

    fn record<'a>(&'a self, _: Phase, recorder: &mut Recorder, step: &mut StepContext<'a>) -> Result<(), Error> {
        let Some(times) = step.plan.gradients else { return Ok(()) };
        let [correlation, variation] = self.weights.map(|weight| (weight * times) as f32);
        let weights = GradientMapWeights { correlation, variation };
        Ok(self.loss.record(recorder, step.shown, &step.photograph, &weights, step.grad_image)?)
    }

    fn footprint(&self) -> MemoryFootprint {
        MemoryFootprint { pixels: self.loss.bytes(), ..MemoryFootprint::default() }
    }
}
