//! Renders of a model, outside of training.

use super::live::LiveModel;
use super::picture::{DepthProbe, Picture};
use super::planes::Planes;
use super::planes::ShStorage;
use super::renderer::{Part, RenderView, Renderer, Subset};
use super::size::{Size, most_pairs};
use super::target::Target;
use super::tiles::DEPTH_BITS;
use super::variants::{GradientSum, Variants};
use crate::pass::counters;
use crate::scene::Gaussians;
use crate::vk::{self, Buffer, Done, Gpu, Memory, Recorder, SubmitSync, Ticket};

/// Renders models, and grows its buffers as needed.
pub struct Viewer {
    gpu: Gpu,
    variants: Variants,
    size: Size,
    depth_bits: u32,
    renderer: Option<(Renderer, Target)>,
    /// (width, height, auxiliary channels) of a recorded render to be collected.
    recorded: Option<(u32, u32, bool)>,
    /// Read-back buffer for the counters of a render.
    landing: Option<Buffer>,
    /// Rows of [`Self::surface`].
    probed: Option<Buffer>,
}

/// A model to look at.
#[derive(Clone, Copy)]
pub struct Shown<'a> {
    /// The planes.
    pub planes: &'a Planes,
    /// Splats; rows from this number on are not read.
    pub splats: u32,
    /// The identities of the splats, and the number below which an identity belongs to the low-frequency stage. Needed
    /// to look at a [`Part`].
    pub ids: Option<(&'a Buffer, u32)>,
}

/// What a picture shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Look {
    /// How splats are drawn.
    pub style: Style,
    /// Which splats; all without a part.
    pub part: Option<Part>,
}

/// How splats are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Style {
    /// Blended.
    #[default]
    Blended,
    /// Blended, with depth and normals.
    Surfaces,
    /// As outlines.
    Outlines,
}

/// The model to render, with the number of splats.
#[derive(Clone, Copy)]
enum DrawnModel<'a> {
    First(&'a Planes, u32),
    Live(&'a LiveModel),
}

impl DrawnModel<'_> {
    fn planes(&self) -> &Planes {
        match self {
            DrawnModel::First(planes, _) => planes,
            DrawnModel::Live(model) => model.planes(),
        }
    }

    /// Upper bound for the number of splats.
    fn most(&self) -> u32 {
        match self {
            DrawnModel::First(_, splats) => *splats,
            DrawnModel::Live(model) => model.planes().capacity(),
        }
    }
}

impl Viewer {
    /// A viewer with the best variants for the device. Allocates at the first render.
    pub fn new(gpu: &Gpu) -> Self {
        Self::with_variants(gpu, Variants::choose(gpu, false))
    }

    /// Like [`Self::new`], with given variants of the passes.
    pub fn with_variants(gpu: &Gpu, variants: Variants) -> Self {
        // Avoid slots: only the backward pass uses them, and slots would limit the number of pairs.
        let variants = Variants { gradients: GradientSum::CompareAndSwap, ..variants };
        let size = Size {
            splats: 1,
            pairs: 1,
            tiles: 1,
            aux: true,
            train: false,
            listed: false,
            absolute: false,
            count: false,
            clamp_gradient_passes: false,
        };
        Self {
            gpu: gpu.clone(),
            variants,
            size,
            depth_bits: DEPTH_BITS,
            renderer: None,
            recorded: None,
            landing: None,
            probed: None,
        }
    }

    /// Sorts splats by only the highest `bits` bits of their depth, to compare speed and error: see
    /// [`TileLists::sort_depths_by`](super::tiles::TileLists::sort_depths_by).
    pub fn sort_depths_by(&mut self, bits: u32) {
        self.depth_bits = bits;
        self.renderer = None;
    }

    /// Uploads a model for [`Self::render`].
    pub fn upload(&self, model: &Gaussians) -> Result<Planes, vk::Error> {
        self.upload_with(model, ShStorage::Full)
    }

    /// Like [`Self::upload`], with a storage format for spherical harmonics.
    pub fn upload_with(&self, model: &Gaussians, sh: ShStorage) -> Result<Planes, vk::Error> {
        let planes = Planes::with_sh(&self.gpu, "", model.len() as u32, sh)?;
        planes.write(&self.gpu, model)?;
        Ok(planes)
    }

    /// Renders the first `splats` splats of `model`. Waits.
    pub fn render(&mut self, model: &Planes, splats: u32, view: &RenderView, aux: bool) -> Result<Picture, vk::Error> {
        loop {
            let mut recorder = self.gpu.recorder("view")?;
            self.record(&mut recorder, model, splats, view, aux)?;
            recorder.submit()?;
            if let Some(picture) = self.collect()? {
                return Ok(picture);
            }
        }
    }

