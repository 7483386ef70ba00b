//! Training inside a host program: step by step, between points of the host's timelines, with the model in sight.

use std::time::Duration;

use super::{Message, Trainer};
use crate::raster::{LiveModel, Look, Picture, RenderView};
use crate::scene::Camera;
use crate::train::Error;
use crate::train::schedule::Kind;
use crate::vk::{SubmitSync, Ticket};

impl Trainer {
    /// Submits the next step with its density change and opacity reset, and returns the ticket of the last submission.
    /// `None` when no step is left; then nothing is submitted or signalled.
    ///
    /// The step waits for `order.wait` on the device. `order.signal` is reached when the step is done and the model is
    /// whole. If a buffer was too small, the step has changed nothing and is repeated in a later call;
    /// [`Message::Step`] names the steps that were done.
    ///
    /// The call blocks only on what earlier calls have submitted: when as many events as [`crate::train::Pacing`]
    /// allows are in flight, when buffers grow, when an evaluation or a checkpoint is due, and when the host acts on
    /// the model (a cloud that growth keeps to, propagated depths). So whatever a step waits for must come without
    /// further calls of `step`.
    pub fn step(&mut self, order: SubmitSync<'_>) -> Result<Option<Ticket>, Error> {
        loop {
            if self.finished {
                return Ok(None);
            }
            if self.has_room() && self.next <= self.due().last {
                break;
            }
            self.advance()?;
        }
        // After an evaluation, the density change and reset of the step before are submitted with this step.
        let last = self.due().last;
        let (mut events, mut next, mut stepped) = (0, self.next, false);
        while next <= last && !(stepped && next.kind == Kind::Step) {
            stepped |= next.kind == Kind::Step;
            next = next.next(&self.schedule);
            events += 1;
        }
        let mut ticket = None;
        for i in 0..events {
            ticket = Some(self.submit_next(order.of_part(i, events))?);
        }
        Ok(ticket)
    }

    /// The next message about events that are done; `None` if there is none yet. Waits only when buffers have to grow.
    pub fn poll(&mut self) -> Result<Option<Message>, Error> {
        while self.messages.is_empty() {
            match self.in_flight.front() {
                Some((_, ticket)) if self.engine.gpu().is_done(*ticket)? => {}
                _ => break,
            }
            if let Some((event, ticket)) = self.in_flight.pop_front() {
                let outcome = self.engine.outcome(ticket)?;
                self.look(event, outcome)?;
            }
        }
        Ok(self.messages.pop_front())
    }

    /// A handle for rendering the model during the training. Take a new one after [`Message::Grown`].
    pub fn live_model(&self) -> LiveModel {
        self.engine.live_model()
    }

    /// Draws the model as it is on the device, between two events, as `look` says. Nothing of the training changes: not
    /// what is submitted, not what is reported. Waits for what was submitted.
    pub fn draw(&mut self, camera: &Camera, look: Look) -> Result<Picture, Error> {
        let view = self.shot(camera);
        self.engine.look(&view, look)
    }

    /// Median depths of the model as it is on the device, at the pixels of a camera, in scene units; 0 where there is no
    /// surface. Changes nothing of the training. Waits for what was submitted.
    pub fn depths(&mut self, camera: &Camera) -> Result<Vec<f32>, Error> {
        let sh_degree = self.shot(camera).projection.sh_degree;
        Ok(self.engine.probe(camera, sh_degree, None)?.median)
    }

    /// Submits at most this many events ahead of the device (`None`: as many as the pacing allows), so that a picture does
    /// not wait for many steps. Changes no result.
    pub fn run_ahead_at_most(&mut self, events: Option<usize>) {
        self.most_in_flight = events;
    }

    /// Leaves a pause out of the seconds of training.
    pub fn leave_out(&mut self, pause: Duration) {
        self.started += pause;
    }

    /// The view to render of the current model from a camera: with the spherical harmonics in use at this step and the
    /// background of evaluations.
    pub fn shot(&self, camera: &Camera) -> RenderView {
        let sh_degree = self.schedule.step(self.next.step.clamp(1, self.schedule.iterations.max(1))).sh_degree;
        self.engine.view_shot(camera, sh_degree, self.settings.model.background.evaluated())
    }
}
