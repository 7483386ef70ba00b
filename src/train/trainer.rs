//! Training as a stream of messages. Events are recorded ahead of the device, their outcomes are read some events
//! later, and events are replayed when a buffer turned out too small. Messages, curves, scores and checkpoints are here
//! too.

mod checkpoint;
mod embedded;
mod evaluate;
mod handle_outcome;
mod history;
mod host_actions;
mod losses;
mod recovery;
mod streaming;

pub use checkpoint::{Checkpointed, Restart};
pub use evaluate::score;
pub use history::History;

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::Instant;

use super::Error;
use super::actions::Actions;
use super::engine::{Engine, EngineStart, MemoryCost};
use super::input::{Input, PerceptualBy, TrainedOn, View};
use super::message::Message;
use super::pacing::Pacing;
use super::photographs::Feed;
use super::schedule::{Event, Kind, Schedule};
use super::settings::Settings;
use super::tune::chosen_variants;
use crate::eval::Exposures;
use crate::format;
use crate::raster::{DepthProbe, Picture, Variants};
use crate::saliency;
use crate::scene::ExposureMatrix;
use crate::scene::{Camera, Gaussians};
use crate::vk::{Gpu, SubmitSync, Ticket};

/// A running training.
pub struct Trainer {
    engine: Engine,
    schedule: Schedule,
    actions: Actions,
    settings: Settings,
    held_out: Vec<View>,
    /// The photographs to train on.
    trained_on: TrainedOn,
    /// The held-out photographs.
    truth: Feed,
    pacing: Pacing,
    /// Most events in flight while somebody looks.
    most_in_flight: Option<usize>,
    next: Event,
    in_flight: VecDeque<(Event, Ticket)>,
    messages: VecDeque<Message>,
    /// Every step up to this one is done and reported, with its evaluation and checkpoint.
    attended: u32,
    /// The last step at which held-out photographs were scored.
    evaluated: u32,
    checkpoints: Option<PathBuf>,
    give_up_scoring: Box<dyn Fn() -> bool + Send + Sync>,
    history: History,
    last_splats: u32,
    told_bad_splats: bool,
    /// Whether the warning that memory limits the splats was given.
    told_full: bool,
    started: Instant,
    seconds_before: f64,
    finished: bool,
}

/// A step at which the host must have everything done.
struct Stop {
    step: u32,
    /// Whether the model is scored after the step.
    scored: bool,
    /// The last event before the scoring, or of the step.
    last: Event,
}

impl Trainer {
    /// Uploads photographs and the initial model. `restart` continues an earlier training with the same input and
    /// settings.
    pub fn new(
        gpu: &Gpu,
        input: Input,
        settings: &Settings,
        pacing: Pacing,
        restart: Option<Restart>,
    ) -> Result<Self, Error> {
        let started = Instant::now();
        if input.train.is_empty() {
            return Err(Error::NoViews);
        }
        let perceptual = (settings.texture.lambda_perceptual > 0.0).then(|| match &input.optional.perceptual {
            Some(weights) => PerceptualBy::Network(weights.checksum()),
            None => PerceptualBy::Filters,
        });
        let trained_on = TrainedOn::of(&input.train, perceptual);
        if let Some(before) = restart.as_ref().and_then(|r| r.trained_on.as_ref()) {
            before.check(&trained_on)?;
        }
        let schedule = Schedule::new(settings, input.train.len());
        let (step, seconds_before, state, variants, history) = match restart {
            Some(r) => (r.step, r.seconds, Some(r.state), Some(r.variants), r.history),
            None => (0, 0.0, None, None, History::default()),
        };
        let variants = match variants {
            Some(kept) => kept,
            None => chosen_variants(gpu, settings)?,
        };
        let unscored = step > 0
            && is_scored_after(step, settings, &schedule, input.held_out.len())
            && !history.quality.iter().any(|(s, ..)| *s == step)
            // No density change or reset has followed the step.
            && Event::of_step(step).next(&schedule).kind == Kind::Step;
        let first = streaming::first_views(&schedule, step, pacing);
        let begun = EngineStart { variants, state, first_views: &first };
        let engine = Engine::new_prefetching(gpu, &input, settings, pacing, begun)?;
        let actions = Actions::new(gpu, &input, settings, step)?;
        let last_splats = engine.initial_splats();
        let truth = input.held_out.iter().map(|view| view.photograph.clone()).collect();
        Ok(Self {
            engine,
            schedule,
            actions,
            settings: settings.clone(),
            trained_on,
            held_out: input.held_out,
            truth: Feed::new(truth, pacing.decoded_ahead, pacing.decoders()),
            pacing,
            most_in_flight: None,
            next: Event::of_step(step + 1),
            in_flight: VecDeque::new(),
            messages: VecDeque::new(),
            attended: if unscored { step - 1 } else { step },
            evaluated: if unscored { step - 1 } else { step },
            checkpoints: None,
            give_up_scoring: Box::new(|| false),
            history,
            last_splats,
            told_bad_splats: false,
            told_full: false,
            started,
            seconds_before,
            finished: false,
        })
    }

