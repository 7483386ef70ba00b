//! Pictures of a model, outside of training.

use super::live::LiveModel;
use super::picture::Picture;
use super::planes::Planes;
use super::planes::ShStorage;
use super::renderer::{Renderer, Shot};
use super::size::{Size, most_pairs};
use super::target::Target;
use super::tiles::DEPTH_BITS;
use super::variants::{GradientSum, Variants};
use crate::pass::counters;
use crate::scene::Gaussians;
use crate::vk::{self, Buffer, Done, Gpu, Memory, Recorder, SubmitSync, Ticket};

/// Renders pictures of models; grows as they need.
pub struct Viewer {
    gpu: Gpu,
    variants: Variants,
    size: Size,
    depth_bits: u32,
    renderer: Option<(Renderer, Target)>,
    /// Width, height and auxiliary channels of a picture to be collected.
    recorded: Option<(u32, u32, bool)>,
    /// Where the counters of a picture come to be read without waiting.
    landing: Option<Buffer>,
}

/// Whose splats are drawn, and how many.
#[derive(Clone, Copy)]
enum Drawn<'a> {
    First(&'a Planes, u32),
    Live(&'a LiveModel),
}

impl Drawn<'_> {
    fn planes(&self) -> &Planes {
        match self {
            Drawn::First(planes, _) => planes,
            Drawn::Live(model) => model.planes(),
        }
    }

    /// No more than these.
    fn most(&self) -> u32 {
        match self {
            Drawn::First(_, splats) => *splats,
            Drawn::Live(model) => model.planes().capacity(),
        }
    }
}

impl Viewer {
    /// A viewer that allocates at the first picture.
    pub fn new(gpu: &Gpu) -> Self {
        Self::with_variants(gpu, Variants::choose(gpu, false))
    }

    /// The same with these variants of the passes.
    pub fn with_variants(gpu: &Gpu, variants: Variants) -> Self {
        // Without a backward there are no slots, which would limit the pairs.
        let variants = Variants { gradients: GradientSum::CompareAndSwap, ..variants };
        let size = Size {
            splats: 1,
            pairs: 1,
            tiles: 1,
            aux: true,
            train: false,
            listed: false,
            count: false,
            clamp_gradient_passes: false,
        };
        Self { gpu: gpu.clone(), variants, size, depth_bits: DEPTH_BITS, renderer: None, recorded: None, landing: None }
    }

    /// Sorts by so many of the highest bits of a depth, for a comparison of speed and error: see
    /// [`TileLists::sort_depths_by`](super::tiles::TileLists::sort_depths_by).
    pub fn sort_depths_by(&mut self, bits: u32) {
        self.depth_bits = bits;
        self.renderer = None;
    }

    /// The model on the device, for [`Self::render`].
    pub fn upload(&self, model: &Gaussians) -> Result<Planes, vk::Error> {
        self.upload_with(model, ShStorage::Full)
    }

    /// The same with spherical harmonics stored so.
    pub fn upload_with(&self, model: &Gaussians, sh: ShStorage) -> Result<Planes, vk::Error> {
        let planes = Planes::with_sh(&self.gpu, "", model.len() as u32, sh)?;
        planes.write(&self.gpu, model)?;
        Ok(planes)
    }

    /// Renders the first `splats` splats of `model`. Waits.
    pub fn render(&mut self, model: &Planes, splats: u32, shot: &Shot, aux: bool) -> Result<Picture, vk::Error> {
        loop {
            let mut recorder = self.gpu.recorder("view")?;
            self.record(&mut recorder, model, splats, shot, aux)?;
            recorder.submit()?;
            if let Some(picture) = self.collect()? {
                return Ok(picture);
            }
        }
    }

