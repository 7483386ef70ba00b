//! Saliency masks of the photographs on the device: soft masks of texture.

use rayon::prelude::*;

use crate::loss::TextureMask;
use crate::pass::saliency_plane as pass;
use crate::saliency::{Cache, Plane, Settings};
use crate::scene::Camera;
use crate::train::Error;
use crate::train::input::View;
use crate::train::learning::sigma::bytes;
use crate::train::schedule::{Stream, draw};
use crate::train::settings::Frequencies;
use crate::vk::{self, Buffer, Gpu, Groups, Memory, Pipeline, Recorder};

/// A mask of reduced size for each view, 8 bits per value, and the saliency of the pixels of a step's view.
pub(in crate::train) struct Saliencies {
    masks: Vec<MaskBuffer>,
    plane: Buffer,
    spread: Pipeline,
    /// For each view, pixels drawn by their mask value, as shares of width and height.
    rich: Vec<Vec<[f32; 2]>>,
}

/// Pixels drawn for each view.
const DRAWN: u64 = 16;

struct MaskBuffer {
    buffer: Buffer,
    size: (u32, u32),
}

impl Saliencies {
    /// For photographs of these cameras; contents undefined.
    pub(in crate::train) fn new(gpu: &Gpu, cameras: &[Camera]) -> Result<Self, vk::Error> {
        let side = Settings::default().side;
        let held = |camera: &Camera| -> Result<MaskBuffer, vk::Error> {
            let size = Plane::reduced_size(camera.width, camera.height, side);
            let bytes = (u64::from(size.0) * u64::from(size.1)).next_multiple_of(4);
            Ok(MaskBuffer { buffer: gpu.buffer("saliency_mask", bytes, Memory::Device)?, size })
        };
        let pixels = cameras.iter().map(|c| u64::from(c.width) * u64::from(c.height)).max().unwrap_or(1);
        Ok(Self {
            masks: cameras.iter().map(held).collect::<Result<_, _>>()?,
            plane: gpu.buffer("saliency", 4 * pixels, Memory::Device)?,
            spread: gpu.pipeline(&pass::PASS.kernel, &[])?,
            rich: Vec::new(),
        })
    }

    /// Makes the masks of the photographs and uploads them. Decodes each photograph once, `threads` photographs at a
    /// time.
    pub(in crate::train) fn fill(
        &mut self,
        gpu: &Gpu,
        views: &[View],
        frequencies: &Frequencies,
        seed: u64,
        threads: usize,
    ) -> Result<Cache, Error> {
        let settings = Settings::default();
        let mut lumas = Vec::with_capacity(views.len());
        for some in views.chunks(threads.max(1)) {
            let luma = |view: &View| -> Result<Plane, Error> {
                let pixels = view.photograph.pixels()?;
                Ok(Plane::luma(view.camera.width, view.camera.height, &pixels)?.reduced(settings.side))
            };
            lumas.extend(some.par_iter().map(luma).collect::<Result<Vec<_>, _>>()?);
        }
        let cache = Cache::new(lumas, frequencies.gate, seed, &settings)?;
        let sigmas = vec![frequencies.sigma; views.len()];
        cache.prepare(&sigmas)?;
        for (view, sigma) in sigmas.into_iter().enumerate() {
            let (saliency, _) = cache.get(view, sigma)?;
            self.write(gpu, view, &saliency.mask)?;
            self.rich.push(drawn(&saliency.mask, seed.wrapping_add(view as u64)));
        }
        Ok(cache)
    }

    fn write(&self, gpu: &Gpu, view: usize, mask: &Plane) -> Result<(), Error> {
        let held = self.masks.get(view).ok_or(Error::NoViews)?;
        Ok(gpu.write(&held.buffer, &bytes(mask))?)
    }

    /// The mask of a view.
    pub(in crate::train) fn mask(&self, view: usize) -> Option<TextureMask<'_>> {
        self.masks.get(view).map(|held| TextureMask { buffer: &held.buffer, size: held.size })
    }

    /// A position in a view as shares of width and height, more often where the mask is high; `turn` counts how often
    /// the view has been looked at.
    pub(in crate::train) fn place(&self, view: usize, turn: u32) -> [f32; 2] {
        let rich = self.rich.get(view).filter(|rich| !rich.is_empty());
        rich.map_or([0.5; 2], |rich| rich[turn as usize % rich.len()])
    }

    /// Records the saliency of the pixels of a view at the size of `camera`, whose first row is row `top` of a
    /// photograph of `of_height` rows. Returns a float per pixel from 0 to 1.
    pub(in crate::train) fn record(
        &self,
        recorder: &mut Recorder,
        view: usize,
        camera: &Camera,
        top: u32,
        of_height: u32,
    ) -> Result<&Buffer, Error> {
        let TextureMask { buffer, size: (mask_width, mask_height) } = self.mask(view).ok_or(Error::NoViews)?;
        let &Camera { width, height, .. } = camera;
        let push = pass::Push { width, height, top, of_height, mask_width, mask_height };
        let pixels = u64::from(camera.width) * u64::from(camera.height);
        recorder.dispatch(&self.spread, &[buffer, &self.plane], &push, Groups::Items(pixels))?;
        Ok(&self.plane)
    }

    /// Bytes of the buffers that depend on pixels, and bytes of the others.
    pub(in crate::train) fn bytes(&self) -> [u64; 2] {
        [self.plane.size(), self.masks.iter().map(|held| held.buffer.size()).sum()]
    }
}

/// Centres of pixels drawn with a probability in proportion to their mask value, as shares of width and height.
fn drawn(mask: &Plane, seed: u64) -> Vec<[f32; 2]> {
    let sums: Vec<f64> = mask
        .values()
        .iter()
        .scan(0.0, |sum, v| {
            *sum += f64::from(v.max(1e-6));
            Some(*sum)
        })
        .collect();
    let total = sums.last().copied().unwrap_or(0.0);
    let (width, height) = (mask.width() as usize, mask.height() as f32);
    let one = |k: u64| {
        let bits = draw(seed, Stream::Places, k, 0);
        let at = (bits >> 11) as f64 / (1_u64 << 53) as f64 * total;
        let pixel = sums.partition_point(|sum| *sum <= at).min(sums.len().saturating_sub(1));
        [((pixel % width) as f32 + 0.5) / width as f32, ((pixel / width) as f32 + 0.5) / height]
    };
    if sums.is_empty() { Vec::new() } else { (0..DRAWN).map(one).collect() }
}
