//! The device side of training: records and submits events, and reads their outcomes.

mod capacity;
mod cost;
mod density_step;
mod extra_views;
mod reports;
mod resize;
mod rows;
mod step;
mod streaming;
mod transfer;
mod views;

use reports::Reports;
use views::{Views, has_deep, mean_pixels, most_pixels};

use super::Error;
use super::density::{DensityControl, Statistics};
use super::input::Input;
use super::learning::exposures::Exposures;
use super::learning::optimiser::Optimiser;
use super::learning::sigma::SigmaUpdate;
use super::pacing::{Pacing, Residency};
use super::photographs::Photographs;
use super::schedule::{Event, Kind, StepPlan};
use super::settings::{Exposure, Growth, Settings};
use super::state::State;
use super::terms::Terms;
use crate::pass::camera::{NEAR, Projection};
use crate::pass::{counters, finish};
use crate::raster::sort::SortShape;
use crate::raster::{DENSITY_ENTRY, Planes, RenderView, Renderer, Size, Target, Variants, Viewer, most_splats};
use crate::scene::Camera;
use crate::stereo::Prior;
use crate::vk::{Buffer, DeviceKind, Gpu, Memory, Recorder, SubmitSync, Ticket};

/// Highest opacity after a reset.
const RESET_OPACITY: f64 = 0.01;

pub(super) use capacity::{Needs, PAIRS_PER_SPLAT};
pub use cost::MemoryCost;
pub(super) use rows::Appended;

/// Names of the buffers that grew, and their new capacities.
pub(super) type GrownCapacities = Vec<(&'static str, u64)>;

/// The device's report of a finished event.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The counters at the end of the event.
    pub counters: Vec<u32>,
    /// Loss of the step's view.
    pub loss: f32,
    /// Ticket of the event's submission.
    pub ticket: Ticket,
}

/// Density control with room for `splats` splats.
fn density_control(gpu: &Gpu, splats: u32, needs: &Needs) -> Result<DensityControl, Error> {
    let shape = SortShape::of(gpu.caps());
    Ok(DensityControl::new(gpu, splats, DENSITY_ENTRY, needs.extent, shape)?)
}

/// The settings, with `sh_share` raised to the share of splats with all harmonics in `state`. The share may have risen
/// after the choice of those splats, because other splats were dropped.
fn keep_sh_share(state: Option<&State>, settings: &Settings) -> Settings {
    let mut settings = settings.clone();
    if let Some(state) = state.filter(|state| settings.model.sh_share < 1.0 && state.splats() > 0) {
        let share = counters::full_rows(&state.counters) as f64 / f64::from(state.splats());
        settings.model.sh_share = settings.model.sh_share.max(share);
    }
    settings
}

/// Model, photographs, moments and statistics, with the passes that use them.
pub struct Engine {
    gpu: Gpu,
    renderer: Renderer,
    size: Size,
    model: Planes,
    optimiser: Optimiser,
    ids: Buffer,
    statistics: Statistics,
    target: Target,
    terms: Terms,
    exposures: Option<Exposures>,
    density: DensityControl,
    views: Views,
    reports: Reports,
    settings: Settings,
    needs: Needs,
    initial_splats: u32,
    most_splats: Option<u32>,
    viewer: Viewer,
}

/// Variants, state and first views of an engine.
pub(super) struct EngineStart<'a> {
    pub(super) variants: Variants,
    /// State of a resumed training, which replaces the initial model.
    pub(super) state: Option<State>,
    /// The views of the first steps, whose photographs are decoded first; may be empty.
    pub(super) first_views: &'a [usize],
}

impl Engine {
    /// Uploads photographs, priors and model. `state` replaces the initial model when a training is resumed.
    pub fn new(
        gpu: &Gpu,
        input: &Input,
        settings: &Settings,
        variants: Variants,
        pacing: Pacing,
        state: Option<State>,
    ) -> Result<Self, Error> {
        let start = EngineStart { variants, state, first_views: &[] };
        Self::new_prefetching(gpu, input, settings, pacing, start)
    }

