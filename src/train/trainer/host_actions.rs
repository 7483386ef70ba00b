//! What the host does before some events, with nothing else on its way.

use super::{Message, Trainer};
use crate::train::Error;
use crate::train::actions::Change;

impl Trainer {
    /// Does what the next event needs of the host, once everything before it is done. Where that had to be repeated, another event is
    /// the next.
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

    /// Counts splats that came or went, and says what is to be told.
    fn take_in(&mut self, change: Change) {
        self.last_splats = change.splats.unwrap_or(self.last_splats);
        if let Some(capacity) = change.capacity {
            self.tell(Message::Grown { what: "splats", capacity: capacity.into(), replay_from: self.next.step });
        }
        if let Some(message) = change.message {
            self.tell(message);
        }
    }
}
