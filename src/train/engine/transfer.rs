//! Initial contents of an engine, and reading back its model and state.

use super::{Engine, MemoryCost};
use crate::pass::camera::{NEAR, Projection};
use crate::pass::counters;
use crate::raster::{
    DepthProbe, LiveModel, Look, MemoryFootprint, PLANES, Picture, Planes, RenderView, SH_HIGHER, Shown, gaussians_of,
    planes_of,
};
use crate::saliency::Curve;
use crate::scene::ExposureMatrix;
use crate::scene::{Camera, Gaussians, rows_of};
use crate::train::Error;
use crate::train::learning::exposures::{self, Exposures};
use crate::train::state::State;

impl Engine {
    pub(super) fn begin(&mut self, initial: &Gaussians) -> Result<(), Error> {
        let n = initial.len() as u32;
        // One plane after the other, so that the host holds only one plane twice.
        if n > 0 {
            let order = initial.morton_order();
            let planes = if self.has_plain_splats() { SH_HIGHER } else { PLANES.len() };
            for (plane, rows) in self.model.layout().into_iter().zip(planes_of(initial)).take(planes) {
                self.gpu.write(plane.buffer, &rows_of(rows, plane.floats as usize, &order))?;
            }
            self.gpu.write(&self.ids, &rows_of(&initial.ids, 1, &order))?;
        }
        if let Some(exposures) = &self.exposures {
            exposures.begin(&self.gpu)?;
        }
        let mut recorder = self.gpu.recorder("begin")?;
        self.optimiser.clear(&mut recorder)?;
        if self.has_plain_splats() {
            self.model.clear_upper(&mut recorder)?;
        }
        self.statistics.clear(&mut recorder)?;
        let mut words = vec![0u32; counters::COUNT];
        words[counters::SPLATS] = n;
        words[counters::PLAIN] = if self.has_plain_splats() { u32::MAX } else { 0 };
        words[counters::NEXT_ID] = initial.ids.iter().max().map_or(0, |id| id + 1);
        recorder.upload(&self.renderer.counters, 0, bytemuck::cast_slice(&words))?;
        recorder.submit()?;
        Ok(())
    }

    pub(super) fn restore(&mut self, state: &State) -> Result<(), Error> {
        if self.has_plain_splats() {
            let mut recorder = self.gpu.recorder("restore")?;
            self.model.clear_upper(&mut recorder)?;
            self.optimiser.clear(&mut recorder)?;
            self.gpu.wait(recorder.submit()?)?;
        }
        self.model.write_rows(&self.gpu, &state.params)?;
        self.optimiser.restore(&self.gpu, &state.moments)?;
        if !state.ids.is_empty() {
            self.gpu.write(&self.ids, &state.ids)?;
        }
        self.statistics.restore(&self.gpu, &state.stats, &state.scores)?;
        if let Some(exposures) = &self.exposures {
            exposures.restore(&self.gpu, &state.exposures)?;
        }
        self.terms.restore(&self.gpu, state)?;
        self.gpu.write(&self.renderer.counters, &state.counters)?;
        Ok(())
    }

    /// Cost of the buffers that count as device memory.
    pub fn memory(&self) -> MemoryCost {
        let of_splats = [
            self.model.bytes(),
            self.optimiser.bytes(),
            self.ids.size(),
            self.statistics.bytes(),
            self.density.bytes(),
        ];
        let [of_pixels, fixed] = self.exposures.as_ref().map_or([0; 2], Exposures::bytes);
        let own = MemoryFootprint {
            splats: of_splats.iter().sum(),
            pixels: self.target.bytes() + of_pixels,
            fixed: self.reports.bytes(&self.gpu) + fixed,
            ..MemoryFootprint::default()
        };
        MemoryCost::new(
            own + self.terms.footprint() + self.views.footprint() + self.renderer.held(),
            [self.size.splats, self.size.pairs, self.target.pixels],
            self.views.photographs.bytes(&self.gpu),
        )
    }

    /// The model, read back. Waits.
    pub fn model(&self) -> Result<Gaussians, Error> {
        let n = self.splats()?;
        let ids = if n > 0 { self.gpu.read_at(&self.ids, 0, n as usize)? } else { Vec::new() };
        Ok(gaussians_of(self.model.read(&self.gpu, n)?, ids))
    }

