//! Times training steps.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::memory_traffic::Work;
use super::rates::Rates;
use super::report::{DeviceName, Loss, PerStep, Report, Workload};
use super::roofline::PerPixel;
use super::rows::rows;
use super::upscale::enlarge;
use super::{Error, Quartiles};
use crate::pass::counters;
use crate::raster::scan;
use crate::raster::sort::SortShape;
use crate::raster::tiles::{DEPTH_BITS, tile_bits};
use crate::train::schedule::DensityChange;
use crate::train::settings::Shortcuts;
use crate::train::{self, Engine, Event, Input, Kind, Outcome, Pacing, Schedule, Settings, StepPlan};
use crate::vk::{Described, Gpu, PassTime, Recorder, Stats, Ticket};

/// Most views in a benchmark. They are few so that each view comes up several times and its loss has to fall.
const MOST_VIEWS: usize = 8;

/// What is measured.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Steps before timing.
    pub warm_up: u32,
    /// Steps timed as a whole. As many steps follow that are timed pass by pass.
    pub steps: u32,
    /// Longer side of the views in pixels. Photographs with a shorter one are enlarged.
    pub side: Option<u32>,
    /// Bytes of each of the two buffers whose copy measures the bandwidth.
    pub copy_bytes: u64,
}

/// Bytes to copy: more than caches hold.
pub const COPY_BYTES: u64 = 256 << 20;

/// Times training steps of `settings` without density control. Every band of the spherical harmonics is in use from the
/// first step. Up to 8 training views, spread evenly over all of them, take turns.
///
/// Fails with [`Error::NotLive`] when a view has no visible splats or no pairs, when no splat is blended, or when the
/// mean loss does not fall from the first pass over the views to the last.
pub fn measure(gpu: &Gpu, mut input: Input, settings: &Settings, options: &Options) -> Result<Report, Error> {
    if options.steps == 0 {
        return Err(Error::NoSteps);
    }
    let caps = gpu.caps();
    if caps.limits.timestamp_ns <= 0.0 {
        return Err(Error::NoTimestamps { device: caps.device.clone() });
    }
    let rates = Rates::measure(gpu, train::chosen_variants(gpu, settings)?, options.copy_bytes)?;
    // The buffers that measured the rates do not count as memory of a step.
    gpu.restart_peak();
    let mut run = Run::new(gpu, &mut input, settings, options)?;
    run.follow()?;
    run.report(&input, rates)
}

/// The recorded commands of one step of a benchmark.
pub fn commands(gpu: &Gpu, mut input: Input, settings: &Settings, options: &Options) -> Result<Vec<Described>, Error> {
    let mut run = Run::new(gpu, &mut input, settings, options)?;
    while run.next - run.begin < 2 * run.views.max(4) as u32 {
        let ticket = run.submit(false)?;
        let outcome = run.engine.outcome(ticket)?;
        run.grown(&outcome)?;
    }
    Ok(gpu.describe(&run.recorded(false)?)?)
}

impl Options {
    fn total(&self) -> u32 {
        self.warm_up.saturating_add(self.steps.saturating_mul(2))
    }
}

/// A step whose outcome is known.
struct TimedStep {
    outcome: Outcome,
    passes: Vec<PassTime>,
    wall: Duration,
}

impl TimedStep {
    fn counter(&self, index: usize) -> u32 {
        self.outcome.counters.get(index).copied().unwrap_or(0)
    }
}

struct Run<'a> {
    gpu: &'a Gpu,
    engine: Engine,
    schedule: Schedule,
    sh_degree: u32,
    shortcuts: Shortcuts,
    views: usize,
    depth: usize,
    options: &'a Options,
    /// First step that counts: steps up to the last overflow of a buffer do not.
    begin: u32,
    next: u32,
    in_flight: VecDeque<Ticket>,
    looked: Instant,
    samples: Vec<TimedStep>,
    /// Statistics before and after the steps without timestamps.
    stats: [Stats; 2],
}

