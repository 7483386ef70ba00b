//! What the host does before some events, with no event in flight.

use super::{Message, Trainer};
use crate::train::Error;
use crate::train::actions::Change;

impl Trainer {
    /// Runs the host actions that are due before the next event, once every earlier event is done. If an earlier event
    /// has to be repeated, that event is the next one.
    pub(super) fn make_ready(&mut self) -> Result<(), Error> {
        if !self.actions.are_due(&self.schedule, self.next) {
            return Ok(());
        }
        while let Some((event, ticket)) = self.in_flight.pop_front() {
            let outcome = self.engine.outcome(ticket)?;
            self.look(event, outcome)?;
        }
        for change in self.actions.run(&mut self.engine, &self.schedule, self.next)? {
            self.take_in(change);
        }
        Ok(())
    }

    /// Takes over the number of splats after an action, and queues the messages about it.
    fn take_in(&mut self, change: Change) {
        if let Some(splats) = change.splats {
            self.last_splats = splats;
            self.warn_of_full_memory(self.next.step, splats);
        }
        if let Some(capacity) = change.capacity {
            self.tell(Message::Grown { what: "splats", capacity: capacity.into(), replay_from: self.next.step });
        }
        if let Some(message) = change.message {
            self.tell(message);
        }
    }
}
