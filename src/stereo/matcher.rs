//! PatchMatch on the device, view by view, and the consistency check between views.

use super::device_state::DeviceState;
use super::{Error, Prior, Settings, StereoView};
use crate::pass::stereo::{BLOCKS, FILTER, REFIT, SWEEP};
use crate::vk::{Gpu, Pipeline, Ticket};

/// Largest number of views in flight on the device.
const IN_FLIGHT: usize = 3;

/// Matches views on a device.
pub struct Matcher {
    pub(super) gpu: Gpu,
    pub(super) settings: Settings,
    pub(super) blocks: Pipeline,
    pub(super) sweep: Pipeline,
    pub(super) filter: Pipeline,
    pub(super) refit: Pipeline,
}

impl Matcher {
    /// Creates the pipelines. Fails where a setting is out of its range.
    pub fn new(gpu: &Gpu, settings: &Settings) -> Result<Self, Error> {
        settings.check()?;
        Ok(Self {
            gpu: gpu.clone(),
            settings: settings.clone(),
            blocks: gpu.pipeline(&BLOCKS.kernel, &[])?,
            sweep: gpu.pipeline(&SWEEP.kernel, &[("STEP", settings.step), ("SIDE", settings.taps)])?,
            filter: gpu.pipeline(&FILTER.kernel, &[])?,
            refit: gpu.pipeline(&REFIT.kernel, &[])?,
        })
    }

    /// Depth, normals and confidence of every view, at the size of the view's camera; all zero for views without
    /// sources. `done` receives the progress, from 0 to 1. Equal inputs give equal bits on one device.
    pub fn run(&self, views: &[StereoView], mut done: impl FnMut(f64)) -> Result<Vec<Prior>, Error> {
        for (number, view) in views.iter().enumerate() {
            view.check(number, views.len())?;
        }
        if views.iter().all(|view| view.pixels() == 0) {
            return Ok(views.iter().map(|view| Prior::new(&view.camera, &[])).collect());
        }
        let work = DeviceState::new(self, views)?;
        let rounds = 1 + self.settings.rounds;
        let steps = (rounds as usize * views.len()) as f64;
        for round in 0..rounds {
            let mut tickets: Vec<Ticket> = Vec::new();
            for number in 0..views.len() {
                tickets.push(work.matched(number, round)?);
                if let Some(oldest) = tickets.len().checked_sub(IN_FLIGHT) {
                    self.gpu.wait(tickets[oldest])?;
                }
                done((round as usize * views.len() + number + 1) as f64 / steps);
            }
            // All views are checked against the planes of the same round.
            for number in 0..views.len() {
                work.checked(number)?;
            }
        }
        (0..views.len()).map(|number| work.prior(number)).collect()
    }
}
