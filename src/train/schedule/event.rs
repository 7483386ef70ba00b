//! Events: the parts of a training that are done, undone and replayed as a whole.

use super::Schedule;

/// What an event does to the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Render a view, compare the render with the photograph, take one optimiser step.
    Step,
    /// Clone, split and prune.
    Density,
    /// Clamp the opacities.
    Reset,
}

/// One event. Events are ordered and numbered, and the schedule alone decides which events exist, so a lost event can
/// be found and replayed from its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Event {
    /// Training step, from 1.
    pub step: u32,
    /// What happens.
    pub kind: Kind,
}

impl Event {
    /// The first event of a step.
    pub const fn of_step(step: u32) -> Self {
        Self { step, kind: Kind::Step }
    }

    /// Number that the device stores when the event is done, ascending; 0 stands for no event.
    pub fn number(self) -> u32 {
        3 * self.step + self.kind as u32
    }

    /// The event with a number; `None` for numbers before the first step.
    pub fn of_number(number: u32) -> Option<Self> {
        let kind = match number % 3 {
            0 => Kind::Step,
            1 => Kind::Density,
            _ => Kind::Reset,
        };
        (number >= 3).then_some(Self { step: number / 3, kind })
    }

    /// The event that follows.
    pub fn next(self, schedule: &Schedule) -> Self {
        let plan = schedule.step(self.step);
        if self.kind < Kind::Density && plan.densify.is_some() {
            Self { kind: Kind::Density, ..self }
        } else if self.kind < Kind::Reset && plan.reset_opacity {
            Self { kind: Kind::Reset, ..self }
        } else {
            Self::of_step(self.step + 1)
        }
    }

    /// The event that follows the event with the number `done`.
    pub fn after(done: u32, schedule: &Schedule) -> Self {
        Self::of_number(done).map_or(Self::of_step(1), |event| event.next(schedule))
    }
}
