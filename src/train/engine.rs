//! The device side of training: records an event, submits it, and later tells what came of it.

use std::collections::VecDeque;

use super::Error;
use super::cost::MemoryCost;
use super::density::{self, DensityControl, DensityRules, Scratch};
use super::event::{Event, Kind};
use super::exposures::{self, ExposureMatrix, Exposures, Turn};
use super::input::{Input, View};
use super::losses::Losses;
use super::memory::Needs;
use super::optimiser::Optimiser;
use super::schedule::{Adam, StepPlan};
use super::settings::{Exposure, Settings};
use super::state::State;
use super::trainer::Pacing;
use crate::pass::camera::{NEAR, Projection};
use crate::pass::{counters, densify_stats, finish, loss};
use crate::raster::{
    DENSITY_ENTRY, Held, LiveModel, Picture, Planes, Renderer, Shot, Size, Target, Variants, Viewer, gaussians_of,
    grown, most_pairs, most_splats,
};
use crate::scene::{Camera, Gaussians};
use crate::vk::{Buffer, Gpu, Groups, Memory, Pipeline, Recorder, SubmitOrder, Ticket, slices};

/// Bytes of a slot of the read-back ring, which holds a report of `finish`: as much as any device aligns bindings to.
const RING_SLOT: u64 = 256;
/// Slots; more than events ever in flight.
const RING_SLOTS: u64 = 64;
/// Most events in flight.
pub(super) const MOST_IN_FLIGHT: usize = 32;
/// Opacity to which a reset lowers.
const RESET_OPACITY: f64 = 0.01;

/// What grew, and its new capacity.
pub(super) type Growth = Vec<(&'static str, u64)>;

/// What the device says of a finished event.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The counters at the end of the event.
    pub counters: Vec<u32>,
    /// Loss of the step's view.
    pub loss: f32,
}

/// Model, photographs, moments, statistics and the passes that work on them.
pub struct Engine {
    gpu: Gpu,
    renderer: Renderer,
    size: Size,
    model: Planes,
    optimiser: Optimiser,
    ids: Buffer,
    stats: Buffer,
    target: Target,
    losses: Losses,
    exposures: Option<Exposures>,
    density: DensityControl,
    accumulate: Pipeline,
    finish: Pipeline,
    ring: Buffer,
    next_slot: u64,
    slots: VecDeque<(Ticket, u64)>,
    cameras: Vec<Camera>,
    photographs: Vec<Photograph>,
    antialias: bool,
    settings: Settings,
    extent: f64,
    initial_splats: u32,
    most_splats: Option<u32>,
    needs: Needs,
    last: Option<Ticket>,
    viewer: Viewer,
}

impl Engine {
    /// Uploads everything. `state` replaces the initial model when a training goes on.
    pub fn new(
        gpu: &Gpu,
        input: &Input,
        settings: &Settings,
        variants: Variants,
        pacing: Pacing,
        state: Option<State>,
    ) -> Result<Self, Error> {
        let initial_splats = state.as_ref().map_or(input.initial.len() as u32, State::splats);
        let most_splats = most_splats(gpu);
        if initial_splats > most_splats {
            let (what, wanted, limit) = ("splats", u64::from(initial_splats), u64::from(most_splats));
            return Err(Error::TooMany { what, wanted, limit, remedy: "a smaller initial model" });
        }
        let needs = Needs::new(gpu, input, settings);
        let capacities = needs.at_start(variants, initial_splats, pacing)?;
        let photographs = needs.photographs(gpu)?;
        let cameras: Vec<Camera> = input.train.iter().map(|v| v.camera).collect();
        let mut engine = Self::allocate(gpu, &cameras, photographs, &needs, variants, capacities)?;
        engine.initial_splats = initial_splats;
        // The same for a resumed training: of the first model, not of the restored one.
        let first = input.initial.len() as u32;
        engine.most_splats = needs.most_splats(variants).map(|most| most.max(first).max(initial_splats));
        for (view, photograph) in input.train.iter().zip(&mut engine.photographs) {
            photograph.values = upload(gpu, view, &photograph.pixels)?;
        }
        match state {
            Some(state) => engine.restore(&state)?,
            None => engine.begin(&input.initial)?,
        }
        Ok(engine)
    }