    /// Gives the next message, and works until there is one. `None` after [`Message::Finished`].
    pub fn next_message(&mut self) -> Result<Option<Message>, Error> {
        loop {
            if let Some(message) = self.messages.pop_front() {
                return Ok(Some(message));
            }
            if self.finished {
                return Ok(None);
            }
            self.advance()?;
        }
    }

    /// One turn: submits what fits, then handles the outcome of the oldest event, or finishes a stop if none is in
    /// flight.
    fn advance(&mut self) -> Result<(), Error> {
        let stop = self.due();
        while self.has_room() && self.next <= stop.last {
            self.submit_next(SubmitSync::default())?;
        }
        if stop.scored && self.next > stop.last {
            self.look_ahead_to_scoring();
        }
        if let Some((event, ticket)) = self.in_flight.pop_front() {
            let outcome = self.engine.outcome(ticket)?;
            return self.look(event, outcome);
        }
        if !stop.scored {
            return self.finish_stop(stop.step);
        }
        self.score(stop.step)
    }

    /// Scores the model after a step. The step is done, and no later event was submitted.
    fn score(&mut self, step: u32) -> Result<(), Error> {
        self.evaluated = step;
        let given_up = std::mem::replace(&mut self.give_up_scoring, Box::new(|| false));
        let scored = self.quality(step, &*given_up);
        self.give_up_scoring = given_up;
        let Some(quality) = scored? else {
            self.tell(Message::ScoringGivenUp { step });
            return Ok(());
        };
        let (splats, seconds) = (self.last_splats, self.seconds());
        self.tell(Message::Evaluated { step, quality, splats, seconds });
        Ok(())
    }

    /// The next stop.
    fn due(&self) -> Stop {
        let step = self.next_stop();
        // A step is scored before its density change and opacity reset, as in the reference: scores of a model whose
        // opacities have just been lowered mean nothing.
        let scored = self.evaluates_at(step) && self.evaluated < step;
        Stop { step, scored, last: Event { step, kind: if scored { Kind::Step } else { Kind::Reset } } }
    }

    /// Whether another event may be submitted before the outcome of the oldest is read.
    fn has_room(&self) -> bool {
        let most = self.pacing.events_in_flight();
        self.in_flight.len() < self.most_in_flight.map_or(most, |fewer| fewer.clamp(1, most))
    }

    /// Submits the next event.
    fn submit_next(&mut self, order: SubmitSync<'_>) -> Result<Ticket, Error> {
        self.make_ready()?;
        let mut plan = self.schedule.step(self.next.step);
        plan.catch_up |= self.actions.catch_up_after(&self.schedule, self.next.step);
        self.look_ahead();
        let ticket = self.engine.submit_with(self.next, &plan, self.schedule.view_at(self.next.step), order)?;
        self.in_flight.push_back((self.next, ticket));
        self.next = self.next.next(&self.schedule);
        Ok(ticket)
    }

    fn seconds(&self) -> f64 {
        self.seconds_before + self.started.elapsed().as_secs_f64()
    }

    /// From now on writes a checkpoint to `folder` every [`Settings`]`.run.checkpoint_every` steps, and one at the end.
    pub fn keep_checkpoints(&mut self, folder: &Path) {
        self.checkpoints = Some(folder.to_owned());
    }

    /// Scoring of held-out photographs is given up as soon as `asked` returns true; it is called before each
    /// photograph. Training goes on without the score.
    pub fn give_up_scoring_when(&mut self, asked: impl Fn() -> bool + Send + Sync + 'static) {
        self.give_up_scoring = Box::new(asked);
    }

