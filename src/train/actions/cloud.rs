//! Growth keeps to a cloud: splats far from the cloud do not grow in a density change.

use std::sync::Arc;

use super::{Change, HostAction};
use crate::raster::MEANS;
use crate::train::Error;
use crate::train::cloud::ProximityIndex;
use crate::train::engine::Engine;
use crate::train::schedule::{Event, Kind, Schedule};

pub(super) struct KeepToCloud {
    gate: Option<Arc<ProximityIndex>>,
}

impl KeepToCloud {
    /// Without a `gate` splats grow everywhere.
    pub(super) fn new(gate: Option<Arc<ProximityIndex>>) -> Self {
        Self { gate }
    }
}

impl HostAction for KeepToCloud {
    fn due(&self, _: &Schedule, event: Event) -> bool {
        self.gate.is_some() && event.kind == Kind::Density
    }

    /// The schedule makes up for missed steps before every density change.
    fn catches_up(&self) -> bool {
        false
    }

    fn run(&mut self, engine: &mut Engine, _: &Schedule, _: u32) -> Result<Option<Change>, Error> {
        let Some(gate) = &self.gate else { return Ok(None) };
        let means = engine.rows(MEANS, engine.splats()?)?;
        engine.limit_growth_to(&gate.near(&means))?;
        Ok(None)
    }
}