    /// Makes room for renders of `width` by `height` pixels with `splats` splats. The number of pairs is a guess.
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

    /// Records a render of the first `splats` splats of `model`. The caller submits the recorder with further commands,
    /// with semaphores, or in a command buffer of the host ([`Recorder::record_into`]). After the submit
    /// [`Self::collect`] returns the render; [`Self::fits`] tells without waiting whether the render in
    /// [`Self::target`] is complete.
    pub fn record(
        &mut self,
        recorder: &mut Recorder,
        model: &Planes,
        splats: u32,
        view: &RenderView,
        aux: bool,
    ) -> Result<(), vk::Error> {
        self.record_drawn(recorder, DrawnModel::First(model, splats), view, aux)
    }

    /// Like [`Self::record`], for a model in training: renders as many splats as the model has when the device executes
    /// the recording.
    pub fn record_live(
        &mut self,
        recorder: &mut Recorder,
        model: &LiveModel,
        view: &RenderView,
        aux: bool,
    ) -> Result<(), vk::Error> {
        self.record_drawn(recorder, DrawnModel::Live(model), view, aux)
    }

    /// Records a render like [`Self::record`], and submits the recording with semaphores of a host. Does not wait.
    pub fn submit(
        &mut self,
        model: &Planes,
        splats: u32,
        view: &RenderView,
        aux: bool,
        order: SubmitSync<'_>,
    ) -> Result<Ticket, vk::Error> {
        let mut recorder = self.gpu.recorder("view")?;
        self.record(&mut recorder, model, splats, view, aux)?;
        recorder.submit_with(order)
    }

    /// Like [`Self::submit`], for a model in training.
    pub fn submit_live(
        &mut self,
        model: &LiveModel,
        view: &RenderView,
        aux: bool,
        order: SubmitSync<'_>,
    ) -> Result<Ticket, vk::Error> {
        let mut recorder = self.gpu.recorder("live view")?;
        self.record_live(&mut recorder, model, view, aux)?;
        recorder.submit_with(order)
    }

    /// Raises `weights` (`splats` floats, one per splat) to the splat's largest blending weight, alpha times
    /// transmittance, in any pixel of the render. Waits.
    pub fn weigh(&mut self, model: &Planes, splats: u32, view: &RenderView, weights: &Buffer) -> Result<(), vk::Error> {
        self.until_it_fits(Shown { planes: model, splats, ids: None }, view, |recorder, renderer, target| {
            renderer.record_weights(recorder, model, view, target, weights)
        })
    }

    /// Depths at the pixels of a render of the first `splats` splats of `model`, and the weights in front of and behind
    /// `known` depths: one in scene units for each pixel, 0 where none is known. Waits.
    pub fn probe(
        &mut self,
        model: &Planes,
        splats: u32,
        view: &RenderView,
        known: Option<&[f32]>,
    ) -> Result<DepthProbe, vk::Error> {
        let (width, height) = (view.camera.width, view.camera.height);
        let pixels = width as usize * height as usize;
        let rows = self.gpu.buffer("probe", 16 * pixels.max(1) as u64, Memory::Device)?;
        let known = match known {
            Some(known) => {
                let mut depths: Vec<f32> = known.iter().map(|z| if z.is_finite() { *z } else { 0.0 }).collect();
                depths.resize(pixels.max(1), 0.0);
                let buffer = self.gpu.buffer("known_depths", 4 * depths.len() as u64, Memory::Device)?;
                self.gpu.write(&buffer, &depths)?;
                Some(buffer)
            }
            None => None,
        };
        self.until_it_fits(Shown { planes: model, splats, ids: None }, view, |recorder, renderer, _| {
            renderer.record_probe(recorder, model, view, known.as_ref(), &rows)
        })?;
        Ok(DepthProbe::new(width, height, &self.gpu.read_at(&rows, 0, 4 * pixels)?))
    }

    /// A picture of the first `splats` splats of `model` with the median depths of its pixels: both of one projection.
    /// Waits.
    pub fn surface(
        &mut self,
        model: &Planes,
        splats: u32,
        view: &RenderView,
    ) -> Result<(Picture, DepthProbe), vk::Error> {
        let (width, height) = (view.camera.width, view.camera.height);
        let floats = 4 * width as usize * height as usize;
        let rows = match self.probed.take().filter(|rows| rows.size() >= 4 * floats as u64) {
            Some(rows) => rows,
            None => self.gpu.buffer("probe", 4 * floats.max(4) as u64, Memory::Device)?,
        };
        self.until_it_fits(Shown { planes: model, splats, ids: None }, view, |recorder, renderer, target| {
            renderer.record_surface(recorder, model, view, target, &rows)
        })?;
        let probe = DepthProbe::new(width, height, &self.gpu.read_at(&rows, 0, floats)?);
        self.probed = Some(rows);
        let (_, target) = self.ready(width * height)?;
        let image = target.image.clone();
        let rgbt = self.gpu.read_at(&image, 0, floats)?;
        Ok((Picture { width, height, rgbt, aux: None }, probe))
    }