    /// Everything that a training holds, with room for (splats, pairs); contents undefined.
    pub(super) fn allocate(
        gpu: &Gpu,
        cameras: &[Camera],
        photographs: Vec<Buffer>,
        needs: &Needs,
        variants: Variants,
        (splats, pairs): (u32, u32),
    ) -> Result<Self, Error> {
        let side = variants.tile.size();
        let sizes: Vec<(u32, u32)> = cameras.iter().map(|c| (c.width, c.height)).collect();
        let pixels = sizes.iter().map(|(w, h)| w * h).max().unwrap_or(1);
        let tiles = sizes.iter().map(|(w, h)| w.div_ceil(side) * h.div_ceil(side)).max().unwrap_or(1);
        let exposures = match needs.settings.optimiser.exposure {
            Exposure::Off => None,
            Exposure::Affine => Some(Exposures::new(gpu, cameras.len(), pixels)?),
        };
        let size = Size { splats, pairs, tiles, aux: false, train: true, count: false, clamp_gradient_passes: true };
        Ok(Self {
            gpu: gpu.clone(),
            renderer: Renderer::new(gpu, variants, size)?,
            size,
            model: Planes::new(gpu, "", splats)?,
            optimiser: Optimiser::new(gpu, splats, needs.extent, &needs.settings.shortcuts)?,
            ids: gpu.buffer("ids", 4 * u64::from(splats), Memory::Device)?,
            stats: gpu.buffer("stats", 16 * u64::from(splats), Memory::Device)?,
            target: Target::new(gpu, "", pixels, false)?,
            losses: Losses::new(gpu, &sizes, needs.settings.optimiser.lambda_dssim)?,
            exposures,
            density: DensityControl::new(gpu, splats, DENSITY_ENTRY)?,
            accumulate: gpu.pipeline(&densify_stats::PASS.kernel, &[])?,
            finish: gpu.pipeline(&finish::PASS.kernel, &[])?,
            ring: gpu.buffer("ring", RING_SLOT * RING_SLOTS, Memory::Readback)?,
            next_slot: 0,
            slots: VecDeque::new(),
            cameras: cameras.to_vec(),
            photographs: photographs.into_iter().map(|pixels| Photograph { pixels, values: 0.0 }).collect(),
            antialias: needs.settings.model.antialias,
            settings: needs.settings.clone(),
            extent: needs.extent,
            initial_splats: 0,
            most_splats: None,
            needs: needs.clone(),
            last: None,
            viewer: Viewer::new(gpu),
        })
    }

    /// Most splats that the device memory has room for, where that is what limits them.
    pub fn most_splats(&self) -> Option<u32> {
        self.most_splats
    }

