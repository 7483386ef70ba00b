//! What a trainer does when a buffer was too small.

use super::{Message, Trainer};
use crate::numbers::counted;
use crate::train::Error;
use crate::train::schedule::{Event, Kind};

impl Trainer {
    /// Waits for the events in flight, grows what was too small, clears the status and goes back to the first lost
    /// event.
    pub(super) fn recover(&mut self) -> Result<(), Error> {
        self.in_flight.clear();
        let (done, grown) = match self.engine.grow() {
            Ok(grown) => grown,
            Err(error) => return Err(self.saved_before(error)),
        };
        self.next = Event::after(done, &self.schedule);
        for (what, capacity) in grown {
            self.tell(Message::Grown { what, capacity, replay_from: self.next.step });
        }
        Ok(())
    }

    /// Saves a checkpoint before an error that ends the training, if checkpoints are kept and the last step is whole.
    fn saved_before(&mut self, error: Error) -> Error {
        if self.checkpoints.is_none() {
            return error;
        }
        let Ok(done) = self.engine.clear_overflow() else { return error };
        self.next = Event::after(done, &self.schedule);
        // A host action that ran before the failed step has changed the model: the step would have to be done first.
        let changed = self.actions.done() >= self.next.step;
        if self.next.kind != Kind::Step || self.next.step <= 1 || changed {
            return error;
        }
        match (self.save_checkpoint(), error) {
            (Ok((_, file)), Error::MemoryLimit { what, wanted, needed, room, in_use, limit, .. }) => {
                Error::MemoryLimit { what, wanted, needed, room, in_use, limit, saved: Some(file) }
            }
            (_, error) => error,
        }
    }

    /// Warns once that memory has stopped growth.
    pub(super) fn warn_of_full_memory(&mut self, step: u32, splats: u32) {
        let Some(most) = self.engine.most_splats() else { return };
        let asked = self.settings.density.max_splats.is_some_and(|max| max <= most);
        if self.told_full || asked || splats < most {
            return;
        }
        self.told_full = true;
        self.tell(Message::Warning(format!(
            "step {step}: growth stops at {}, because the device memory that may be used has room for no more; \
             raise `max-device-memory`, or lower `max-side`",
            counted(splats, "splat")
        )));
    }
}