    /// As [`Self::new`], with known views of the first steps, whose photographs are decoded meanwhile.
    pub(super) fn new_prefetching(
        gpu: &Gpu,
        input: &Input,
        settings: &Settings,
        pacing: Pacing,
        start: EngineStart<'_>,
    ) -> Result<Self, Error> {
        let EngineStart { variants, state, first_views } = start;
        let initial_splats = state.as_ref().map_or(input.initial.len() as u32, State::splats);
        let most_splats = most_splats(gpu);
        if initial_splats > most_splats {
            let (what, wanted, limit) = ("splats", u64::from(initial_splats), u64::from(most_splats));
            return Err(Error::TooMany { what, wanted, limit, remedy: "a smaller initial model" });
        }
        let settings = &keep_sh_share(state.as_ref(), settings);
        let needs = Needs::new(gpu, &input.outline(), settings, pacing)?;
        let first = if needs.residency == Residency::Streamed { first_views } else { &[] };
        let feed = Photographs::feed(&input.train, pacing, first);
        let (splats, pairs) = needs.at_start(variants, initial_splats, pacing)?;
        let photographs = needs.photographs(gpu, needs.residency)?;
        let mut engine = Self::allocate(gpu, photographs, &needs, variants, splats, pairs)?;
        engine.initial_splats = initial_splats;
        // The limit depends on the first model, so that a resumed training has the same limit.
        let first = input.initial.len() as u32;
        engine.most_splats = needs.most_splats(variants).map(|most| most.max(first).max(initial_splats));
        let fixed = input.optional.part.as_ref().and_then(|part| part.exposures_of(&input.train));
        if let Some((exposures, fixed)) = engine.exposures.as_mut().zip(fixed) {
            exposures.fix(&fixed);
        }
        engine.views.photographs.fill(gpu, &input.train, feed)?;
        let masks = engine.views.fill_masks(gpu, &input.train, settings, pacing)?;
        engine.terms.fill(gpu, input, settings, masks)?;
        match state {
            Some(state) => engine.restore(&state)?,
            None => engine.begin(&input.initial)?,
        }
        Ok(engine)
    }

    /// The cameras of the views, in their order.
    pub fn cameras(&self) -> &[Camera] {
        &self.views.cameras
    }

    /// All buffers and passes of a training, with room for `splats` splats and `pairs` pairs; contents undefined.
    pub(super) fn allocate(
        gpu: &Gpu,
        photographs: Photographs,
        needs: &Needs,
        variants: Variants,
        splats: u32,
        pairs: u32,
    ) -> Result<Self, Error> {
        let settings = &needs.settings;
        let views = Views::allocate(gpu, &needs.views, photographs, settings)?;
        let (cameras, deep) = (&views.cameras, has_deep(&needs.views));
        let (pixels, mean_pixels, side) = (most_pixels(cameras), mean_pixels(cameras), variants.tile.size());
        let tiles = cameras.iter().map(|c| c.width.div_ceil(side) * c.height.div_ceil(side)).max().unwrap_or(1);
        let exposures = match settings.optimiser.exposure {
            Exposure::Off | Exposure::Auto => None,
            Exposure::Affine => Some(Exposures::new(gpu, cameras.len(), pixels)?),
        };
        let aux = settings.geometry.has_loss();
        let listed = Optimiser::leaves_out(gpu, settings);
        let absolute = sums_absolute(settings, gpu.caps().kind);
        let size = Size { aux, listed, absolute, ..Size::training(splats, pairs, tiles) };
        Ok(Self {
            gpu: gpu.clone(),
            renderer: Renderer::new(gpu, variants, size)?,
            size,
            model: Planes::limited(gpu, "", splats, settings.model.sh_share)?,
            optimiser: Optimiser::new(gpu, splats, needs.extent, mean_pixels, settings)?,
            ids: gpu.buffer("ids", 4 * u64::from(splats), Memory::Device)?,
            statistics: Statistics::new(gpu, splats, deep, settings)?,
            target: Target::new(gpu, "", pixels, aux)?,
            terms: Terms::allocate(gpu, cameras, splats, deep, settings, needs.in_flight)?,
            exposures,
            density: density_control(gpu, splats, needs)?,
            views,
            reports: Reports::new(gpu)?,
            settings: settings.clone(),
            needs: needs.clone(),
            initial_splats: 0,
            most_splats: None,
            viewer: Viewer::new(gpu),
        })
    }

    /// Most splats that the device memory has room for; `None` if memory does not limit them.
    pub fn most_splats(&self) -> Option<u32> {
        self.most_splats
    }

    /// Most splats after growth: the number asked for, or the number that fits, whichever is less.
    pub fn limit(&self) -> Option<u32> {
        self.settings.density.max_splats.into_iter().chain(self.most_splats).min()
    }

    /// Seconds that making the saliency masks took.
    pub fn saliency_seconds(&self) -> f64 {
        self.views.saliency_seconds
    }

    /// Splats at the start of this run.
    pub fn initial_splats(&self) -> u32 {
        self.initial_splats
    }

    /// Whether some splats have no harmonics above degree 1.
    fn has_plain_splats(&self) -> bool {
        self.settings.model.sh_share < 1.0
    }

