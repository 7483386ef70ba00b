//! Prepares everything that a training needs before its first step, and reports each stage as an event.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use super::{
    ExposureEvidence, FirstModel, StereoReport, compute_stereo_priors, decide_exposures, first, input_within,
    limit_growth, outline,
};
use crate::dataset::{Dataset, Role, Warning};
use crate::format::LeftOut;
use crate::perceptual::LpipsWeights;
use crate::scene::Gaussians;
use crate::train::memory::{HostMemory, HostPlan};
use crate::train::settings::StepsByNeed;
use crate::train::tune::{self, Tuned};
use crate::train::{Error, Input, MemoryPlan, Pacing, Part, Restart, Settings, chosen_variants};
use crate::vk::Gpu;

/// A stage of the preparation of a training.
#[derive(Debug)]
pub enum SetupEvent<'a> {
    /// Some records of the model of `init` cannot be used.
    ModelLeftOut(&'a LeftOut),
    /// How the host's memory is shared.
    HostMemory(&'a HostPlan),
    /// A photograph does not take part.
    PhotographLeftOut(&'a Warning),
    /// The number of steps was left to the photographs, and is this.
    StepsChosen(&'a StepsByNeed),
    /// The perceptual loss has no weights of a network, and compares by oriented filters.
    NoPerceptualWeights,
    /// Stereo begins.
    StereoBegins {
        /// Photographs to train on.
        photographs: usize,
    },
    /// Depths were taken from stereo or a cloud.
    Depths {
        /// The depths found.
        found: &'a StereoReport,
        /// The settings of the training.
        settings: &'a Settings,
        /// Photographs to train on.
        photographs: usize,
    },
    /// Whether exposures are learned was left to the photographs, and is decided by this.
    ExposuresDecided(&'a ExposureEvidence),
    /// Growth is limited by the number of first splats.
    GrowthLimited {
        /// Most splats.
        most: u32,
    },
    /// The variants of the passes were chosen.
    Variants(&'a Tuned),
}

/// Inputs of the preparation of a training.
pub struct SetupRequest<'a> {
    /// The settings, checked.
    pub settings: &'a Settings,
    /// The dataset.
    pub dataset: &'a Dataset,
    /// The network's weights for the perceptual loss.
    pub weights: Option<Arc<LpipsWeights>>,
    /// The state of the interrupted run, if one is resumed.
    pub restart: Option<Restart>,
    /// The part of the scene to train; `None` is the whole scene.
    pub part: Option<Part>,
    /// Whether photographs are read again in each step even if memory could keep them.
    pub keep_no_photographs: bool,
    /// Folder in which timings of variants are kept between runs.
    pub cache: Option<&'a Path>,
}

/// A training that is ready for its first step.
pub struct Setup {
    /// The requested settings, completed by what depends on the photographs and the device.
    pub settings: Settings,
    /// Photographs, first splats and optional inputs.
    pub input: Input,
    /// The state of the interrupted run, if one is resumed.
    pub restart: Option<Restart>,
    /// How the host's memory is shared.
    pub host: HostPlan,
    /// The depths found.
    pub depths: StereoReport,
    /// Seconds that finding depths took.
    pub stereo_seconds: f64,
}

impl Setup {
    /// Prepares a training, and calls `tell` with every event when it happens.
    pub fn prepare(gpu: &Gpu, request: SetupRequest<'_>, tell: &mut dyn FnMut(SetupEvent<'_>)) -> Result<Self, Error> {
        let (dataset, weights, cache) = (request.dataset, request.weights.clone(), request.cache);
        let mut setup = Self::with_photographs(gpu, request, tell)?;
        setup.choose_steps(gpu, tell);
        setup.take_weights(weights, tell);
        setup.look_for_depths(gpu, dataset, tell)?;
        setup.add_background();
        match &setup.restart {
            // A resumed run has decided already.
            Some(restart) => setup.settings.optimiser.exposure = restart.exposure(setup.settings.optimiser.exposure),
            None => {
                setup.decide_by_photographs(dataset, tell)?;
                setup.choose_variants(gpu, cache, tell)?;
            }
        }
        Ok(setup)
    }

    /// Reads the photographs, keeps as many as host memory allows, and makes the first splats.
    fn with_photographs(
        gpu: &Gpu,
        request: SetupRequest<'_>,
        tell: &mut dyn FnMut(SetupEvent<'_>),
    ) -> Result<Self, Error> {
        let SetupRequest { settings, dataset, restart, part, keep_no_photographs, .. } = request;
        let FirstModel { splats: initial, uncoloured, left_out } = match &restart {
            // The checkpoint has the splats, and the file of the first model may be gone.
            Some(_) if settings.run.init.is_some() => {
                FirstModel { splats: Gaussians::default(), uncoloured: None, left_out: None }
            }
            _ => first(dataset, settings)?,
        };
        left_out.iter().for_each(|left_out| tell(SetupEvent::ModelLeftOut(left_out)));
        let splats = restart.as_ref().map_or(initial.len() as u32, |r| r.state.splats());
        let mut host = host_plan(gpu, dataset, settings, splats)?;
        host.check()?;
        if keep_no_photographs {
            host.share.keep = 0;
        }
        tell(SetupEvent::HostMemory(&host));
        let mut input = input_within(dataset, initial, host.share)?;
        input.optional.left_out.iter().for_each(|warning| tell(SetupEvent::PhotographLeftOut(warning)));
        // Checked before stereo, which takes long.
        if let Some(before) = restart.as_ref().and_then(|restart| restart.trained_on.as_ref()) {
            before.check_views(&input.train)?;
        }
        if let (Some(points), None) = (uncoloured, &restart) {
            points.take_colours(dataset, &mut input)?;
        }
        if let Some(part) = part {
            input.initial = part.inside(&input.initial);
            input.optional.part = Some(Arc::new(part));
        }
        if input.train.is_empty() && dataset.views_of(Role::Train).next().is_some() {
            return Err(Error::AllMasked { dataset: dataset.path.clone(), role: Role::Train });
        }
        let (settings, depths) = (settings.clone(), StereoReport::default());
        Ok(Self { settings, input, restart, host, depths, stereo_seconds: 0.0 })
    }

    /// Chooses the number of steps if the settings leave it to the photographs. A resumed run has chosen already.
    fn choose_steps(&mut self, gpu: &Gpu, tell: &mut dyn FnMut(SetupEvent<'_>)) {
        if self.restart.is_some() {
            return;
        }
        if let Some(chosen) = self.settings.choose_steps(self.input.train.len(), gpu.caps().kind) {
            tell(SetupEvent::StepsChosen(&chosen));
        }
    }

    /// Takes over the weights of the perceptual loss.
    fn take_weights(&mut self, weights: Option<Arc<LpipsWeights>>, tell: &mut dyn FnMut(SetupEvent<'_>)) {
        if self.settings.texture.lambda_perceptual > 0.0 && weights.is_none() {
            tell(SetupEvent::NoPerceptualWeights);
        }
        self.input.optional.perceptual = weights;
    }

    /// Takes depths from stereo or a cloud.
    fn look_for_depths(
        &mut self,
        gpu: &Gpu,
        dataset: &Dataset,
        tell: &mut dyn FnMut(SetupEvent<'_>),
    ) -> Result<(), Error> {
        let photographs = self.input.train.len();
        let begin = Instant::now();
        let matches = self.settings.needs_stereo();
        if matches {
            tell(SetupEvent::StereoBegins { photographs });
        }
        let from_points = self.is_from_points();
        self.depths =
            compute_stereo_priors(gpu, dataset, &mut self.input, &self.settings, &self.host.share, from_points)?;
        self.stereo_seconds = if matches || self.depths.views > 0 { begin.elapsed().as_secs_f64() } else { 0.0 };
        tell(SetupEvent::Depths { found: &self.depths, settings: &self.settings, photographs });
        Ok(())
    }

    /// Adds the background of a part to the first splats.
    fn add_background(&mut self) {
        if let (Some(part), None) = (&self.input.optional.part, &self.restart) {
            self.input.initial = part.with_background(&self.input.initial);
        }
    }

    /// Decides what the settings leave to the photographs: whether exposures are learned, and how many splats may grow.
    fn decide_by_photographs(&mut self, dataset: &Dataset, tell: &mut dyn FnMut(SetupEvent<'_>)) -> Result<(), Error> {
        if let Some(evidence) = decide_exposures(dataset, &self.input, &mut self.settings)? {
            tell(SetupEvent::ExposuresDecided(&evidence));
        }
        if let Some(most) = limit_growth(&self.input, &mut self.settings) {
            tell(SetupEvent::GrowthLimited { most });
        }
        Ok(())
    }

    /// Chooses the variants of the passes. Writes them into the settings if a repeated run needs them there: for a
    /// deterministic training, and if they were chosen by timing.
    fn choose_variants(
        &mut self,
        gpu: &Gpu,
        cache: Option<&Path>,
        tell: &mut dyn FnMut(SetupEvent<'_>),
    ) -> Result<(), Error> {
        let settings = &mut self.settings;
        let tuned = tune::tuned(gpu, &self.input, settings, cache)?;
        tell(SetupEvent::Variants(&tuned));
        if settings.run.deterministic || !tuned.is_by_capability() {
            settings.name_variants(tuned.variants);
        }
        Ok(())
    }

    /// Whether the first splats are made from the dataset's points and from the points that stereo adds.
    pub fn is_from_points(&self) -> bool {
        self.settings.run.init.is_none() && self.restart.is_none()
    }

    /// Number of splats that the training begins or goes on with.
    pub fn splats(&self) -> u32 {
        self.restart.as_ref().map_or(self.input.initial.len() as u32, |restart| restart.state.splats())
    }
}

/// How the training shares the host's memory.
fn host_plan(gpu: &Gpu, dataset: &Dataset, settings: &Settings, splats: u32) -> Result<HostPlan, Error> {
    let memory = HostMemory::new(settings.host.host_memory.map(|bytes| bytes.0));
    let (outline, variants) = (outline(dataset), chosen_variants(gpu, settings)?);
    let plan = MemoryPlan::of(gpu, &outline, settings, variants, Pacing::default(), splats)?;
    Ok(HostPlan::new(gpu, memory, dataset, &outline, &plan, settings))
}