impl<'a> Run<'a> {
    /// Keeps some views of `input` and enlarges them to the asked side.
    fn new(gpu: &'a Gpu, input: &mut Input, settings: &Settings, options: &'a Options) -> Result<Self, Error> {
        let all = input.train.len();
        let views = all.min(MOST_VIEWS).min((options.total() / 2).max(1) as usize);
        if views == 0 {
            return Err(train::Error::NoViews.into());
        }
        let mut number = 0;
        input.train.retain(|_| {
            number += 1;
            (number - 1) * views / all != number * views / all
        });
        if let Some(side) = options.side {
            for view in &mut input.train {
                enlarge(view, side).map_err(train::Error::from)?;
            }
        }
        let mut settings = settings.clone();
        settings.density.no_densify = true;
        // No step of the benchmark is the last of its run: the last one has no optimiser step.
        settings.run.iterations = settings.run.iterations.max(2 * options.total() + 100);
        let variants = train::chosen_variants(gpu, &settings)?;
        // The set of splats does not grow.
        let pacing = Pacing { splat_capacity: input.initial.len() as u32, ..Pacing::default() };
        Ok(Run {
            gpu,
            engine: Engine::new(gpu, input, &settings, variants, pacing, None)?,
            schedule: Schedule::new(&settings, views),
            sh_degree: settings.model.sh_degree,
            shortcuts: settings.shortcuts.clone(),
            views,
            depth: pacing.events_in_flight,
            options,
            begin: 1,
            next: 1,
            in_flight: VecDeque::new(),
            looked: Instant::now(),
            samples: Vec::new(),
            stats: [Stats::default(); 2],
        })
    }

    fn plan(&self, step: u32) -> StepPlan {
        StepPlan { sh_degree: self.sh_degree, ..self.schedule.step(step) }
    }

    fn recorded(&self, profile: bool) -> Result<Recorder, Error> {
        let mut recorder = self.gpu.recorder("step")?;
        recorder.profile(profile);
        let view = (self.next - 1) as usize % self.views;
        self.engine.record(&mut recorder, Event::of_step(self.next), &self.plan(self.next), view)?;
        Ok(recorder)
    }

    fn submit(&mut self, profile: bool) -> Result<Ticket, Error> {
        let recorder = self.recorded(profile)?;
        self.next += 1;
        Ok(self.engine.submit_recorded(recorder)?)
    }

    /// Warm-up, steps without timestamps, steps with timestamps: submitted ahead and awaited later, as in training. The
    /// steps with timestamps come last because reading timestamps waits for the whole queue on lavapipe.
    fn follow(&mut self) -> Result<(), Error> {
        let plain = self.options.warm_up..self.options.warm_up + self.options.steps;
        let total = self.options.total();
        while self.samples.len() < total as usize {
            let number = self.next - self.begin;
            if number == plain.start {
                self.stats[0] = self.gpu.stats();
            }
            if number < total {
                let ticket = self.submit(number >= plain.end)?;
                self.in_flight.push_back(ticket);
            }
            if self.in_flight.len() >= self.depth || number >= total {
                self.look()?;
            }
            if number + 1 == plain.end {
                self.stats[1] = self.gpu.stats();
            }
        }
        Ok(())
    }

    fn look(&mut self) -> Result<(), Error> {
        let Some(ticket) = self.in_flight.pop_front() else { return Ok(()) };
        let outcome = self.engine.outcome(ticket)?;
        if self.grown(&outcome)? {
            self.in_flight.clear();
            self.samples.clear();
            self.begin = self.next;
            return Ok(());
        }
        if !outcome.loss.is_finite() {
            return Err(train::Error::LossNotFinite { step: self.begin + self.samples.len() as u32 }.into());
        }
        let now = Instant::now();
        let wall = now - self.looked;
        self.looked = now;
        let passes = self.gpu.timings(ticket)?.unwrap_or_default();
        self.samples.push(TimedStep { outcome, passes, wall });
        Ok(())
    }