    /// Splats at the start of this run.
    pub fn initial_splats(&self) -> u32 {
        self.initial_splats
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The renderer of the training steps.
    pub fn renderer(&self) -> &Renderer {
        &self.renderer
    }

    /// The variant set in use.
    pub fn variants(&self) -> Variants {
        self.renderer.variants()
    }

    fn begin(&mut self, initial: &Gaussians) -> Result<(), Error> {
        let n = initial.len() as u32;
        self.model.write(&self.gpu, initial)?;
        if n > 0 {
            self.gpu.write(&self.ids, &initial.ids)?;
        }
        let mut recorder = self.gpu.recorder("begin")?;
        self.optimiser.clear(&mut recorder)?;
        recorder.fill(&self.stats, 0)?;
        if let Some(exposures) = &self.exposures {
            exposures.clear(&mut recorder)?;
        }
        let mut words = vec![0u32; counters::COUNT];
        words[counters::SPLATS] = n;
        words[counters::NEXT_ID] = initial.ids.last().map_or(0, |id| id + 1);
        recorder.upload(&self.renderer.counters, 0, bytemuck::cast_slice(&words))?;
        self.last = Some(recorder.submit()?);
        Ok(())
    }

    fn restore(&mut self, state: &State) -> Result<(), Error> {
        self.model.write_rows(&self.gpu, &state.params)?;
        self.optimiser.restore(&self.gpu, &state.moments)?;
        if !state.ids.is_empty() {
            self.gpu.write(&self.ids, &state.ids)?;
            self.gpu.write(&self.stats, &state.stats)?;
        }
        if let Some(exposures) = &self.exposures {
            exposures.restore(&self.gpu, &state.exposures)?;
        }
        self.gpu.write(&self.renderer.counters, &state.counters)?;
        Ok(())
    }

    /// Records and submits an event; waits for nothing.
    pub fn submit(&mut self, event: Event, plan: &StepPlan, view: usize) -> Result<Ticket, Error> {
        self.submit_with(event, plan, view, SubmitOrder::default())
    }

    /// The same between points of a host's timelines.
    pub fn submit_with(
        &mut self,
        event: Event,
        plan: &StepPlan,
        view: usize,
        order: SubmitOrder<'_>,
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
        self.slots.push_back((ticket, self.next_slot));
        while self.slots.len() as u64 >= RING_SLOTS {
            self.slots.pop_front();
        }
        self.next_slot = (self.next_slot + 1) % RING_SLOTS;
        self.last = Some(ticket);
        ticket
    }

    /// Records an event. To be followed by [`Self::submit_recorded`].
    pub fn record(&self, recorder: &mut Recorder, event: Event, plan: &StepPlan, view: usize) -> Result<(), Error> {
        match event.kind {
            Kind::Step => self.record_step(recorder, plan, view)?,
            Kind::Density => self.record_density(recorder, event, plan)?,
            Kind::Reset => self.density.record_reset(recorder, &self.density_model(), RESET_OPACITY)?,
        }
        let push = finish::Push { event: event.number() };
        let at = RING_SLOT * self.next_slot;
        let slot = self.ring.slice(at..at + RING_SLOT);
        let buffers = [(&self.renderer.counters).into(), self.losses.result().into(), slot];
        recorder.dispatch(&self.finish, &buffers, &push, Groups::Workgroups(1))?;
        Ok(())
    }

    fn shot(&self, camera: Camera, plan: &StepPlan) -> Shot {
        let projection =
            Projection { sh_degree: plan.sh_degree, near: NEAR, antialias: self.antialias, reference_clamp: true };
        Shot { camera, projection, background: plan.background }
    }

    fn record_step(&self, recorder: &mut Recorder, plan: &StepPlan, view: usize) -> Result<(), Error> {
        let (Some(camera), Some(photograph)) = (self.cameras.get(view), self.photographs.get(view)) else {
            return Err(Error::NoViews);
        };
        let renderer = &self.renderer;
        let shot = self.shot(*camera, plan);
        let lists = renderer.record_forward(recorder, &self.model, &shot, &self.target, false)?;
        let turn = Turn { view, pixels: camera.width * camera.height, seen: plan.seen, rate: plan.lr_exposure };
        let image = &self.target.image;
        let shown = match &self.exposures {
            Some(exposures) => exposures.record_apply(recorder, image, turn)?,
            None => image,
        };
        let (width, height) = (camera.width, camera.height);
        self.losses.record(recorder, shown, &photograph.pixels, width, height, photograph.values)?;
        if let Some(exposures) = &self.exposures {
            let once = (plan.adam != Adam::None).then(|| renderer.once());
            exposures.record_backward(recorder, image, self.losses.grad_image(), turn, once)?;
        }
        renderer.record_blend_backward(recorder, &lists, self.losses.grad_image(), &shot, &self.target)?;
        if let (true, Some(grad2d)) = (plan.accumulate, renderer.grad2d()) {
            let push =
                densify_stats::Push { half_width: 0.5 * camera.width as f32, half_height: 0.5 * camera.height as f32 };
            let [counts, tile_counts, splat2d, stats] =
                slices([&renderer.counters, &renderer.tile_counts, &renderer.splat2d, &self.stats]);
            let buffers = [counts, tile_counts, splat2d, grad2d, stats];
            recorder.dispatch(&self.accumulate, &buffers, &push, renderer.per_splat())?;
        }
        self.optimiser.record(recorder, renderer, &self.model, &shot, plan)?;
        Ok(())
    }

    fn record_density(&self, recorder: &mut Recorder, event: Event, plan: &StepPlan) -> Result<(), Error> {
        let density = &self.settings.density;
        // A change at most doubles the splats: a limit beyond that costs a pass and changes nothing.
        let near = self.most_splats.filter(|most| self.size.splats.saturating_mul(2) > *most);
        let rules = DensityRules {
            clone_threshold: density.grad_threshold as f32,
            split_threshold: density.grad_threshold as f32,
            split_absolute: false,
            split_scale: density.percent_dense * self.extent,
            prune_opacity: density.prune_opacity,
            prune_scale: plan.densify.is_some_and(|d| d.prune_large).then_some(density.prune_extent * self.extent),
            max_splats: density.max_splats.into_iter().chain(near).min(),
            seed: self.settings.run.seed as u32 ^ (self.settings.run.seed >> 32) as u32,
        };
        self.density.record(recorder, &self.density_model(), &rules, event.number())?;
        Ok(())
    }

    fn density_model(&self) -> density::Model<'_> {
        let [rows, words] = self.renderer.idle();
        density::Model {
            planes: self.model.buffers(),
            first_moments: self.optimiser.first().buffers(),
            second_moments: self.optimiser.second().map(Planes::buffers),
            stats: &self.stats,
            ids: &self.ids,
            counters: &self.renderer.counters,
            args: &self.renderer.args,
            scratch: Scratch { rows, words },
        }
    }

