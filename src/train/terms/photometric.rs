//! Colours of the exposed render against those of the photograph, in every step.

use super::{LossTerm, Phase, StepContext};
use crate::loss::{PhotometricLoss, PixelWeights};
use crate::raster::MemoryFootprint;
use crate::train::Error;
use crate::train::schedule::StepPlan;
use crate::train::settings::Settings;
use crate::vk::{self, Buffer, Gpu, Recorder};

/// The comparison with the weights of its pixels.
pub(in crate::train) struct Photometric {
    loss: PhotometricLoss,
    /// Weights of pixels with saliency 0 and 1 in the low-frequency stage, if they differ.
    of_low_stage: Option<[f32; 2]>,
}

impl Photometric {
    /// For images of the given sizes, `deep` if some photographs have 16 bits per channel.
    pub(super) fn new(gpu: &Gpu, sizes: &[(u32, u32)], deep: bool, settings: &Settings) -> Result<Self, vk::Error> {
        let frequencies = &settings.frequencies;
        let weighs = frequencies.low_stage > 0.0 && frequencies.low_texture_weight != 1.0;
        Ok(Self {
            loss: PhotometricLoss::new(gpu, sizes, deep, weighs, settings.optimiser.lambda_dssim)?,
            of_low_stage: weighs.then_some([1.0, frequencies.low_texture_weight as f32]),
        })
    }

    /// Weights of pixels with saliency 0 and 1 in a step; `None` if saliency does not matter.
    pub(super) fn weights_of(&self, plan: &StepPlan) -> Option<[f32; 2]> {
        self.of_low_stage.filter(|[low, high]| plan.low && high != low)
    }

    /// The gradient that every term writes to: a vec4 per pixel.
    pub(in crate::train) fn grad_image(&self) -> &Buffer {
        self.loss.grad_image()
    }

    /// Total, L1 and SSIM of the last recorded view.
    pub(in crate::train) fn result(&self) -> &Buffer {
        self.loss.result()
    }
}

impl LossTerm for Photometric {
    fn phases(&self) -> &'static [Phase] {
        &[Phase::AfterExposure]
    }

    fn due(&self, _: &StepContext<'_>) -> bool {
        true
    }

    fn record<'a>(&'a self, _: Phase, recorder: &mut Recorder, step: &mut StepContext<'a>) -> Result<(), Error> {
        let weights = step.saliency.zip(self.weights_of(step.plan));
        let weights = weights.map(|(saliency, of)| PixelWeights { saliency, of });
        Ok(self.loss.record(recorder, step.shown, &step.photograph, weights)?)
    }

    fn footprint(&self) -> MemoryFootprint {
        MemoryFootprint { pixels: self.loss.bytes(), ..MemoryFootprint::default() }
    }
}
