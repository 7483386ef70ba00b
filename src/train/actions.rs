//! What the host does to the model between steps. Each action has a file of its own, implements [`HostAction`], and is
//! listed in [`Actions::new`]; nothing else knows an action by name.

mod confine;
mod footprint;
mod given;
mod propagate;
mod propagation;
mod prune;
mod relocate;
mod sparse_sh;
mod split_wide;

use super::Error;
use super::engine::{Appended, Engine};
use super::input::Input;
use super::message::Message;
use super::schedule::{Event, Schedule};
use super::settings::Settings;
use crate::vk::Gpu;

use confine::Confine;
use given::{AddSkirt, KeepInside};
use propagate::Propagate;
use prune::Prune;
use relocate::Relocate;
pub(super) use relocate::Relocation;
use sparse_sh::SettleHarmonics;
use split_wide::SplitWide;

/// Something that the host does before an event.
pub(super) trait HostAction: Send + Sync {
    /// Whether the action may be due before an event. Depends on the schedule alone, so that a run does not depend on
    /// how many events are in flight.
    fn due(&self, schedule: &Schedule, event: Event) -> bool;

    /// Whether the step before the action makes up for all missed optimiser steps: so for an action that moves rows or
    /// reads what the optimiser has not stepped.
    fn catches_up(&self) -> bool;

    /// Runs the action before a step. Everything submitted is done, and nothing is submitted meanwhile. `None` if the
    /// action may run again when the event is repeated.
    fn run(&mut self, engine: &mut Engine, schedule: &Schedule, step: u32) -> Result<Option<Change>, Error>;
}

/// What an action has changed.
#[derive(Debug, Default)]
pub(super) struct Change {
    /// Splats after the action, if their number may have changed.
    pub(super) splats: Option<u32>,
    /// Splats that there is room for, if the capacity has grown.
    pub(super) capacity: Option<u32>,
    /// Message about the action.
    pub(super) message: Option<Message>,
}

impl Change {
    fn appended(of: Appended, message: Option<Message>) -> Self {
        Self { splats: Some(of.splats), capacity: of.capacity, message }
    }
}

/// The actions of a training, in the order in which they run before an event.
pub(super) struct Actions {
    planned: Vec<Planned>,
}

struct Planned {
    action: Box<dyn HostAction>,
    /// The step before which the action ran last. It does not run again when that step is repeated.
    done: u32,
}

impl Planned {
    fn is_due(&self, schedule: &Schedule, event: Event) -> bool {
        self.done < event.step && self.action.due(schedule, event)
    }
}

impl Actions {
    /// The actions of a training that goes on after `step`.
    pub(super) fn new(gpu: &Gpu, input: &Input, settings: &Settings, step: u32) -> Result<Self, Error> {
        let optional = &input.optional;
        let actions: [Box<dyn HostAction>; 8] = [
            Box::new(Confine::new(optional.part.clone())),
            Box::new(KeepInside::new(optional)),
            Box::new(Propagate::new(gpu, input, &settings.geometry)?),
            Box::new(Prune),
            Box::new(SplitWide::new(input, settings)),
            Box::new(Relocate::new(settings)),
            Box::new(SettleHarmonics),
            Box::new(AddSkirt::new(optional.skirt.clone())),
        ];
        Ok(Self { planned: actions.into_iter().map(|action| Planned { action, done: step }).collect() })
    }

    /// Whether some action may be due before an event.
    pub(super) fn are_due(&self, schedule: &Schedule, event: Event) -> bool {
        self.planned.iter().any(|planned| planned.is_due(schedule, event))
    }

    /// Whether some action before the next step wants `step` to make up for all missed optimiser steps. Depends on the
    /// schedule alone, so that a repeated step is the same.
    pub(super) fn catch_up_after(&self, schedule: &Schedule, step: u32) -> bool {
        let next = Event::of_step(step.saturating_add(1));
        self.planned.iter().any(|planned| planned.action.catches_up() && planned.action.due(schedule, next))
    }

    /// Runs the actions that are due before an event.
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

    /// The last step before which an action ran.
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

        fn catches_up(&self) -> bool {
            true
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
        assert!(actions.catch_up_after(&schedule, 4), "a step is the same when it is repeated");
        assert!(!actions.are_due(&schedule, Event { step: 6, kind: Kind::Density }));
    }
}
