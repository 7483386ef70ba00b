//! What the host does before some events, with nothing else on its way.

use super::{Message, Trainer};
use crate::train::Error;
use crate::train::engine::Brought;
use crate::train::memory::is_lack_of_memory;
use crate::train::schedule::{Dropped, Kind};

/// Share of a limit from which on it counts as reached: density changes prune as they grow.
const NEARLY: f64 = 0.95;

impl Trainer {
    /// Does what the next event needs of the host, once everything before it is done. Where that had to be repeated, another event is
    /// the next.
    pub(super) fn make_ready(&mut self) -> Result<(), Error> {
        let waits = match self.next.kind {
            Kind::Step => {
                self.propagates().is_some() || self.may_drop().is_some() || self.settles_sh() || self.skirts()
            }
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
                self.prune()?;
                self.settle_sh()?;
                self.add_skirt()
            }
            Kind::Reset => Ok(()),
        }
    }

    /// The splats that may be dropped for their weight before the next step, where that is due and not done: by the schedule alone, which
    /// is the same however many events are on their way.
    fn may_drop(&self) -> Option<Dropped> {
        self.schedule.drops(self.next.step).filter(|_| self.pruned < self.next.step)
    }

    /// Those that are dropped: for room only where it is short, as counted once everything before the step is done.
    fn drops(&self) -> Option<Dropped> {
        let due = self.may_drop()?;
        let held_up = self.engine.limit().is_some_and(|most| f64::from(self.last_splats) >= NEARLY * f64::from(most));
        (held_up || matches!(due, Dropped::Below(_))).then_some(due)
    }

    fn prune(&mut self) -> Result<(), Error> {
        let (Some(due), step) = (self.drops(), self.next.step) else { return Ok(()) };
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
        let least = match due {
            Dropped::Below(least) => least,
            Dropped::Lightest(share) => quantile(&weights, share),
        };
        let dropped = self.engine.drop_below(least, &weights)?;
        self.last_splats = self.last_splats.saturating_sub(dropped);
        let splats = self.last_splats;
        self.tell(Message::Pruned { step, dropped, splats });
        Ok(())
    }

    fn settles_sh(&self) -> bool {
        self.schedule.settles_sh(self.next.step) && self.settled < self.next.step
    }

    fn settle_sh(&mut self) -> Result<(), Error> {
        if !self.settles_sh() {
            return Ok(());
        }
        let step = self.next.step;
        let (full, splats) = (self.engine.settle_harmonics()?, self.last_splats);
        self.settled = step;
        self.tell(Message::HarmonicsSettled { step, full, splats });
        Ok(())
    }

    fn skirts(&self) -> bool {
        self.schedule.skirts(self.next.step) && self.skirted < self.next.step
    }

    fn add_skirt(&mut self) -> Result<(), Error> {
        if !self.skirts() {
            return Ok(());
        }
        let step = self.next.step;
        let brought = self.engine.add_skirt()?;
        self.skirted = step;
        self.count_in(&brought, step);
        if brought.splats > 0 {
            let (added, splats) = (brought.splats, self.last_splats);
            self.tell(Message::Skirted { step, added, splats });
        }
        Ok(())
    }

    /// The ratio of the next step's propagation, where it has one that is not done: a step that is repeated has it behind itself.
    fn propagates(&self) -> Option<f64> {
        self.schedule.propagates(self.next.step).filter(|_| self.propagated < self.next.step)
    }

    /// Counts splats that came from the host before a step, and says where there is more room since.
    fn count_in(&mut self, brought: &Brought, step: u32) {
        self.last_splats += brought.splats;
        if let Some(capacity) = brought.capacity {
            self.tell(Message::Grown { what: "splats", capacity: capacity.into(), replay_from: step });
        }
    }

    fn propagate(&mut self) -> Result<(), Error> {
        let (Some(ratio), step) = (self.propagates(), self.next.step) else { return Ok(()) };
        let degree = self.schedule.step(step).sh_degree;
        let brought = self.engine.propagate(self.schedule.view_at(step), ratio, degree)?;
        self.propagated = step;
        self.count_in(&brought, step);
        let (added, share, splats) = (brought.splats, brought.share, self.last_splats);
        self.tell(Message::Propagated { step, added, share, splats });
        Ok(())
    }
}

/// The weight below which this share of the splats lies.
fn quantile(weights: &[f32], share: f64) -> f64 {
    let mut sorted = weights.to_vec();
    let rank = (share * weights.len() as f64) as usize;
    if rank >= sorted.len() {
        return 0.0;
    }
    let (_, weight, _) = sorted.select_nth_unstable_by(rank, f32::total_cmp);
    // What has no weight at all goes in any case.
    f64::from(weight.max(f32::MIN_POSITIVE))
}
