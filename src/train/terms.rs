//! The terms of the loss. Each term has a file of its own, implements [`LossTerm`], and is a field of [`Terms`]; the
//! step knows no term by name.

mod constrained;
mod context;
mod geometry;
mod gradient_maps;
mod perceptual;
mod photometric;
mod sigma;

pub(super) use context::StepContext;
pub(super) use perceptual::Perceptual;

use std::sync::Arc;

use super::Error;
use super::input::Input;
use super::learning::sigma::{Landing, SigmaTraining, landings};
use super::schedule::StepPlan;
use super::settings::{Settings, SigmaLearning};
use super::state::State;
use crate::loss::GradientMapLoss;
use crate::raster::MemoryFootprint;
use crate::saliency::Cache;
use crate::scene::Camera;
use crate::vk::{self, Gpu, Recorder};

use constrained::Constrained;
use geometry::Geometry;
use gradient_maps::GradientMaps;
use photometric::Photometric;

/// When in a step a term records, in the order of the step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    /// Before the render of the step: target and image gradient are free for other renders.
    BeforeRender,
    /// After the render, with the photograph's exposure applied. The photometric term writes the gradient of the
    /// exposed render; later terms add to that gradient.
    AfterExposure,
    /// After the gradient was turned into that of the render. Terms that do not depend on the exposure add to it.
    AfterExposureBackward,
    /// After the gradients of the projected splats were computed and the statistics of growth taken from them. Terms
    /// add to the gradients of the projected splats.
    AfterBlendBackward,
}

/// A term of the loss, or something that learns from the images of a step.
pub(super) trait LossTerm {
    /// The phases in which the term records.
    fn phases(&self) -> &'static [Phase];

    /// Whether the step has the term.
    fn due(&self, step: &StepContext<'_>) -> bool;

    /// Whether the term reads depth and normals of the render.
    fn reads_aux(&self) -> bool {
        false
    }

    /// Records the term in one of its phases.
    fn record<'a>(&'a self, phase: Phase, recorder: &mut Recorder, step: &mut StepContext<'a>) -> Result<(), Error>;

    /// Bytes of the term's buffers.
    fn footprint(&self) -> MemoryFootprint;

    /// Reads the term's part of the state back. Waits.
    fn save(&self, _: &Gpu, _: &mut State) -> Result<(), Error> {
        Ok(())
    }

    /// Restores a state of [`Self::save`].
    fn restore(&mut self, _: &Gpu, _: &State) -> Result<(), Error> {
        Ok(())
    }
}

/// The terms of a training; `None` for terms that the settings leave out.
pub(super) struct Terms {
    /// Buffers of `sigma` until it is made.
    landings: Vec<Landing>,
    /// Learns the width of the saliency filter.
    pub(super) sigma: Option<SigmaTraining>,
    constrained: Option<Constrained>,
    /// Compares colours, in every step.
    pub(super) photometric: Photometric,
    gradient_maps: Option<GradientMaps>,
    /// Compares windows by a network.
    pub(super) perceptual: Option<Perceptual>,
    /// Compares depth and normals with priors.
    pub(super) geometry: Option<Geometry>,
}

/// All terms, in the order in which they record in each phase.
macro_rules! in_order {
    ($terms:ident, $as_ref:ident, $($borrow:tt)+) => {
        [
            $terms.sigma.$as_ref().map(|term| term as $($borrow)+ dyn LossTerm),
            $terms.constrained.$as_ref().map(|term| term as _),
            Some($($borrow)+ $terms.photometric as _),
            $terms.gradient_maps.$as_ref().map(|term| term as _),
            $terms.perceptual.$as_ref().map(|term| term as _),
            $terms.geometry.$as_ref().map(|term| term as _),
        ]
        .into_iter()
        .flatten()
    };
}

impl Terms {
    /// For views of these cameras and room for `splats` splats, with at most `in_flight` events in flight; `deep` if
    /// some photographs have 16 bits per channel.
    /// [`Self::fill`] adds what depends on the photographs' contents.
    pub(super) fn allocate(
        gpu: &Gpu,
        cameras: &[Camera],
        splats: u32,
        deep: bool,
        settings: &Settings,
        in_flight: usize,
    ) -> Result<Self, Error> {
        let sizes: Vec<(u32, u32)> = cameras.iter().map(|c| (c.width, c.height)).collect();
        let texture = &settings.texture;
        let maps = texture.wants_gradients().then(|| GradientMapLoss::new(gpu, &sizes)).transpose()?.map(Arc::new);
        let constrained = match &maps {
            Some(maps) if settings.wants_constrained() => {
                let pixels = sizes.iter().map(|(width, height)| width * height).max().unwrap_or(1);
                Some(Constrained::new(gpu, splats, pixels, maps.clone(), texture)?)
            }
            _ => None,
        };
        let geometry =
            settings.geometry.has_loss().then(|| Geometry::new(gpu, cameras, &settings.geometry)).transpose()?;
        let pixels = sizes.iter().map(|(width, height)| u64::from(*width) * u64::from(*height)).max().unwrap_or(1);
        Ok(Self {
            landings: landings(gpu, pixels, settings.frequencies.sigma_learning, in_flight)?,
            sigma: None,
            constrained,
            photometric: Photometric::new(gpu, &sizes, deep, settings)?,
            gradient_maps: maps.map(|maps| GradientMaps::new(maps, texture)),
            perceptual: None,
            geometry,
        })
    }