    /// Whether a buffer was too small for the step. Then the buffer has grown, and the step is repeated.
    fn grown(&mut self, outcome: &Outcome) -> Result<bool, Error> {
        if outcome.counters[counters::STATUS] == 0 {
            return Ok(false);
        }
        let (done, _) = self.engine.grow()?;
        self.next = Event::after(done, &self.schedule).step;
        Ok(true)
    }

    fn report(mut self, input: &Input, rates: Rates) -> Result<Report, Error> {
        let samples = std::mem::take(&mut self.samples);
        let (warm_up, steps) = (self.options.warm_up as usize, self.options.steps as usize);
        let loss = self.live(&samples)?;
        let peak_device_bytes = self.gpu.memory_use().peak;
        let memory = self.engine.memory();
        let (plain, timed) = samples[warm_up..].split_at(steps);
        let work = self.work(input, timed);
        let times: Vec<&[PassTime]> = timed.iter().map(|s| s.passes.as_slice()).collect();
        let splats = timed.first().map_or(0, |s| s.counter(counters::SPLATS));
        let splats_per_pixel = self.count(work.pixels)?;
        let density_peak_bytes = self.density_peak()?;
        let (passes, stages, device_ms) = rows(&times, &work, splats_per_pixel.as_ref(), &rates)?;
        let caps = self.gpu.caps();
        Ok(Report {
            device: DeviceName {
                name: caps.device.clone(),
                kind: caps.kind.to_string(),
                driver: caps.driver.clone(),
                api: format!("{}.{}.{}", caps.api.0, caps.api.1, caps.api.2),
            },
            variants: work.variants,
            rates,
            warm_up: self.options.warm_up,
            steps: self.options.steps,
            workload: Workload {
                views: self.views,
                size: input.train.first().map_or([0; 2], |v| [v.camera.width, v.camera.height]),
                pixels: work.pixels,
                tiles: work.tiles,
                sh_degree: self.sh_degree,
                splats,
                visible: work.visible,
                pairs: work.pairs,
                splats_per_pixel,
            },
            loss,
            device_ms,
            wall_ms: Quartiles::of(plain.iter().map(|s| s.wall.as_secs_f64() * 1e3)),
            per_step: per_step(self.stats, self.options.steps),
            passes,
            stages,
            peak_device_bytes,
            memory,
            density_peak_bytes,
        })
    }

    /// Checks that the steps did the work of a real training.
    fn live(&self, samples: &[TimedStep]) -> Result<Loss, Error> {
        for (what, index) in [("visible splat", counters::VISIBLE), ("(splat, tile) pair", counters::PAIRS)] {
            let without = samples.iter().filter(|s| s.counter(index) == 0).count();
            if without > 0 {
                let all = samples.len();
                return Err(Error::NotLive(format!("{without} of {all} steps had not one {what}")));
            }
        }
        let mean = |samples: &[TimedStep]| {
            samples.iter().map(|s| f64::from(s.outcome.loss)).sum::<f64>() / samples.len().max(1) as f64
        };
        let seen = self.views.min(samples.len());
        let loss = Loss { first_pass: mean(&samples[..seen]), last_pass: mean(&samples[samples.len() - seen..]) };
        if loss.last_pass < loss.first_pass {
            return Ok(loss);
        }
        Err(Error::NotLive(format!(
            "the mean loss over the same {} views went from {} to {} in {} steps. A trained model takes some steps to \
             find back from the first ones of a fresh optimiser: more steps may help",
            self.views,
            loss.first_pass,
            loss.last_pass,
            samples.len()
        )))
    }

