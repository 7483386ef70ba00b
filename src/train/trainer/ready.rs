//! What the host does before some events, with nothing else on its way.

use super::Trainer;
use crate::train::event::Kind;
use crate::train::memory::is_lack_of_memory;
use crate::train::{Error, Message};

impl Trainer {
    /// Does what the next event needs of the host, once everything before it is done. Where that had to be repeated, another event is
    /// the next.
    pub(super) fn make_ready(&mut self) -> Result<(), Error> {
        let waits = match self.next.kind {
            Kind::Step => self.propagates().is_some() || self.prunes().is_some(),
            Kind::Density => self.engine.has_cloud(),
            Kind::Reset => false,
        };
        if !waits {
            return Ok(());
        }
        while let Some((event, ticket)) = self.in_flight.pop_front() {
            let outcome = self.engine.outcome(ticket)?;
            self.look(event, outcome)?;
        }
        match self.next.kind {
            Kind::Density => self.engine.keep_to_cloud(),
            Kind::Step => {
                self.propagate()?;
                self.prune()
            }
            Kind::Reset => Ok(()),
        }
    }

    /// The weight below which splats are dropped before the next step, where that is due and not done.
    fn prunes(&self) -> Option<f64> {
        self.schedule.prunes(self.next.step).filter(|_| self.pruned < self.next.step)
    }

    fn prune(&mut self) -> Result<(), Error> {
        let (Some(least), step) = (self.prunes(), self.next.step) else { return Ok(()) };
        let degree = self.schedule.step(step).sh_degree;
        self.pruned = step;
        let weights = match self.engine.weights(degree) {
            Ok(weights) => weights,
            // The splats are what they were: a larger model is no reason to lose it.
            Err(error) if is_lack_of_memory(&error) => {
                self.tell(Message::Warning(format!(
                    "step {step}: splats of little weight are kept, because there is no room to weigh them: {error}"
                )));
                return Ok(());
            }
            Err(error) => return Err(error),
        };
        let dropped = self.engine.drop_below(least, &weights)?;
        self.last_splats = self.last_splats.saturating_sub(dropped);
        let splats = self.last_splats;
        self.tell(Message::Pruned { step, dropped, splats });
        Ok(())
    }

    /// The ratio of the next step's propagation, where it has one that is not done: a step that is repeated has it behind itself.
    fn propagates(&self) -> Option<f64> {
        self.schedule.propagates(self.next.step).filter(|_| self.propagated < self.next.step)
    }

    fn propagate(&mut self) -> Result<(), Error> {
        let (Some(ratio), step) = (self.propagates(), self.next.step) else { return Ok(()) };
        let degree = self.schedule.step(step).sh_degree;
        let brought = self.engine.propagate(self.schedule.view_at(step), ratio, degree)?;
        self.propagated = step;
        self.last_splats += brought.splats;
        if let Some(capacity) = brought.capacity {
            self.tell(Message::Grown { what: "splats", capacity: capacity.into(), replay_from: step });
        }
        let (added, share, splats) = (brought.splats, brought.share, self.last_splats);
        self.tell(Message::Propagated { step, added, share, splats });
        Ok(())
    }
}