    /// Draws a model as `look` says. A part of a model without identities is the whole model. Waits.
    pub fn look(&mut self, shown: Shown<'_>, view: &RenderView, look: Look) -> Result<Picture, vk::Error> {
        let (width, height) = (view.camera.width, view.camera.height);
        let aux = look.style == Style::Surfaces;
        let subset = shown.ids.zip(look.part).map(|((ids, _), part)| Subset { ids, part });
        self.until_it_fits(shown, view, |recorder, renderer, target| match look.style {
            Style::Outlines => renderer.record_outlines(recorder, shown.planes, view, target, subset),
            _ => renderer.record_forward_of(recorder, shown.planes, view, target, aux, subset).map(|_| ()),
        })?;
        let (_, target) = self.ready(width * height)?;
        let (image, channels) = (target.image.clone(), target.aux.clone());
        let floats = 4 * width as usize * height as usize;
        let rgbt = self.gpu.read_at(&image, 0, floats)?;
        let aux = if aux { Some(self.gpu.read_at(&channels, 0, floats)?) } else { None };
        Ok(Picture { width, height, rgbt, aux })
    }

    /// Submits what `record` records, until there is room for the (splat, tile) pairs of the render. Waits.
    fn until_it_fits(
        &mut self,
        shown: Shown<'_>,
        view: &RenderView,
        mut record: impl FnMut(&mut Recorder, &Renderer, &Target) -> Result<(), vk::Error>,
    ) -> Result<(), vk::Error> {
        let (width, height) = (view.camera.width, view.camera.height);
        loop {
            self.reserve(shown.splats, width, height)?;
            let mut recorder = self.gpu.recorder("look")?;
            let (renderer, target) = self.ready(width * height)?;
            let mut words = [0u32; counters::COUNT];
            words[counters::SPLATS] = shown.splats;
            words[counters::PLAIN] = shown.planes.plain(shown.splats);
            words[counters::CONSTRAINED] = shown.ids.map_or(0, |(_, below)| below);
            recorder.upload(&renderer.counters, 0, bytemuck::cast_slice(&words))?;
            record(&mut recorder, renderer, target)?;
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
        drawn: DrawnModel<'_>,
        view: &RenderView,
        aux: bool,
    ) -> Result<(), vk::Error> {
        let (width, height) = (view.camera.width, view.camera.height);
        self.reserve(drawn.most(), width, height)?;
        let landing = match self.landing.take() {
            Some(landing) => landing,
            None => self.gpu.buffer("view.counters", 4 * counters::COUNT as u64, Memory::Readback)?,
        };
        let landing = self.landing.insert(landing).clone();
        let (renderer, target) = self.ready(width * height)?;
        let mut words = [0u32; counters::COUNT];
        if let DrawnModel::First(planes, splats) = drawn {
            (words[counters::SPLATS], words[counters::PLAIN]) = (splats, planes.plain(splats));
        }
        recorder.upload(&renderer.counters, 0, bytemuck::cast_slice(&words))?;
        if let DrawnModel::Live(model) = drawn {
            for at in [model.count_offset(), 4 * counters::PLAIN as u64] {
                recorder.copy(model.counters(), at, &renderer.counters, at, 4)?;
            }
        }
        renderer.record_forward(recorder, drawn.planes(), view, target, aux)?;
        recorder.copy(&renderer.counters, 0, &landing, 0, 4 * counters::COUNT as u64)?;
        self.recorded = Some((width, height, aux));
        Ok(())
    }

    /// Whether the last recorded render in [`Self::target`] is complete; `None` before `by` has finished. `by` is the
    /// render's ticket, or a host's proof that its command buffer has run. After `false` the viewer has more room, and
    /// the caller records the render again. Never waits.
    pub fn fits(&mut self, by: impl Into<Done>) -> Result<Option<bool>, vk::Error> {
        let Some(landing) = &self.landing else { return Ok(None) };
        let words: Option<Vec<u32>> = self.gpu.read_ready(landing, 0, counters::COUNT, by)?;
        Ok(words.map(|words| !self.make_room(&words)))
    }

    /// Returns whether the buffers were too small, by the counters of a render. If so, drops the buffers; the next
    /// buffers will be larger.
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

    /// The last recorded render, after its submit. Waits. `None` when its (splat, tile) pairs did not fit, or nothing
    /// was recorded. After pairs that did not fit, the viewer has more room, and the caller records the render again.
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

    /// The last recorded render on the device.
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