    fn evaluates_at(&self, step: u32) -> bool {
        is_scored_after(step, &self.settings, &self.schedule, self.held_out.len())
    }

    fn saves_at(&self, step: u32) -> bool {
        let every = self.settings.run.checkpoint_every;
        let due = step == self.schedule.iterations || every > 0 && step.is_multiple_of(every);
        self.checkpoints.is_some() && due
    }

    /// The step at which the host must have everything done: an evaluation, a checkpoint, or the end.
    fn next_stop(&self) -> u32 {
        let run = &self.settings.run;
        let after = |every: u32, on: bool| match every {
            0 => u32::MAX,
            _ if !on => u32::MAX,
            _ => (self.attended / every + 1).saturating_mul(every),
        };
        let evaluation = after(run.eval_every, !self.held_out.is_empty());
        let checkpoint = after(run.checkpoint_every, self.checkpoints.is_some());
        self.schedule.iterations.min(evaluation).min(checkpoint)
    }

    fn tell(&mut self, message: Message) {
        self.history.add(&message);
        self.messages.push_back(message);
    }

    fn finish_stop(&mut self, stop: u32) -> Result<(), Error> {
        // A training that is resumed at its end has been saved there.
        let saved = self.attended == stop;
        self.attended = stop;
        if self.saves_at(stop) && !saved {
            let (step, path) = self.save_checkpoint()?;
            self.tell(Message::Checkpoint { step, path });
        }
        if stop == self.schedule.iterations {
            self.finished = true;
            self.engine.release_photographs();
            let (splats, seconds) = (self.last_splats, self.seconds());
            self.tell(Message::Finished { step: stop, splats, seconds });
        }
        Ok(())
    }

    /// Finishes what was submitted and writes a checkpoint to the folder of [`Self::keep_checkpoints`] (the current
    /// folder without one). Gives the step after which a resumed training goes on, and the file.
    pub fn save_checkpoint(&mut self) -> Result<(u32, PathBuf), Error> {
        let restart = self.snapshot()?;
        let step = restart.step;
        let folder = self.checkpoints.clone().unwrap_or_default();
        let content = Checkpointed::new(restart, &self.settings)?.to_checkpoint()?;
        Ok((step, format::checkpoint::save(&folder, step.into(), &content)?))
    }

    /// Finishes what was submitted, so that the model is at a whole step; returns that step.
    pub fn drain_to_step(&mut self) -> Result<u32, Error> {
        loop {
            while let Some((event, ticket)) = self.in_flight.pop_front() {
                let outcome = self.engine.outcome(ticket)?;
                self.look(event, outcome)?;
            }
            // A training that goes on from here begins after the step to score.
            let stop = self.due();
            if stop.scored && self.next > stop.last {
                self.score(stop.step)?;
            }
            // If a host action already ran before the next step, that step has to be done as well.
            if self.next.kind == Kind::Step && self.actions.done() < self.next.step {
                return Ok(self.next.step - 1);
            }
            self.submit_next(SubmitSync::default())?;
        }
    }

    /// Renders the held-out views and compares the renders with the photographs, both rounded to 8 bits.
    pub fn evaluate(&mut self) -> Result<crate::eval::Quality, Error> {
        let step = self.drain_to_step()?;
        Ok(self.quality(step, &|| false)?.unwrap_or_else(|| crate::eval::Quality::of(Vec::new())))
    }

    fn quality(&mut self, step: u32, given_up: &dyn Fn() -> bool) -> Result<Option<crate::eval::Quality>, Error> {
        let plan = self.schedule.step(step.max(1));
        let exposures = self.learned()?;
        let held_out = evaluate::HeldOut {
            views: &self.held_out,
            photographs: &self.truth,
            sh_degree: plan.sh_degree,
            background: self.settings.model.background.evaluated(),
            exposures: exposures.as_ref(),
        };
        evaluate::quality(&mut self.engine, &held_out, given_up)
    }

    /// Renders the current model with depth and normals.
    pub fn picture(&mut self, camera: &Camera) -> Result<Picture, Error> {
        let step = self.drain_to_step()?;
        let sh_degree = self.schedule.step(step.max(1)).sh_degree;
        self.engine.picture(camera, sh_degree, self.settings.model.background.evaluated(), true)
    }

