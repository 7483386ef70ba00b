//! Priors and splats that come while training goes on.

use std::sync::Arc;

use super::{Engine, Propagation};
use crate::pass::counters;
use crate::raster::{PLANES, Planes, most_splats, planes_of};
use crate::scene::Gaussians;
use crate::train::Error;
use crate::train::input::Input;

/// What a propagation has brought.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Brought {
    /// Splats that were added.
    pub splats: u32,
    /// Share of the view's pixels that have a depth.
    pub share: f64,
    /// Splats that there is room for, where that has grown.
    pub capacity: Option<u32>,
}

impl Engine {
    pub(super) fn propagation_of(&self, input: &Input) -> Result<Option<Arc<Propagation>>, Error> {
        let Some(scene) = &input.known.scene else { return Ok(None) };
        let sizes = self.views.cameras.iter().map(|c| (c.width, c.height)).collect();
        Ok(Some(Arc::new(Propagation::new(&self.gpu, scene.clone(), sizes, &self.settings.geometry)?)))
    }

    /// Propagates the depths of a view, which are its prior from then on, and adds splats where those rendered differ by more than
    /// `ratio` of them. To be called when everything submitted is done. Waits.
    pub fn propagate(&mut self, view: usize, ratio: f64, sh_degree: u32) -> Result<Brought, Error> {
        let Some(propagation) = self.propagation.clone() else { return Ok(Brought::default()) };
        let together = propagation.together(view);
        if together.is_empty() {
            return Ok(Brought::default());
        }
        let mut renders = Vec::with_capacity(together.len());
        for camera in together.iter().filter_map(|other| propagation.camera(*other)) {
            renders.push(self.picture(&camera, sh_degree, [0.0; 3], true)?);
        }
        let found = propagation.found(&together, &renders, ratio)?;
        if let Some(geometry) = &mut self.terms.geometry {
            geometry.set(&self.gpu, view, &found.prior)?;
        }
        Ok(Brought { share: found.prior.share(), ..self.append(&found.splats)? })
    }

    /// Adds the splats of what lies where no photograph looks. To be called when everything submitted is done. Waits.
    pub fn add_skirt(&mut self) -> Result<Brought, Error> {
        self.skirt.clone().map_or(Ok(Brought::default()), |skirt| self.append(&skirt))
    }

    /// Adds splats behind the others, with moments and statistics of zero, as many as may be and fit. Waits.
    fn append(&mut self, new: &Gaussians) -> Result<Brought, Error> {
        let before = self.size.splats;
        let mut words: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        let (splats, next_id) = (words[counters::SPLATS], words[counters::NEXT_ID]);
        let limits = self.most_splats.into_iter().chain(self.settings.density.max_splats);
        let most = limits.chain([most_splats(&self.gpu)]).min().unwrap_or(0);
        let wanted = splats.saturating_add(new.len() as u32).min(most.max(splats));
        let more = self.room_for(wanted, &words)?.min(wanted) - splats;
        if more == 0 {
            return Ok(Brought::default());
        }
        let rows =
            |width: u32| 4 * u64::from(width) * u64::from(splats)..4 * u64::from(width) * u64::from(splats + more);
        let mut recorder = self.gpu.recorder("append")?;
        let moments: Vec<&Planes> = [self.optimiser.first()].into_iter().chain(self.optimiser.second()).collect();
        for (k, (values, (_, width))) in planes_of(new).into_iter().zip(PLANES).enumerate() {
            let values = values.get(..(width * more) as usize).unwrap_or_default();
            recorder.upload(&self.model.buffers()[k], rows(width).start, bytemuck::cast_slice(values))?;
            for planes in &moments {
                recorder.fill(planes.buffers()[k].slice(rows(width)), 0)?;
            }
        }
        recorder.fill(self.statistics.stats().slice(rows(4)), 0)?;
        if let Some(scores) = self.statistics.scores() {
            recorder.fill(scores.slice(rows(2)), 0)?;
        }
        let ids: Vec<u32> = (next_id..next_id.saturating_add(more)).collect();
        recorder.upload(&self.ids, rows(1).start, bytemuck::cast_slice(&ids))?;
        (words[counters::SPLATS], words[counters::NEXT_ID]) = (splats + more, next_id.saturating_add(more));
        recorder.upload(&self.renderer.counters, 0, bytemuck::cast_slice(&words))?;
        self.gpu.wait(recorder.submit()?)?;
        let capacity = (self.size.splats > before).then_some(self.size.splats);
        Ok(Brought { splats: more, share: 0.0, capacity })
    }
}
