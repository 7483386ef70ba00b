//! What the host does before some events, with nothing else on its way.

use super::Trainer;
use crate::train::Error;
use crate::train::event::Kind;

impl Trainer {
    /// Does what the next event needs of the host, once everything before it is done. Where that had to be repeated, another event is
    /// the next.
    pub(super) fn make_ready(&mut self) -> Result<(), Error> {
        if !(self.next.kind == Kind::Density && self.engine.has_cloud()) {
            return Ok(());
        }
        while let Some((event, ticket)) = self.in_flight.pop_front() {
            let outcome = self.engine.outcome(ticket)?;
            self.look(event, outcome)?;
        }
        if self.next.kind == Kind::Density { self.engine.keep_to_cloud() } else { Ok(()) }
    }
}