    /// Depths of the current model at the pixels of a camera, and blend weights in front of and behind `known` depths:
    /// see [`crate::raster::Viewer::probe`].
    pub fn probe(&mut self, camera: &Camera, known: Option<&[f32]>) -> Result<DepthProbe, Error> {
        let step = self.drain_to_step()?;
        let sh_degree = self.schedule.step(step.max(1)).sh_degree;
        self.engine.probe(camera, sh_degree, known)
    }

    /// The curves so far.
    pub fn history(&self) -> &History {
        &self.history
    }

    /// The held-out views.
    pub fn held_out(&self) -> &[View] {
        &self.held_out
    }

    /// The current model, in scene coordinates.
    pub fn model(&mut self) -> Result<Gaussians, Error> {
        self.drain_to_step()?;
        self.engine.model()
    }

    /// Splats with an identity below this were there at the end of the low-frequency stage; `None` without that stage
    /// or before its end.
    pub fn constrained_below(&mut self) -> Result<Option<u32>, Error> {
        self.drain_to_step()?;
        self.engine.constrained_below()
    }

    /// Names and losses of about `most` training photographs over the width of the saliency filter, measured by where
    /// the current model fails. Empty if the width is not learned.
    pub fn sigma_curves(&mut self, most: usize) -> Result<Vec<(String, saliency::Curve)>, Error> {
        let step = self.drain_to_step()?;
        let plan = self.schedule.step(step.max(1));
        let background = self.settings.model.background.evaluated();
        let every = self.trained_on.names.len().div_ceil(most.max(1)).max(1);
        let mut curves = Vec::new();
        for view in (0..self.trained_on.names.len()).step_by(every) {
            if let Some(curve) = self.engine.sigma_curve(view, plan.sh_degree, background)? {
                curves.push((self.trained_on.names[view].clone(), curve));
            }
        }
        Ok(curves)
    }

    /// Seconds that making the saliency masks took, before the first step.
    pub fn saliency_seconds(&self) -> f64 {
        self.engine.saliency_seconds()
    }

    /// Names of the training photographs.
    pub fn names(&self) -> &[String] {
        &self.trained_on.names
    }

    /// Name and exposure of every training photograph; `None` where exposures are off.
    pub fn exposures(&mut self) -> Result<Option<Vec<(String, ExposureMatrix)>>, Error> {
        self.drain_to_step()?;
        Ok(self.engine.exposures()?.map(|all| self.trained_on.names.iter().cloned().zip(all).collect()))
    }

    /// The exposures from which those of held-out photographs are expected when scoring; `None` where exposures are
    /// off.
    pub fn expected_exposures(&mut self) -> Result<Option<Exposures>, Error> {
        self.drain_to_step()?;
        self.learned()
    }

    /// The exposures on the device.
    fn learned(&mut self) -> Result<Option<Exposures>, Error> {
        let Some(all) = self.engine.exposures()? else { return Ok(None) };
        let centres = self.engine.cameras().iter().map(Camera::center);
        let named = self.trained_on.names.iter().cloned().zip(all).zip(centres);
        Ok(Some(Exposures::new(named.map(|((name, matrix), centre)| (name, matrix, centre)))))
    }

    /// Everything that a restart needs: the last step done, seconds so far, curves, and the device's state.
    pub fn snapshot(&mut self) -> Result<Restart, Error> {
        let step = self.drain_to_step()?;
        let mut history = self.history.clone();
        history.rewind(step);
        let (state, variants) = (self.engine.state()?, self.engine.variants());
        let trained_on = Some(self.trained_on.clone());
        Ok(Restart { step, seconds: self.seconds(), state, variants, history, trained_on })
    }

    /// Splats after the last event whose outcome was read.
    pub fn splats(&self) -> u32 {
        self.last_splats
    }

    /// The variants of the passes in use.
    pub fn variants(&self) -> Variants {
        self.engine.variants()
    }

    /// What the training costs in device memory.
    pub fn memory(&self) -> MemoryCost {
        self.engine.memory()
    }

    /// The schedule in force.
    pub fn schedule(&self) -> &Schedule {
        &self.schedule
    }
}

/// Whether the model is scored after a step, with `held_out` held-out photographs.
fn is_scored_after(step: u32, settings: &Settings, schedule: &Schedule, held_out: usize) -> bool {
    let every = settings.run.eval_every;
    held_out > 0 && (step == schedule.iterations || (every > 0 && step.is_multiple_of(every)))
}
