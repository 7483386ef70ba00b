//! Adds splats where no photograph looks.

use std::sync::Arc;

use super::{Change, HostAction};
use crate::scene::Gaussians;
use crate::train::Error;
use crate::train::engine::Engine;
use crate::train::message::Message;
use crate::train::schedule::{Event, Kind, Schedule};

pub(super) struct AddSkirt {
    skirt: Option<Arc<Gaussians>>,
}

impl AddSkirt {
    pub(super) fn new(skirt: Option<Arc<Gaussians>>) -> Self {
        Self { skirt }
    }
}

impl HostAction for AddSkirt {
    fn due(&self, schedule: &Schedule, event: Event) -> bool {
        event.kind == Kind::Step && schedule.skirts(event.step)
    }

    fn catches_up(&self) -> bool {
        true
    }

    fn run(&mut self, engine: &mut Engine, _: &Schedule, step: u32) -> Result<Option<Change>, Error> {
        let Some(skirt) = &self.skirt else { return Ok(Some(Change::default())) };
        let appended = engine.append(skirt)?;
        let (added, splats) = (appended.added, appended.splats);
        let message = (added > 0).then_some(Message::Skirted { step, added, splats });
        Ok(Some(Change::appended(appended, message)))
    }
}