    /// Makes room for pictures of a size of so many splats; their pairs are guessed.
    pub fn reserve(&mut self, splats: u32, width: u32, height: u32) -> Result<(), vk::Error> {
        let side = self.variants.tile.size();
        let tiles = width.div_ceil(side) * height.div_ceil(side);
        if self.size.splats < splats || self.size.tiles < tiles {
            self.size.splats = self.size.splats.max(splats);
            self.size.tiles = self.size.tiles.max(tiles);
            let guess = tiles.saturating_mul(24).max(splats.saturating_mul(4));
            self.size.pairs = self.size.pairs.max(guess.min(most_pairs(&self.gpu, self.variants)));
            self.renderer = None;
        }
        self.ready(width * height).map(|_| ())
    }

    /// Records a picture of the first `splats` splats of `model`, for a caller that submits it as a part of more,
    /// between semaphores of its own, or in a command buffer of its own ([`Recorder::record_into`]). Once it has been
    /// submitted to the device's queue, [`Self::collect`] gives the picture; [`Self::fits`] tells without waiting
    /// whether it is whole in [`Self::target`].
    pub fn record(
        &mut self,
        recorder: &mut Recorder,
        model: &Planes,
        splats: u32,
        shot: &Shot,
        aux: bool,
    ) -> Result<(), vk::Error> {
        self.record_drawn(recorder, Drawn::First(model, splats), shot, aux)
    }

    /// The same of a model that is being trained: of as many splats as it has when the device comes to this recording.
    pub fn record_live(
        &mut self,
        recorder: &mut Recorder,
        model: &LiveModel,
        shot: &Shot,
        aux: bool,
    ) -> Result<(), vk::Error> {
        self.record_drawn(recorder, Drawn::Live(model), shot, aux)
    }

    /// Records a picture as [`Self::record`] does and submits it between points of a host's timelines.
    /// Waits for nothing.
    pub fn submit(
        &mut self,
        model: &Planes,
        splats: u32,
        shot: &Shot,
        aux: bool,
        order: SubmitSync<'_>,
    ) -> Result<Ticket, vk::Error> {
        let mut recorder = self.gpu.recorder("view")?;
        self.record(&mut recorder, model, splats, shot, aux)?;
        recorder.submit_with(order)
    }

    /// As [`Self::submit`], of a model that is being trained.
    pub fn submit_live(
        &mut self,
        model: &LiveModel,
        shot: &Shot,
        aux: bool,
        order: SubmitSync<'_>,
    ) -> Result<Ticket, vk::Error> {
        let mut recorder = self.gpu.recorder("live view")?;
        self.record_live(&mut recorder, model, shot, aux)?;
        recorder.submit_with(order)
    }

    /// Raises `weights` (a float for each splat, as many as `splats`) to the largest weight, alpha times transmittance,
    /// that a splat has in any pixel of a picture. Waits.
    pub fn weigh(&mut self, model: &Planes, splats: u32, shot: &Shot, weights: &Buffer) -> Result<(), vk::Error> {
        let (width, height) = (shot.camera.width, shot.camera.height);
        loop {
            self.reserve(splats, width, height)?;
            let mut recorder = self.gpu.recorder("weights")?;
            let (renderer, target) = self.ready(width * height)?;
            let mut words = [0u32; counters::COUNT];
            (words[counters::SPLATS], words[counters::PLAIN]) = (splats, model.plain(splats));
            recorder.upload(&renderer.counters, 0, bytemuck::cast_slice(&words))?;
            renderer.record_weights(&mut recorder, model, shot, target, weights)?;
            let counters = renderer.counters.clone();
            recorder.submit()?;
            let words: Vec<u32> = self.gpu.read_at(&counters, 0, counters::COUNT)?;
            if !self.make_room(&words) {
                return Ok(());
            }
        }
    }