    /// Renders the current model with spherical harmonics up to `sh_degree`. Waits.
    pub fn picture(
        &mut self,
        camera: &Camera,
        sh_degree: u32,
        background: [f32; 3],
        aux: bool,
    ) -> Result<Picture, Error> {
        let splats = self.splats()?;
        let shot = self.view_shot(camera, sh_degree, background);
        Ok(self.viewer.render(&self.model, splats, &shot, aux)?)
    }

    /// Draws the model as it is on the device. Waits.
    pub fn look(&mut self, view: &RenderView, look: Look) -> Result<Picture, Error> {
        let words: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        // Without a bound there is no part yet.
        let ids = Some((&self.ids, words[counters::CONSTRAINED])).filter(|(_, below)| *below > 0);
        let shown = Shown { planes: &self.model, splats: words[counters::SPLATS], ids };
        Ok(self.viewer.look(shown, view, look)?)
    }

    /// Depths of the model at the pixels of a camera, and weights in front of and behind `known` depths. Waits.
    pub fn probe(&mut self, camera: &Camera, sh_degree: u32, known: Option<&[f32]>) -> Result<DepthProbe, Error> {
        let splats = self.splats()?;
        let view = self.view_shot(camera, sh_degree, [0.0; 3]);
        Ok(self.viewer.probe(&self.model, splats, &view, known)?)
    }

    /// The view to render from a camera outside of training steps.
    pub fn view_shot(&self, camera: &Camera, sh_degree: u32, background: [f32; 3]) -> RenderView {
        let projection = Projection {
            sh_degree,
            near: NEAR,
            antialias: self.settings.model.antialias,
            reference_clamp: false,
            black_learns: false,
            orthographic: false,
            limits: None,
            alpha_cutoff: None,
        };
        RenderView { camera: *camera, projection, background }
    }

    /// The model's planes.
    pub fn planes(&self) -> &Planes {
        &self.model
    }

    /// A handle with which a host can render the model.
    pub fn live_model(&self) -> LiveModel {
        LiveModel::new(self.model.clone(), self.renderer.counters.clone())
    }

    /// Splats in the model. Waits.
    pub fn splats(&self) -> Result<u32, Error> {
        let words: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        Ok(words[counters::SPLATS])
    }

    /// Splats with an identity below this are the constrained set; `None` without such a set. Waits.
    pub fn constrained_below(&self) -> Result<Option<u32>, Error> {
        let words: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        Ok(Some(words[counters::CONSTRAINED]).filter(|bound| *bound > 0))
    }

    /// The loss of a view over the width of the saliency filter; `None` if the width is not learned or nothing can be
    /// learned from the view. Waits.
    pub fn sigma_curve(&mut self, view: usize, sh_degree: u32, background: [f32; 3]) -> Result<Option<Curve>, Error> {
        if self.terms.sigma.is_none() {
            return Ok(None);
        }
        let camera = *self.views.cameras.get(view).ok_or(Error::NoViews)?;
        let mut picture = self.picture(&camera, sh_degree, background, false)?;
        // The exposed render is compared with the photograph, as in training.
        if let Some(exposure) = self.exposures()?.as_ref().and_then(|exposures| exposures.get(view)) {
            picture = picture.exposed(exposure);
        }
        self.terms.sigma.as_ref().map_or(Ok(None), |sigma| sigma.curve(view, &picture.rgbt))
    }

    /// The state for a restart, read back. Waits.
    pub fn state(&self) -> Result<State, Error> {
        let counters: Vec<u32> = self.gpu.read_at(&self.renderer.counters, 0, counters::COUNT)?;
        let n = counters[counters::SPLATS];
        let ids = if n > 0 { self.gpu.read_at(&self.ids, 0, n as usize)? } else { Vec::new() };
        let [stats, scores] = self.statistics.read(&self.gpu, n)?;
        let mut state = State {
            params: self.model.read(&self.gpu, n)?,
            ids,
            moments: self.optimiser.read(&self.gpu, n)?,
            stats,
            scores,
            counters,
            exposures: self.exposures.as_ref().map_or(Ok(Vec::new()), |e| e.state(&self.gpu))?,
            sigma: String::new(),
            priors: Vec::new(),
        };
        self.terms.save(&self.gpu, &mut state)?;
        Ok(state)
    }

    /// The photographs' exposures in the order of the views; `None` where they are off. Waits.
    pub fn exposures(&self) -> Result<Option<Vec<ExposureMatrix>>, Error> {
        let Some(exposures) = &self.exposures else { return Ok(None) };
        Ok(Some(exposures::matrices(&exposures.state(&self.gpu)?)))
    }
}
