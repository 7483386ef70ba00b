//! Pictures of a model, outside of training.

use super::planes::Planes;
use super::renderer::{Renderer, Shot, Size, most_pairs};
use super::target::Target;
use super::variants::{GradientSum, Variants};
use crate::pass::counters;
use crate::scene::Gaussians;
use crate::vk::{self, Gpu, Recorder};

/// A rendered view, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// (r, g, b, final transmittance) per pixel; colours as blended, neither clamped nor rounded.
    pub rgbt: Vec<f32>,
    /// (sum w z, sum w n) per pixel in scene units and the camera frame, when asked for.
    pub aux: Option<Vec<f32>>,
}

impl Picture {
    /// 8-bit RGB, rounded to the nearest.
    pub fn rgb8(&self) -> Vec<u8> {
        crate::format::image_out::to_rgb8(&self.rgbt, 4)
    }

    /// Expected depth per pixel in scene units: sum w z / sum w where something is there (sum w > 0.01), else 0.
    pub fn depth(&self) -> Option<Vec<f32>> {
        let aux = self.aux.as_ref()?;
        let pixels = self.rgbt.chunks_exact(4).zip(aux.chunks_exact(4));
        Some(pixels.map(|(c, a)| if c[3] < 0.99 { a[0] / (1.0 - c[3]) } else { 0.0 }).collect())
    }

    /// Unit normal per pixel in the camera frame, zero where nothing is there.
    pub fn normals(&self) -> Option<Vec<[f32; 3]>> {
        let aux = self.aux.as_ref()?;
        let unit = |a: &[f32]| {
            let length = (a[1] * a[1] + a[2] * a[2] + a[3] * a[3]).sqrt();
            if length > 1e-3 { [a[1] / length, a[2] / length, a[3] / length] } else { [0.0; 3] }
        };
        Some(aux.chunks_exact(4).map(unit).collect())
    }
}

/// Renders pictures of models; grows as they need.
pub struct Viewer {
    gpu: Gpu,
    variants: Variants,
    size: Size,
    renderer: Option<(Renderer, Target)>,
    /// Width, height and auxiliary channels of a picture to be collected.
    recorded: Option<(u32, u32, bool)>,
}

impl Viewer {
    /// A viewer that allocates at the first picture.
    pub fn new(gpu: &Gpu) -> Self {
        Self::with_variants(gpu, Variants::choose(gpu, false))
    }

    /// The same with these forms of the passes.
    pub fn with_variants(gpu: &Gpu, variants: Variants) -> Self {
        // Without a backward there are no slots, which would limit the pairs.
        let variants = Variants { gradients: GradientSum::CompareAndSwap, ..variants };
        let size =
            Size { splats: 1, pairs: 1, tiles: 1, aux: true, train: false, count: false, clamp_gradient_passes: false };
        Self { gpu: gpu.clone(), variants, size, renderer: None, recorded: None }
    }

    /// The model on the device, for [`Self::render`].
    pub fn upload(&self, model: &Gaussians) -> Result<Planes, vk::Error> {
        let planes = Planes::new(&self.gpu, "", model.len() as u32)?;
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

    /// Records a picture of the first `splats` splats of `model`, for a caller that submits it as a part of more, or between
    /// semaphores of its own. Once submitted, [`Self::collect`] gives the picture.
    pub fn record(
        &mut self,
        recorder: &mut Recorder,
        model: &Planes,
        splats: u32,
        shot: &Shot,
        aux: bool,
    ) -> Result<(), vk::Error> {
        let (width, height) = (shot.camera.width, shot.camera.height);
        self.reserve(splats, width, height)?;
        let (renderer, target) = self.ready(width * height)?;
        let mut words = [0u32; counters::COUNT];
        words[counters::SPLATS] = splats;
        recorder.upload(&renderer.counters, 0, bytemuck::cast_slice(&words))?;
        renderer.record_forward(recorder, model, shot, target, aux)?;
        self.recorded = Some((width, height, aux));
        Ok(())
    }

    /// The picture that was recorded last and has been submitted since; waits for it. `None` when there was no room for its
    /// (splat, tile) pairs (or nothing was recorded): there is room now, and it has to be recorded again.
    pub fn collect(&mut self) -> Result<Option<Picture>, vk::Error> {
        let (Some((width, height, aux)), Some((renderer, target))) = (self.recorded.take(), &self.renderer) else {
            return Ok(None);
        };
        let words: Vec<u32> = self.gpu.read_at(&renderer.counters, 0, counters::COUNT)?;
        if words[counters::STATUS] & counters::PAIRS_BIT != 0 {
            let wanted = words[counters::PAIRS];
            let most = most_pairs(&self.gpu, self.variants).max(wanted);
            self.size.pairs = wanted.saturating_add(wanted / 8).min(most);
            self.renderer = None;
            return Ok(None);
        }
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
                (Renderer::new(&self.gpu, self.variants, self.size)?, Target::new(&self.gpu, "view.", pixels, true)?)
            }
        };
        let (renderer, target) = self.renderer.insert((renderer, target));
        Ok((renderer, target))
    }
}