    fn work(&self, input: &Input, samples: &[TimedStep]) -> Work {
        let mean = |index| samples.iter().map(|s| f64::from(s.counter(index))).sum::<f64>() / samples.len() as f64;
        let variants = self.engine.variants();
        let side = variants.tile.size();
        let tiles = |w: u32, h: u32| f64::from(w.div_ceil(side) * h.div_ceil(side));
        let sizes = || input.train.iter().map(|v| (v.camera.width, v.camera.height));
        let over_views = |f: &dyn Fn(u32, u32) -> f64| sizes().map(|(w, h)| f(w, h)).sum::<f64>() / self.views as f64;
        let tile_capacity = sizes().map(|(w, h)| tiles(w, h)).fold(0.0, f64::max);
        let pair_capacity = self.engine.renderer().pair_capacity();
        let shape = SortShape::of(self.gpu.caps());
        Work {
            splats: mean(counters::SPLATS),
            visible: mean(counters::VISIBLE),
            pairs: mean(counters::PAIRS),
            pixels: over_views(&|w, h| f64::from(w) * f64::from(h)),
            tiles: over_views(&tiles),
            splat_capacity: f64::from(self.engine.renderer().splat_capacity()),
            pair_capacity: f64::from(pair_capacity),
            most_at_once: scan::most_at_once(self.gpu.caps()),
            tile_capacity,
            sh_degree: self.sh_degree,
            listed: self.shortcuts.visible_adam,
            moment_words: self.shortcuts.moment_bits / 16,
            variants,
            shape,
            depth: shape.digits(DEPTH_BITS),
            tile: shape.digits(tile_bits(tile_capacity as u64)),
        }
    }

    /// Most device memory in use during a density change, with the growth of buffers where the change needs it. Changes
    /// the model.
    fn density_peak(&mut self) -> Result<u64, Error> {
        self.gpu.restart_peak();
        loop {
            let plan = StepPlan {
                densify: Some(DensityChange { prune_large: false, sees_all: true }),
                ..self.plan(self.next)
            };
            let event = Event { step: self.next, kind: Kind::Density };
            let ticket = self.engine.submit(event, &plan, 0)?;
            let outcome = self.engine.outcome(ticket)?;
            if outcome.counters[counters::STATUS] == 0 {
                return Ok(self.gpu.memory_use().peak);
            }
            self.engine.grow()?;
        }
    }

    /// Renders each view once more with passes that count splats per pixel, one view after the other.
    fn count(&mut self, pixels: f64) -> Result<Option<PerPixel>, Error> {
        self.engine.count_pixel_splats()?;
        let side = u64::from(self.engine.variants().tile.size());
        let mut sums = [0.0; 4];
        let mut counted = 0;
        while counted < self.views {
            self.gpu.write(self.engine.renderer().pair_counts(), &[0u32; 4])?;
            let ticket = self.submit(false)?;
            let outcome = self.engine.outcome(ticket)?;
            if self.grown(&outcome)? {
                continue;
            }
            if u64::from(outcome.counters[counters::PAIRS]) * side * side > u64::from(u32::MAX) {
                return Ok(None);
            }
            let counts: Vec<u32> = self.gpu.read_at(self.engine.renderer().pair_counts(), 0, 4)?;
            sums.iter_mut().zip(counts).for_each(|(sum, count)| *sum += f64::from(count));
            counted += 1;
        }
        let [forward_evaluated, forward_blended, backward_evaluated, backward_blended] =
            sums.map(|sum| sum / (pixels * self.views as f64));
        if forward_blended == 0.0 || backward_blended == 0.0 {
            return Err(Error::NotLive("not one splat was blended".into()));
        }
        Ok(Some(PerPixel { forward_evaluated, forward_blended, backward_evaluated, backward_blended }))
    }
}

fn per_step([before, after]: [Stats; 2], steps: u32) -> PerStep {
    let per = |f: fn(&Stats) -> u64| (f(&after) - f(&before)) as f64 / f64::from(steps);
    PerStep {
        dispatches: per(|s| s.dispatches),
        transfers: per(|s| s.transfers),
        barriers: per(|s| s.barriers),
        buffer_barriers: per(|s| s.buffer_barriers),
        submits: per(|s| s.submits),
        host_waits: per(|s| s.host_waits),
        pacing_waits: per(|s| s.pacing_waits),
    }
}
