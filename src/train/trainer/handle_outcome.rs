//! Handles the outcome of an event: messages, and learning of the saliency filter's width.

use super::{Message, Trainer};
use crate::numbers::{counted, of_count};
use crate::pass::counters;
use crate::train::Error;
use crate::train::engine::Outcome;
use crate::train::schedule::{Event, Kind};

impl Trainer {
    pub(super) fn look(&mut self, event: Event, outcome: Outcome) -> Result<(), Error> {
        if outcome.counters[counters::STATUS] != 0 {
            return self.recover();
        }
        let splats = outcome.counters[counters::SPLATS];
        match event.kind {
            Kind::Step => {
                if outcome.counters[counters::BAD_SPLATS] > 0 {
                    self.warn_of_bad_splats(event.step, outcome.counters[counters::BAD_SPLATS]);
                }
                if !outcome.loss.is_finite() {
                    return Err(Error::LossNotFinite { step: event.step });
                }
                let plan = self.schedule.step(event.step);
                if plan.learn_sigma
                    && let Some(learned) =
                        self.engine.learn_sigma(&plan, self.schedule.view_at(event.step), outcome.ticket)?
                {
                    self.tell(Message::Sigma { step: event.step, learned });
                }
                self.tell(Message::Step {
                    step: event.step,
                    loss: outcome.loss,
                    splats,
                    pairs: outcome.counters[counters::PAIRS],
                    seconds: self.seconds(),
                });
            }
            Kind::Density => {
                self.told_bad_splats = false;
                self.tell(Message::Density {
                    step: event.step,
                    cloned: outcome.counters[counters::CLONED],
                    split: outcome.counters[counters::SPLIT],
                    pruned: outcome.counters[counters::PRUNED],
                    splats,
                });
                self.warn_of_full_memory(event.step, splats);
                if splats == 0 && self.last_splats > 0 {
                    self.tell(Message::Warning(format!(
                        "step {}: every splat was pruned; the model is empty from here on",
                        event.step
                    )));
                }
            }
            Kind::Reset => self.tell(Message::OpacityReset { step: event.step }),
        }
        self.last_splats = splats;
        Ok(())
    }

    fn warn_of_bad_splats(&mut self, step: u32, count: u32) {
        if !self.told_bad_splats {
            self.told_bad_splats = true;
            self.tell(Message::Warning(format!(
                "step {step}: {} with values that are not finite {} left out, until the next density change drops {}",
                counted(count, "splat"),
                of_count(count, "is", "are"),
                of_count(count, "it", "them")
            )));
        }
    }
}
