//! Propagates the depths of a view: the depths found become the view's prior, and splats are added where the rendered
//! depth is far from the depth found.

use super::propagation::Propagation;
use super::{Change, HostAction};
use crate::train::Error;
use crate::train::engine::Engine;
use crate::train::input::Input;
use crate::train::message::Message;
use crate::train::schedule::{Event, Kind, Schedule};
use crate::train::settings::Geometry;
use crate::vk::Gpu;

pub(super) struct Propagate {
    propagation: Option<Propagation>,
}

impl Propagate {
    /// Propagates only if the input has the views as stereo sees them.
    pub(super) fn new(gpu: &Gpu, input: &Input, settings: &Geometry) -> Result<Self, Error> {
        let Some(scene) = &input.optional.scene else { return Ok(Self { propagation: None }) };
        let sizes = input.train.iter().map(|view| (view.camera.width, view.camera.height)).collect();
        Ok(Self { propagation: Some(Propagation::new(gpu, scene.clone(), sizes, settings)?) })
    }
}

impl HostAction for Propagate {
    fn due(&self, schedule: &Schedule, event: Event) -> bool {
        event.kind == Kind::Step && schedule.propagates(event.step).is_some()
    }

    fn catches_up(&self) -> bool {
        true
    }

    fn run(&mut self, engine: &mut Engine, schedule: &Schedule, step: u32) -> Result<Option<Change>, Error> {
        let Some(ratio) = schedule.propagates(step) else { return Ok(None) };
        let (view, sh_degree) = (schedule.view_at(step), schedule.step(step).sh_degree);
        let together = self.propagation.as_ref().map_or(Vec::new(), |propagation| propagation.together(view));
        let Some(propagation) = self.propagation.as_ref().filter(|_| !together.is_empty()) else {
            let splats = engine.splats()?;
            let message = Message::Propagated { step, added: 0, share: 0.0, splats };
            return Ok(Some(Change { message: Some(message), ..Change::default() }));
        };
        let mut renders = Vec::with_capacity(together.len());
        for camera in together.iter().filter_map(|other| propagation.camera(*other)) {
            renders.push(engine.picture(&camera, sh_degree, [0.0; 3], true)?);
        }
        let found = propagation.found(&together, &renders, ratio)?;
        engine.set_prior(view, &found.prior)?;
        let appended = engine.append(&found.splats)?;
        let (added, share, splats) = (appended.added, found.prior.share(), appended.splats);
        Ok(Some(Change::appended(appended, Some(Message::Propagated { step, added, share, splats }))))
    }
}