    fn record_drawn(
        &mut self,
        recorder: &mut Recorder,
        drawn: Drawn<'_>,
        shot: &Shot,
        aux: bool,
    ) -> Result<(), vk::Error> {
        let (width, height) = (shot.camera.width, shot.camera.height);
        self.reserve(drawn.most(), width, height)?;
        let landing = match self.landing.take() {
            Some(landing) => landing,
            None => self.gpu.buffer("view.counters", 4 * counters::COUNT as u64, Memory::Readback)?,
        };
        let landing = self.landing.insert(landing).clone();
        let (renderer, target) = self.ready(width * height)?;
        let mut words = [0u32; counters::COUNT];
        if let Drawn::First(planes, splats) = drawn {
            (words[counters::SPLATS], words[counters::PLAIN]) = (splats, planes.plain(splats));
        }
        recorder.upload(&renderer.counters, 0, bytemuck::cast_slice(&words))?;
        if let Drawn::Live(model) = drawn {
            for at in [model.count_offset(), 4 * counters::PLAIN as u64] {
                recorder.copy(model.counters(), at, &renderer.counters, at, 4)?;
            }
        }
        renderer.record_forward(recorder, drawn.planes(), shot, target, aux)?;
        recorder.copy(&renderer.counters, 0, &landing, 0, 4 * counters::COUNT as u64)?;
        self.recorded = Some((width, height, aux));
        Ok(())
    }

    /// Whether the picture that was recorded last is whole in [`Self::target`], once `by` has finished: its ticket, or
    /// what a host says of its own command buffer. `None` before. After `false` there is room,
    /// and it has to be recorded again. Never waits.
    pub fn fits(&mut self, by: impl Into<Done>) -> Result<Option<bool>, vk::Error> {
        let Some(landing) = &self.landing else { return Ok(None) };
        let words: Option<Vec<u32>> = self.gpu.read_ready(landing, 0, counters::COUNT, by)?;
        Ok(words.map(|words| !self.make_room(&words)))
    }

    /// Drops the buffers where the counters of a picture say that they were too small; the next ones will be larger.
    fn make_room(&mut self, words: &[u32]) -> bool {
        let full = words[counters::STATUS] & counters::PAIRS_BIT != 0;
        if full {
            let wanted = words[counters::PAIRS];
            let most = most_pairs(&self.gpu, self.variants).max(wanted);
            self.size.pairs = wanted.saturating_add(wanted / 8).min(most);
            self.renderer = None;
        }
        full
    }

    /// The picture that was recorded last and has been submitted since; waits for it. `None` when there was no room for
    /// its (splat, tile) pairs (or nothing was recorded): there is room now, and it has to be recorded again.
    pub fn collect(&mut self) -> Result<Option<Picture>, vk::Error> {
        let (Some((width, height, aux)), Some((renderer, _))) = (self.recorded.take(), &self.renderer) else {
            return Ok(None);
        };
        let words: Vec<u32> = self.gpu.read_at(&renderer.counters, 0, counters::COUNT)?;
        if self.make_room(&words) {
            return Ok(None);
        }
        let Some((_, target)) = &self.renderer else { return Ok(None) };
        let floats = 4 * width as usize * height as usize;
        Ok(Some(Picture {
            width,
            height,
            rgbt: self.gpu.read_at(&target.image, 0, floats)?,
            aux: if aux { Some(self.gpu.read_at(&target.aux, 0, floats)?) } else { None },
        }))
    }

    /// Where the picture that was recorded last is (or will be) on the device.
    pub fn target(&self) -> Option<&Target> {
        self.renderer.as_ref().map(|(_, target)| target)
    }

    fn ready(&mut self, pixels: u32) -> Result<(&Renderer, &Target), vk::Error> {
        let (renderer, target) = match self.renderer.take() {
            Some((renderer, target)) if target.pixels >= pixels => (renderer, target),
            Some((renderer, _)) => (renderer, Target::new(&self.gpu, "view.", pixels, true)?),
            None => {
                let mut renderer = Renderer::new(&self.gpu, self.variants, self.size)?;
                renderer.sort_depths_by(self.depth_bits);
                (renderer, Target::new(&self.gpu, "view.", pixels, true)?)
            }
        };
        let (renderer, target) = self.renderer.insert((renderer, target));
        Ok((renderer, target))
    }
}