    /// What came of an event. Waits for it if it is not done.
    pub fn outcome(&mut self, ticket: Ticket) -> Result<Outcome, Error> {
        self.gpu.wait(ticket)?;
        let slot = self.slots.iter().find(|(t, _)| *t == ticket).map_or(0, |(_, slot)| *slot);
        let words: Vec<u32> =
            self.gpu.read_ready(&self.ring, RING_SLOT * slot, finish::REPORT_WORDS, ticket)?.unwrap_or_default();
        let loss = words.get(counters::COUNT).map_or(f32::NAN, |bits| f32::from_bits(*bits));
        let counters = words.get(..counters::COUNT).map(<[u32]>::to_vec).unwrap_or(vec![0; counters::COUNT]);
        Ok(Outcome { counters, loss })
    }

    /// Waits for everything submitted, makes what was too small larger, and clears the status. Gives the number of the last
    /// event done, and what grew to which capacity: nothing where splats would have to grow past what fits, which
    /// [`Self::most_splats`] then says. On an error the training can still be saved, after [`Self::give_up_growing`].
    pub fn grow(&mut self) -> Result<(u32, Growth), Error> {
        let mut words: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        let status = words[counters::STATUS];
        let mut grown = Vec::new();
        let mut size = self.size;
        let mut variants = self.renderer.variants();
        if status & counters::PAIRS_BIT != 0 {
            let wanted = words[counters::WANT_PAIRS];
            if wanted > most_pairs(&self.gpu, variants) && !self.settings.run.deterministic {
                variants = variants.without_slots(&self.gpu);
            }
            let limit = most_pairs(&self.gpu, variants);
            let planned = larger(wanted, size.pairs, limit, "(splat, tile) pairs", "--max-side")?;
            size.pairs = self.needs.pairs(variants, size.splats, wanted, planned)?;
            grown.push(("pairs", u64::from(size.pairs)));
        }
        if status & counters::SPLATS_BIT != 0 {
            let limit = most_splats(&self.gpu);
            let wanted = words[counters::WANT_SPLATS];
            let planned = larger(wanted, size.splats, limit, "splats", "--max-splats")?;
            let planned = planned.min(self.most_splats.unwrap_or(u32::MAX));
            match self.needs.splats(variants, size.pairs, wanted, planned) {
                Some(splats) => {
                    size.splats = splats;
                    grown.push(("splats", u64::from(splats)));
                }
                // Pairs have taken more than was set aside for them.
                None => self.most_splats = Some(size.splats),
            }
        }
        words[counters::STATUS] = 0;
        let splats = size.splats;
        if splats > self.size.splats {
            // What nothing outlives a step in goes before larger planes come.
            self.density = DensityControl::new(&self.gpu, 1, DENSITY_ENTRY)?;
            self.rebuild(variants, Size { splats: 1, pairs: 1, tiles: 1, ..size }, &words)?;
            self.grow_planes(splats)?;
            self.density = DensityControl::new(&self.gpu, splats, DENSITY_ENTRY)?;
        }
        self.rebuild(variants, size, &words)?;
        Ok((words[counters::DONE], grown))
    }