    /// Replaces the prior (depth and normals) of a view.
    pub(super) fn set_prior(&mut self, view: usize, prior: &Prior) -> Result<(), Error> {
        self.terms.geometry.as_mut().map_or(Ok(()), |geometry| geometry.set(&self.gpu, view, prior))
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The renderer of the training steps.
    pub fn renderer(&self) -> &Renderer {
        &self.renderer
    }

    /// The variants of the passes in use.
    pub fn variants(&self) -> Variants {
        self.renderer.variants()
    }

    /// Records and submits an event. Does not wait for the device; waits for a photograph only if it was not named
    /// ahead.
    pub fn submit(&mut self, event: Event, plan: &StepPlan, view: usize) -> Result<Ticket, Error> {
        self.submit_with(event, plan, view, SubmitSync::default())
    }

    /// As [`Self::submit`], with waits and signals of the host's timelines.
    pub fn submit_with(
        &mut self,
        event: Event,
        plan: &StepPlan,
        view: usize,
        order: SubmitSync<'_>,
    ) -> Result<Ticket, Error> {
        let label = match event.kind {
            Kind::Step => "step",
            Kind::Density => "density",
            Kind::Reset => "reset",
        };
        let mut recorder = self.gpu.recorder(label)?;
        self.record(&mut recorder, event, plan, view)?;
        let ticket = recorder.submit_with(order)?;
        Ok(self.submitted(ticket))
    }

    /// Submits a recording of [`Self::record`].
    pub fn submit_recorded(&mut self, recorder: Recorder) -> Result<Ticket, Error> {
        let ticket = recorder.submit()?;
        Ok(self.submitted(ticket))
    }

    fn submitted(&mut self, ticket: Ticket) -> Ticket {
        self.reports.submitted(ticket);
        ticket
    }

    /// Records an event. Call [`Self::submit_recorded`] next.
    pub fn record(&self, recorder: &mut Recorder, event: Event, plan: &StepPlan, view: usize) -> Result<(), Error> {
        let mut caught_up = None;
        match event.kind {
            Kind::Step => caught_up = self.record_step(recorder, plan, view)?,
            Kind::Density => self.record_density(recorder, event, plan)?,
            Kind::Reset => self.density.record_reset(recorder, &self.density_model(), RESET_OPACITY)?,
        }
        let constrain = u32::from(event.kind == Kind::Step && plan.constrain);
        let caught_up = caught_up.map_or(finish::NOT_CAUGHT_UP, |step| step & 0xffff);
        let push = finish::Push { event: event.number(), constrain, caught_up };
        self.reports.record(recorder, &self.renderer.counters, self.terms.photometric.result(), &push)
    }

    fn shot(&self, camera: Camera, plan: &StepPlan) -> RenderView {
        let projection = Projection {
            sh_degree: plan.sh_degree,
            near: NEAR,
            antialias: self.settings.model.antialias,
            reference_clamp: true,
            black_learns: self.settings.run.method.black_learns(),
            orthographic: false,
            limits: None,
            alpha_cutoff: plan.alpha_cutoff,
        };
        RenderView { camera, projection, background: plan.background }
    }

    /// Learns the saliency filter's width from a step that is done, if `plan` says so. Call it for the steps in their
    /// order.
    pub fn learn_sigma(&mut self, plan: &StepPlan, view: usize, by: Ticket) -> Result<Option<SigmaUpdate>, Error> {
        match self.terms.sigma.as_mut().filter(|_| plan.learn_sigma) {
            Some(sigma) => sigma.learn(&self.gpu, plan.step, view, by),
            None => Ok(None),
        }
    }

    /// The outcome of an event. Waits until the event is done.
    pub fn outcome(&mut self, ticket: Ticket) -> Result<Outcome, Error> {
        self.reports.outcome(&self.gpu, ticket)
    }
}

/// Whether the backward pass sums absolute gradients. Sampled growth tells by them which splats photographs see, also
/// where it goes by other gradients. On a CPU device the pass takes a tenth longer without them.
fn sums_absolute(settings: &Settings, kind: DeviceKind) -> bool {
    let density = &settings.density;
    density.absgrad || density.growth == Growth::Sampled || kind == DeviceKind::Cpu
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sampled_growth_has_the_sums_that_say_what_is_seen() {
        let sums = |growth: Growth, absgrad: bool| {
            let mut settings = Settings::default();
            (settings.density.growth, settings.density.absgrad) = (growth, absgrad);
            sums_absolute(&settings, DeviceKind::Discrete)
        };
        assert!(sums(Growth::Sampled, false) && sums(Growth::Threshold, true));
        assert!(!sums(Growth::Threshold, false) && !sums(Growth::Relocated, false));
        assert!(sums_absolute(&Settings::default(), DeviceKind::Cpu));
    }
}
