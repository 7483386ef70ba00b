//! Training inside a host program: step by step, between points of the host's timelines, with the model in sight.

use super::{Message, Trainer};
use crate::raster::{LiveModel, Shot};
use crate::scene::Camera;
use crate::train::Error;
use crate::train::schedule::Kind;
use crate::vk::{SubmitSync, Ticket};

impl Trainer {
    /// Submits the next step, with the density change and the opacity reset that belong to it, and gives the ticket of the last of
    /// these submits; `None` when no step is left, and then nothing is submitted or signalled.
    ///
    /// The step waits for `order.wait` on the device. `order.signal` is reached when it is done, with the model whole. Should it turn
    /// out that a buffer was too small, the step has changed nothing by then and is repeated in a later call;
    /// [`Message::Step`] says which steps were really done.
    ///
    /// The host is held up only by what earlier calls have submitted: when as many events as [`crate::train::Pacing`] allows are on
    /// their way, when buffers grow, where an evaluation or a checkpoint is due, and where the host has a part in training (a cloud
    /// that growth keeps to, depths that are propagated). So everything that a step waits for must
    /// come without further calls.
    pub fn step(&mut self, order: SubmitSync<'_>) -> Result<Option<Ticket>, Error> {
        loop {
            if self.finished {
                return Ok(None);
            }
            let (_, _, last) = self.due();
            if self.has_room() && self.next <= last {
                break;
            }
            self.advance()?;
        }
        // What an evaluation has left of the step before comes along.
        let (_, _, last) = self.due();
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

    /// The next message about what is done so far; `None` where there is none yet. Waits only where buffers have to grow.
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

    /// A handle of the model, for views of it while training goes on. To be taken again after [`Message::Grown`].
    pub fn live_model(&self) -> LiveModel {
        self.engine.live_model()
    }

    /// How a camera sees the model as it is: with the spherical harmonics in use at this step, and the background of evaluations.
    pub fn shot(&self, camera: &Camera) -> Shot {
        let sh_degree = self.schedule.step(self.next.step.clamp(1, self.schedule.iterations.max(1))).sh_degree;
        self.engine.view_shot(camera, sh_degree, self.settings.model.background.evaluated())
    }
}