    fn all(&self) -> impl Iterator<Item = &dyn LossTerm> {
        in_order!(self, as_ref, &)
    }

    fn all_mut(&mut self) -> impl Iterator<Item = &mut dyn LossTerm> {
        in_order!(self, as_mut, &mut)
    }

    /// Makes what depends on the photographs' contents and on the optional inputs; `masks` are the saliency masks, if
    /// any.
    pub(super) fn fill(
        &mut self,
        gpu: &Gpu,
        input: &Input,
        settings: &Settings,
        masks: Option<Cache>,
    ) -> Result<(), Error> {
        let landings = std::mem::take(&mut self.landings);
        if let Some(masks) = masks.filter(|_| settings.frequencies.sigma_learning != SigmaLearning::Off) {
            let lumas = masks.images().cloned().collect();
            self.sigma = Some(SigmaTraining::new(&input.train, lumas, settings, landings)?);
        }
        if let Some(geometry) = &mut self.geometry {
            geometry.fill(gpu, &input.optional)?;
        }
        if settings.texture.lambda_perceptual > 0.0 {
            let smallest = input.train.iter().map(|v| v.camera.width.min(v.camera.height)).min().unwrap_or(1);
            self.perceptual =
                Some(Perceptual::new(gpu, input.optional.perceptual.as_deref(), smallest, &settings.texture)?);
        }
        Ok(())
    }

    /// Reads the terms' part of the state back. Waits.
    pub(super) fn save(&self, gpu: &Gpu, state: &mut State) -> Result<(), Error> {
        self.all().try_for_each(|term| term.save(gpu, state))
    }

    /// Restores a state of [`Self::save`].
    pub(super) fn restore(&mut self, gpu: &Gpu, state: &State) -> Result<(), Error> {
        self.all_mut().try_for_each(|term| term.restore(gpu, state))
    }

    /// The terms of a step.
    pub(super) fn due(&self, step: &StepContext<'_>) -> DueTerms<'_> {
        DueTerms(self.all().filter(|term| term.due(step)).collect())
    }

    /// Whether the photometric term weighs pixels by their saliency.
    pub(super) fn read_saliency(&self, plan: &StepPlan) -> bool {
        self.photometric.weights_of(plan).is_some()
    }

    /// Makes room for `splats` splats. Contents of buffers are lost; none outlives a step.
    pub(super) fn resize(&mut self, gpu: &Gpu, splats: u32) -> Result<(), vk::Error> {
        self.constrained.as_mut().map_or(Ok(()), |constrained| constrained.resize(gpu, splats))
    }

    /// Bytes of the terms' buffers.
    pub(super) fn footprint(&self) -> MemoryFootprint {
        self.all().map(LossTerm::footprint).fold(MemoryFootprint::default(), |sum, held| sum + held)
    }
}

/// The terms of one step.
pub(super) struct DueTerms<'a>(Vec<&'a dyn LossTerm>);

impl<'a> DueTerms<'a> {
    /// Records the terms of a phase.
    pub(super) fn record(
        &self,
        phase: Phase,
        recorder: &mut Recorder,
        step: &mut StepContext<'a>,
    ) -> Result<(), Error> {
        self.0
            .iter()
            .filter(|term| term.phases().contains(&phase))
            .try_for_each(|term| term.record(phase, recorder, step))
    }

    /// Whether some term reads depth and normals of the render.
    pub(super) fn read_aux(&self) -> bool {
        self.0.iter().any(|term| term.reads_aux())
    }
}