    /// After a failed [`Self::grow`]: clears the status, so that the state can be saved. Gives the number of the last event done.
    pub fn give_up_growing(&mut self) -> Result<u32, Error> {
        let mut words: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        words[counters::STATUS] = 0;
        self.gpu.write(&self.renderer.counters, &words)?;
        Ok(words[counters::DONE])
    }

    fn rebuild(&mut self, variants: Variants, size: Size, counters: &[u32]) -> Result<(), Error> {
        // The old buffers go before the new ones come: nothing in them outlives a step. The counters do, and are never lost. They
        // stay where they are with the planes that they count, for whoever looks at these from outside.
        let kept = (size.splats == self.size.splats).then(|| self.renderer.counters.clone());
        self.renderer = Renderer::new(&self.gpu, variants, Size { splats: 1, pairs: 1, tiles: 1, ..size })?;
        self.gpu.write(&self.renderer.counters, counters)?;
        let mut renderer = Renderer::new(&self.gpu, variants, size)?;
        if let Some(kept) = kept {
            renderer.counters = kept;
        }
        self.gpu.write(&renderer.counters, counters)?;
        self.renderer = renderer;
        self.size = size;
        Ok(())
    }

    /// From now on steps also count evaluated and blended pixel-splats into [`Renderer::pair_counts`], which is slower. Waits.
    pub fn count_pixel_splats(&mut self) -> Result<(), Error> {
        let words: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        self.rebuild(self.variants(), Size { count: true, ..self.size }, &words)
    }

    /// Plane by plane, so that only one of them is held twice.
    fn grow_planes(&mut self, splats: u32) -> Result<(), Error> {
        self.ids = grown(&self.gpu, &self.ids, 4 * u64::from(splats))?;
        self.stats = grown(&self.gpu, &self.stats, 16 * u64::from(splats))?;
        self.model.grow(&self.gpu, splats)?;
        self.optimiser.grow(&self.gpu, splats)?;
        Ok(())
    }

    /// What the buffers cost.
    pub fn memory(&self) -> MemoryCost {
        let of_splats =
            [self.model.bytes(), self.optimiser.bytes(), self.ids.size(), self.stats.size(), self.density.bytes()];
        let of_exposures = self.exposures.as_ref().map_or([0; 2], Exposures::bytes);
        let own = Held {
            splats: of_splats.iter().sum(),
            pixels: self.target.bytes() + self.losses.bytes() + of_exposures[0],
            fixed: self.ring.size() + of_exposures[1],
            ..Held::default()
        };
        let photographs = self.photographs.iter().map(|p| p.pixels.size()).sum();
        MemoryCost::new(
            own + self.renderer.held(),
            [self.size.splats, self.size.pairs, self.target.pixels],
            photographs,
        )
    }

