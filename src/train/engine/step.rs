//! The recording of a training step: render, losses, backward, statistics, optimiser.

use super::Engine;
use crate::losses::{self, GradientMapWeights};
use crate::raster::ImageGradients;
use crate::train::Error;
use crate::train::density::Seen;
use crate::train::learning::exposures::Turn;
use crate::train::learning::optimiser::Stepping;
use crate::train::photographs::Coarse;
use crate::train::schedule::{Adam, StepPlan};
use crate::train::terms::Weights;
use crate::vk::{Buffer, Recorder};

impl Engine {
    /// Gives the step of the optimiser with which every splat was caught up, where it was.
    pub(super) fn record_step(
        &self,
        recorder: &mut Recorder,
        plan: &StepPlan,
        view: usize,
    ) -> Result<Option<u32>, Error> {
        let beside = self.record_beside(recorder, plan)?;
        let whole = self.cameras.get(view).ok_or(Error::NoViews)?;
        let mut photograph =
            self.photographs.record(&self.gpu, recorder, (view, plan.step), plan.band, self.recorded)?;
        let mut camera = *whole;
        let mut top = 0;
        if let (Some(coarse), 2..) = (&self.coarse, plan.factor) {
            photograph = coarse.record(recorder, whole, &photograph, plan.factor)?;
            camera = Coarse::camera(whole, plan.factor);
        }
        let of_height = camera.height;
        let mut shot = self.shot(camera, plan);
        if let Some(band) = plan.band {
            let (first, rows) = band.rows(camera.height);
            shot = shot.window((0, first), (camera.width, rows));
            (camera, top) = (shot.camera, first);
        }
        if let (Some(sigma), Some(saliencies)) = (&self.sigma, &self.saliencies)
            && let (Some(bytes), Some(mask)) = (sigma.mask(view, plan.step), saliencies.mask(view))
        {
            recorder.upload(mask.buffer, 0, bytes)?;
        }
        let learned = self.sigma.as_ref().filter(|_| plan.learn_sigma);
        let of = [1.0, self.settings.frequencies.low_texture_weight as f32];
        let weighted = plan.low && of[1] != 1.0;
        let scored = plan.accumulate && self.statistics.scores().is_some();
        let saliency = match &self.saliencies {
            Some(saliencies) if weighted || scored => {
                Some(saliencies.record(recorder, view, &camera, (top, of_height))?)
            }
            _ => None,
        };
        let renderer = &self.renderer;
        let geometry = self.geometry.as_ref().zip(plan.geometry).filter(|(geometry, _)| geometry.knows(view));
        let compared = losses::Photograph {
            buffer: photograph.buffer,
            bits: photograph.depth.bits(),
            size: (camera.width, camera.height),
            values: photograph.values,
            mask: self.saliencies.as_ref().and_then(|saliencies| saliencies.mask(view)),
        };
        let of_image = self.losses.grad_image();
        let texture = &self.settings.texture;
        let (pixels, known) = (camera.width * camera.height, self.known(plan));
        let turn = Turn { view, pixels, known, seen: plan.seen, rate: plan.lr_exposure };
        let image = &self.target.image;
        if let Some(sigma) = learned.filter(|sigma| sigma.wants_low()) {
            let _ = renderer.record_forward_of(recorder, &self.model, &shot, &self.target, false, Some(&self.ids))?;
            let low = self.exposed(recorder, image, turn)?;
            sigma.record(recorder, (plan.step, &camera, true), low)?;
        }
        let maps = self.gradient_maps.as_ref().zip(plan.gradients);
        let alone = self.constrained.as_ref().zip(maps).filter(|_| texture.lambda_constrained > 0.0);
        if let Some((constrained, (maps, times))) = alone {
            let weight = (texture.lambda_constrained * times) as f32;
            let (model, at) = ((&self.model, &self.ids), (&shot, &self.target));
            constrained.record(recorder, renderer, model, at, (maps, &compared, weight), of_image)?;
        }
        let lists = renderer.record_forward(recorder, &self.model, &shot, &self.target, geometry.is_some())?;
        let shown = self.exposed(recorder, image, turn)?;
        let weights = saliency.filter(|_| weighted).map(|saliency| Weights { saliency, of });
        if let Some(sigma) = learned {
            sigma.record(recorder, (plan.step, &camera, false), shown)?;
        }
        self.losses.record(recorder, shown, &photograph, weights, (camera.width, camera.height))?;
        if let Some((maps, times)) = maps {
            let [correlation, variation] =
                [texture.lambda_gradients, texture.lambda_variation].map(|weight| (weight * times) as f32);
            let weights = GradientMapWeights { correlation, variation };
            maps.record(recorder, shown, &compared, &weights, of_image)?;
        }
        if let (Some(perceptual), Some(step)) = (&self.perceptual, plan.perceptual)
            && let Some(window) = perceptual.window(&compared, self.center(view, plan.seen))
        {
            perceptual.record(recorder, (shown, of_image), &compared, (window, false), step.times)?;
        }
        if let Some(exposures) = &self.exposures {
            let once = (plan.adam != Adam::None).then(|| renderer.once());
            exposures.record_backward(recorder, image, of_image, turn, once)?;
        }
        let of_aux = match geometry {
            Some((geometry, times)) => {
                Some(geometry.record(recorder, &self.target, &compared, (view, times), of_image)?)
            }
            None => None,
        };
        let gradients = ImageGradients { of_image, of_aux };
        renderer.record_blend_backward(recorder, &lists, gradients, &shot, &self.target)?;
        if plan.accumulate {
            let seen =
                Seen { model: &self.model, shot: &shot, of_height, image: shown, photograph: &photograph, saliency };
            self.statistics.record(recorder, renderer, seen)?;
        }
        if let Some((constrained, _)) = alone {
            constrained.record_add(recorder, renderer)?;
        }
        let stepping = Stepping { model: &self.model, stats: self.statistics.stats(), shot: &shot };
        Ok(self.optimiser.record(recorder, renderer, stepping, plan, (of_aux.is_some(), beside))?)
    }
    /// Records the render as the photograph would show it, where exposures are learned; else it is that already.
    fn exposed<'a>(&'a self, recorder: &mut Recorder, image: &'a Buffer, turn: Turn) -> Result<&'a Buffer, Error> {
        match &self.exposures {
            Some(exposures) => Ok(exposures.record_apply(recorder, image, turn)?),
            None => Ok(image),
        }
    }
}
