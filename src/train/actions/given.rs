//! What a training is given besides photographs and a first model: a cloud and a region that growth keeps to, and
//! splats where no photograph looks.

use std::sync::Arc;

use super::{Change, HostAction};
use crate::raster::MEANS;
use crate::scene::{Gaussians, Region};
use crate::train::Error;
use crate::train::cloud::ProximityIndex;
use crate::train::engine::Engine;
use crate::train::input::OptionalInput;
use crate::train::message::Message;
use crate::train::schedule::{Event, Kind, Schedule};

/// Splats far from the cloud, or outside of the region, do not grow in a density change.
pub(super) struct KeepInside {
    gate: Option<Arc<ProximityIndex>>,
    region: Option<Region>,
}

impl KeepInside {
    /// Without a cloud and a region splats grow everywhere.
    pub(super) fn new(given: &OptionalInput) -> Self {
        Self { gate: given.gate.clone(), region: given.part.as_ref().and_then(|part| part.region()) }
    }

    fn growing(&self, means: &[f32]) -> Vec<bool> {
        let mut growing = match &self.gate {
            Some(gate) => gate.near(means),
            None => vec![true; means.len() / 3],
        };
        let [_, outside] = self.region.map(|region| region.divided(means)).unwrap_or_default();
        outside.into_iter().for_each(|row| growing[row as usize] = false);
        growing
    }
}

impl HostAction for KeepInside {
    fn due(&self, _: &Schedule, event: Event) -> bool {
        (self.gate.is_some() || self.region.is_some()) && event.kind == Kind::Density
    }

    /// The schedule makes up for missed steps before every density change.
    fn catches_up(&self) -> bool {
        false
    }

    fn run(&mut self, engine: &mut Engine, _: &Schedule, _: u32) -> Result<Option<Change>, Error> {
        let means = engine.rows(MEANS, engine.splats()?)?;
        engine.limit_growth_to(&self.growing(&means))?;
        Ok(None)
    }
}

/// Adds splats where no photograph looks.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::Part;

    #[test]
    fn splats_outside_of_cell_and_margin_do_not_grow() {
        let (origin, axes) = ([0.0; 3], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        let cell = Region { origin, axes, low: [-1.0, f64::NEG_INFINITY], high: [1.0, 1.0] };
        let part = Part { cell: Some(cell), margin: 0.5, ..Part::default() };
        let means = [[0.0, 0.0, 9.0], [1.4, 1.4, 0.0], [1.6, 0.0, 0.0], [-1.6, 0.0, 0.0], [0.0, -99.0, 0.0]].concat();
        let growing = |given: &OptionalInput| KeepInside::new(given).growing(&means);
        let of_part = OptionalInput { part: Some(Arc::new(part)), ..OptionalInput::default() };
        assert_eq!(growing(&of_part), [true, true, false, false, true]);
        assert_eq!(growing(&OptionalInput::default()), [true; 5]);
    }
}