    /// The model, read back. Waits.
    pub fn model(&self) -> Result<Gaussians, Error> {
        let n = self.splats()?;
        let ids = if n > 0 { self.gpu.read_at(&self.ids, 0, n as usize)? } else { Vec::new() };
        Ok(gaussians_of(self.model.read(&self.gpu, n)?, ids))
    }

    /// Renders the model as it is, with every band of the spherical harmonics in use at `sh_degree`. Waits.
    pub fn picture(
        &mut self,
        camera: &Camera,
        sh_degree: u32,
        background: [f32; 3],
        aux: bool,
    ) -> Result<Picture, Error> {
        let splats = self.splats()?;
        let shot = self.view_shot(camera, sh_degree, background);
        Ok(self.viewer.render(&self.model, splats, &shot, aux)?)
    }

    /// How a camera sees the model outside of training steps.
    pub fn view_shot(&self, camera: &Camera, sh_degree: u32, background: [f32; 3]) -> Shot {
        let projection = Projection { sh_degree, near: NEAR, antialias: self.antialias, reference_clamp: false };
        Shot { camera: *camera, projection, background }
    }

    /// The model's planes.
    pub fn planes(&self) -> &Planes {
        &self.model
    }

    /// A handle of the model for others to look at.
    pub fn live_model(&self) -> LiveModel {
        LiveModel::new(self.model.clone(), self.renderer.counters.clone())
    }

    /// Splats in the model. Waits.
    pub fn splats(&self) -> Result<u32, Error> {
        let words: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        Ok(words[counters::SPLATS])
    }

    /// Everything a restart needs, read back. Waits.
    pub fn state(&self) -> Result<State, Error> {
        let counters: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        let n = counters[counters::SPLATS];
        let (ids, stats) = if n > 0 {
            (self.gpu.read_at(&self.ids, 0, n as usize)?, self.gpu.read_at(&self.stats, 0, 4 * n as usize)?)
        } else {
            (Vec::new(), Vec::new())
        };
        Ok(State {
            params: self.model.read(&self.gpu, n)?,
            ids,
            moments: self.optimiser.read(&self.gpu, n)?,
            stats,
            counters,
            exposures: self.exposures.as_ref().map_or(Ok(Vec::new()), |e| e.state(&self.gpu))?,
        })
    }

    /// The photographs' exposures in the order of the views; `None` where they are off. Waits.
    pub fn exposures(&self) -> Result<Option<Vec<ExposureMatrix>>, Error> {
        let Some(exposures) = &self.exposures else { return Ok(None) };
        Ok(Some(exposures::matrices(&exposures.state(&self.gpu)?)))
    }
}

/// A capacity for `wanted` elements with room to spare, at most `most`.
fn larger(wanted: u32, now: u32, most: u32, what: &'static str, remedy: &'static str) -> Result<u32, Error> {
    if wanted > most {
        return Err(Error::TooMany { what, wanted: u64::from(wanted), limit: u64::from(most), remedy });
    }
    let next = (u64::from(wanted) + u64::from(wanted) / 4).max(u64::from(now) + 64);
    Ok(next.min(u64::from(most)) as u32)
}

/// A photograph on the device.
struct Photograph {
    /// RGBA8; alpha 0 is masked.
    pixels: Buffer,
    /// What the means of the loss are taken over.
    values: f32,
}

/// Fills the buffer of a photograph and gives what the means of the loss are taken over. Waits, so that only one is held twice.
fn upload(gpu: &Gpu, view: &View, buffer: &Buffer) -> Result<f32, Error> {
    let expected = 4 * view.camera.width as usize * view.camera.height as usize;
    if view.rgba.len() != expected || expected == 0 {
        return Err(Error::PhotographSize { name: view.name.clone(), found: view.rgba.len(), expected });
    }
    gpu.write(buffer, &view.rgba)?;
    gpu.wait(gpu.last_ticket())?;
    Ok(loss::values(view.camera.width, view.camera.height, view.masked()))
}
