//! What the host does to the model between steps. An action has a file of its own, implements [`HostAction`], and stands in
//! [`Actions::new`]; the trainer knows none by name.

mod cloud;
mod propagate;
mod propagation;
mod prune;
mod skirt;
mod sparse_sh;

use super::Error;
use super::engine::{Appended, Engine};
use super::input::Input;
use super::message::Message;
use super::schedule::{Event, Schedule};
use super::settings::Settings;
use crate::vk::Gpu;

use cloud::KeepToCloud;
use propagate::Propagate;
use prune::Prune;
use skirt::AddSkirt;
use sparse_sh::SettleHarmonics;

/// Something that the host does before an event.
pub(super) trait HostAction: Send + Sync {
    /// Whether it may be due before an event: by the schedule alone, so that a run is the same however many events are on their way.
    fn due(&self, schedule: &Schedule, event: Event) -> bool;

    /// Does it before a step. Everything submitted is done, and no more is submitted meanwhile. `None` where nothing was done that would be
    /// wrong to do again when the event is repeated.
    fn run(&mut self, engine: &mut Engine, schedule: &Schedule, step: u32) -> Result<Option<Change>, Error>;
}

/// What an action has changed.
#[derive(Debug, Default)]
pub(super) struct Change {
    /// Splats after it, where there may be more or fewer.
    pub(super) splats: Option<u32>,
    /// Splats that there is room for, where that has grown.
    pub(super) capacity: Option<u32>,
    /// What is to be told.
    pub(super) message: Option<Message>,
}

impl Change {
    fn appended(of: Appended, message: Option<Message>) -> Self {
        Self { splats: Some(of.splats), capacity: of.capacity, message }
    }
}

/// The actions of a training, in the order in which they come before one event.
pub(super) struct Actions {
    planned: Vec<Planned>,
}

struct Planned {
    action: Box<dyn HostAction>,
    /// The step before which it was done last: one that is repeated has the action behind itself.
    done: u32,
}

impl Planned {
    fn is_due(&self, schedule: &Schedule, event: Event) -> bool {
        self.done < event.step && self.action.due(schedule, event)
    }
}

impl Actions {
    /// Of a training that goes on after `step`.
    pub(super) fn new(gpu: &Gpu, input: &Input, settings: &Settings, step: u32) -> Result<Self, Error> {
        let known = &input.known;
        let actions: [Box<dyn HostAction>; 5] = [
            Box::new(KeepToCloud::new(known.gate.clone())),
            Box::new(Propagate::new(gpu, input, &settings.geometry)?),
            Box::new(Prune),
            Box::new(SettleHarmonics),
            Box::new(AddSkirt::new(known.skirt.clone())),
        ];
        Ok(Self { planned: actions.into_iter().map(|action| Planned { action, done: step }).collect() })
    }

    /// Whether some action may be due before an event.
    pub(super) fn are_due(&self, schedule: &Schedule, event: Event) -> bool {
        self.planned.iter().any(|planned| planned.is_due(schedule, event))
    }

    /// Does what is due before an event.
    pub(super) fn run(&mut self, engine: &mut Engine, schedule: &Schedule, event: Event) -> Result<Vec<Change>, Error> {
        let mut changes = Vec::new();
        for planned in &mut self.planned {
            if planned.is_due(schedule, event)
                && let Some(change) = planned.action.run(engine, schedule, event.step)?
            {
                planned.done = event.step;
                changes.push(change);
            }
        }
        Ok(changes)
    }

    /// The last step before which something was done.
    pub(super) fn done(&self) -> u32 {
        self.planned.iter().map(|planned| planned.done).max().unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::schedule::Kind;

    /// Due before every step.
    struct Always;

    impl HostAction for Always {
        fn due(&self, _: &Schedule, event: Event) -> bool {
            event.kind == Kind::Step
        }

        fn run(&mut self, _: &mut Engine, _: &Schedule, _: u32) -> Result<Option<Change>, Error> {
            Ok(Some(Change::default()))
        }
    }

    #[test]
    fn a_step_that_is_repeated_has_its_actions_behind_itself() {
        let schedule = Schedule::new(&Settings::default(), 3);
        let planned = |done| Planned { action: Box::new(Always), done };
        let actions = Actions { planned: vec![planned(5), planned(4)] };
        assert_eq!(actions.done(), 5);
        assert!(actions.planned[1].is_due(&schedule, Event::of_step(5)), "that one was not done before step 5");
        assert!(!actions.planned[0].is_due(&schedule, Event::of_step(5)));
        assert!(actions.are_due(&schedule, Event::of_step(6)));
        assert!(!actions.are_due(&schedule, Event { step: 6, kind: Kind::Density }));
    }
}
