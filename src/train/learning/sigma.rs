//! The width of the saliency filter for each photograph, learned during the training. At some steps the render is
//! copied to the host. When such a step is done, the network takes one update from the render, and [`DELAY`] steps
//! later the photograph gets the mask of its new width. The delay makes a run the same however far the host runs ahead,
//! and when it is resumed.

use serde::{Deserialize, Serialize};

use crate::dataset::Pixels;
use crate::saliency::{Curve, LearnSettings, MaskTarget, Plane, Renders, Settings, SigmaLearner, Spectrum, spaced};
use crate::train::Error;
use crate::train::input::View;
use crate::train::settings::{Settings as TrainingSettings, SigmaLearning};
use crate::vk::{self, Buffer, Gpu, Memory, Ticket};

/// Steps from an update to its mask: more than are ever in flight.
const DELAY: u32 = 64;

/// Widths at which a curve of the loss is sampled.
const CURVE_POINTS: usize = 9;

/// One update of the width of a photograph's saliency filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SigmaUpdate {
    /// Index of the training photograph.
    pub view: usize,
    /// The photograph's new width, in bins of a spectrum of 256.
    pub sigma: f64,
    /// Loss of the mask before the update.
    pub loss: f64,
}

/// Buffers for the renders of a step: of all splats, and of the constrained set if composites are learned from.
pub(in crate::train) type Landing = [Buffer; 2];

/// Bytes of the renders of a step.
const fn bytes_of(pixels: u64, how: SigmaLearning) -> [u64; 2] {
    match how {
        SigmaLearning::Off => [0; 2],
        SigmaLearning::Errors => [16 * pixels, 16],
        SigmaLearning::Composite => [16 * pixels; 2],
    }
}

/// Bytes of all renders that learning keeps, with at most `in_flight` steps in flight.
pub(in crate::train) fn bytes_of_landings(pixels: u64, how: SigmaLearning, in_flight: usize) -> u64 {
    (in_flight as u64 + 1) * bytes_of(pixels, how).iter().sum::<u64>()
}

/// Buffers for the renders of steps that learn: one more than are in flight at most. None where nothing is learned.
pub(in crate::train) fn landings(
    gpu: &Gpu,
    pixels: u64,
    how: SigmaLearning,
    in_flight: usize,
) -> Result<Vec<Landing>, vk::Error> {
    if how == SigmaLearning::Off {
        return Ok(Vec::new());
    }
    let [full, low] = bytes_of(pixels, how);
    let landing = |_| {
        Ok([
            gpu.buffer("learned_render", full, Memory::Readback)?,
            gpu.buffer("learned_low_render", low, Memory::Readback)?,
        ])
    };
    (0..=in_flight).map(landing).collect()
}

/// A mask that is used from a step on.
struct LearnedMask {
    from: u32,
    sigma: f64,
    level: f64,
    bytes: Vec<u8>,
}

/// A photograph at the size of its mask, as learning needs it.
struct ReducedPhotograph {
    luma: Plane,
    /// Share of each pixel that is not masked; `None` for photographs without masked pixels.
    coverage: Option<Plane>,
    /// Red, green and blue, if composites are learned from; else empty.
    colours: Vec<f32>,
}

/// The network, the photographs, and the learned masks.
pub(in crate::train) struct SigmaTraining {
    learner: SigmaLearner,
    how: SigmaLearning,
    every: u32,
    settings: Settings,
    images: Vec<ReducedPhotograph>,
    /// Masks of each view.
    masks: Vec<Vec<LearnedMask>>,
    /// For each step in flight: the render of all splats, and of the constrained set if composites are learned from.
    landings: Vec<Landing>,
    sizes: Vec<(u32, u32)>,
}

impl SigmaTraining {
    /// For these views and their luma planes (`lumas`, at the size of the masks), with the buffers of [`landings`].
    pub(in crate::train) fn new(
        views: &[View],
        lumas: Vec<Plane>,
        training: &TrainingSettings,
        landings: Vec<Landing>,
    ) -> Result<Self, Error> {
        let (frequencies, seed) = (&training.frequencies, training.run.seed);
        let settings = Settings::default();
        let learned = LearnSettings { start: frequencies.sigma, seed, ..LearnSettings::default() };
        let how = frequencies.sigma_learning;
        let (mut features, mut images) = (Vec::new(), Vec::new());
        for (view, luma) in views.iter().zip(lumas) {
            features.push(*Spectrum::new(&luma, &settings)?.features());
            images.push(ReducedPhotograph::new(view, luma, how)?);
        }
        Ok(Self {
            learner: SigmaLearner::new(&features, &learned)?,
            how,
            every: frequencies.sigma_every.max(1),
            settings,
            masks: views.iter().map(|_| Vec::new()).collect(),
            images,
            landings,
            sizes: views.iter().map(|v| (v.camera.width, v.camera.height)).collect(),
        })
    }

    /// Whether steps that learn also render the constrained set.
    pub(in crate::train) fn wants_low(&self) -> bool {
        self.how == SigmaLearning::Composite
    }

    /// Buffers for the renders of a step: of all splats, and of the constrained set.
    pub(in crate::train) fn landing(&self, step: u32) -> &Landing {
        &self.landings[(step / self.every) as usize % self.landings.len()]
    }

    /// The learned mask of a view at a step; `None` while the view has its first mask.
    pub(in crate::train) fn mask(&self, view: usize, step: u32) -> Option<&[u8]> {
        let masks = self.masks.get(view)?;
        masks.iter().rev().find(|mask| mask.from <= step).map(|mask| mask.bytes.as_slice())
    }

    /// One update from a step that is done; `None` if nothing can be learned from the step.
    pub(in crate::train) fn learn(
        &mut self,
        gpu: &Gpu,
        step: u32,
        view: usize,
        ticket: Ticket,
    ) -> Result<Option<SigmaUpdate>, Error> {
        let Some(image) = self.images.get(view) else { return Ok(None) };
        let (width, height) = self.sizes[view];
        let read = |buffer: &Buffer| gpu.read_ready::<f32>(buffer, 0, 4 * (width * height) as usize, ticket);
        let [full, low] = self.landing(step);
        let Some(full) = read(full)? else { return Ok(None) };
        let spectrum = Spectrum::new(&image.luma, &self.settings)?;
        let update = if self.how == SigmaLearning::Composite {
            let Some(low) = read(low)? else { return Ok(None) };
            let [low, full] = [low, full].map(|render| image.colours_of(&render, (width, height)));
            let renders = Renders { low: &low?, full: &full?, photograph: &image.colours };
            self.learner.learn_from_composite(&spectrum, &renders)?
        } else {
            self.learner.learn_from_errors(&spectrum, &image.errors(&full, (width, height))?)?
        };
        let Some(update) = update else { return Ok(None) };
        let choice = self.learner.choose(spectrum.features());
        let from = step.saturating_add(DELAY);
        self.add(view, from, [choice.sigma, choice.level], &spectrum)?;
        // Masks that no later step uses are dropped.
        let masks = &mut self.masks[view];
        let used = masks.iter().rposition(|mask| mask.from <= step).unwrap_or(0);
        masks.drain(..used);
        Ok(Some(SigmaUpdate { view, sigma: choice.sigma, loss: update.loss }))
    }

    /// The loss over sigma of a view with this render (a vec4 per pixel); `None` if nothing can be learned from the
    /// render.
    pub(in crate::train) fn curve(&self, view: usize, render: &[f32]) -> Result<Option<Curve>, Error> {
        let (Some(image), Some(size)) = (self.images.get(view), self.sizes.get(view)) else { return Ok(None) };
        let spectrum = Spectrum::new(&image.luma, &self.settings)?;
        let learned = self.learner.settings();
        let side = image.luma.width().min(image.luma.height());
        let blur = learned.error_blur * f64::from(side) / 256.0;
        let errors = image.errors(render, *size)?;
        let target = MaskTarget::of_errors(&errors, spectrum.size(), blur, learned.failing);
        let Some(target) = target.filter(|_| !spectrum.is_flat()) else { return Ok(None) };
        let sigmas = spaced(learned.lowest, learned.highest, CURVE_POINTS);
        Ok(Some(Curve::of_target(&spectrum, &target, &sigmas)?))
    }

    fn add(&mut self, view: usize, from: u32, [sigma, level]: [f64; 2], spectrum: &Spectrum) -> Result<(), Error> {
        let mask = spectrum.map(sigma)?.mask(level).plane();
        self.masks[view].push(LearnedMask { from, sigma, level, bytes: bytes(&mask) });
        Ok(())
    }

    /// Network and masks as JSON, for a restart.
    pub(in crate::train) fn state(&self) -> Result<String, Error> {
        let masks = self.masks.iter().map(|of| of.iter().map(|m| (m.from, m.sigma, m.level)).collect()).collect();
        Ok(serde_json::to_string(&SavedSigma { learner: self.learner.clone(), masks })?)
    }

    /// Takes over a state of [`Self::state`].
    pub(in crate::train) fn take_back(&mut self, text: &str) -> Result<(), Error> {
        let kept: SavedSigma = serde_json::from_str(text)?;
        if kept.masks.len() != self.images.len() {
            let (found, expected) = (kept.masks.len(), self.images.len());
            return Err(Error::Checkpoint { section: "sigma".to_owned(), found, expected });
        }
        self.learner = kept.learner;
        for (view, masks) in kept.masks.into_iter().enumerate().filter(|(_, masks)| !masks.is_empty()) {
            let spectrum = Spectrum::new(&self.images[view].luma, &self.settings)?;
            masks.into_iter().try_for_each(|(from, sigma, level)| self.add(view, from, [sigma, level], &spectrum))?;
        }
        Ok(())
    }
}

/// The state in a checkpoint.
#[derive(Serialize, Deserialize)]
struct SavedSigma {
    learner: SigmaLearner,
    /// For each view its masks: the step from which on the mask is used, sigma and level.
    masks: Vec<Vec<(u32, f64, f64)>>,
}

impl ReducedPhotograph {
    fn new(view: &View, luma: Plane, how: SigmaLearning) -> Result<Self, Error> {
        let size = (view.camera.width, view.camera.height);
        let masked = view.masked() > 0;
        let composite = how == SigmaLearning::Composite;
        if !masked && !composite {
            return Ok(Self { luma, coverage: None, colours: Vec::new() });
        }
        let pixels = view.photograph.pixels()?;
        let rgba: Vec<f32> = match pixels.as_ref() {
            Pixels::Rgba8(values) => values.iter().map(|v| f32::from(*v) / 255.0).collect(),
            Pixels::Rgba16(values) => values.iter().map(|v| f32::from(*v) / 65_535.0).collect(),
        };
        let coverage = if masked {
            let counts = rgba.chunks_exact(4).map(|p| if p[3] > 0.0 { 1.0 } else { 0.0 }).collect();
            Some(Plane::new(size.0, size.1, counts)?.resized(luma.width(), luma.height()))
        } else {
            None
        };
        let mut image = Self { luma, coverage, colours: Vec::new() };
        if composite {
            image.colours = image.colours_of(&rgba, size)?;
        }
        Ok(image)
    }

    /// Absolute differences of luma between a render (a vec4 per pixel) and the photograph, at the size of the mask.
    fn errors(&self, render: &[f32], size: (u32, u32)) -> Result<Plane, Error> {
        let luma = |p: &[f32]| (0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2]).clamp(0.0, 1.0);
        let shown = plane(render, size, luma)?.resized(self.luma.width(), self.luma.height());
        let differences = shown.values().iter().zip(self.luma.values()).map(|(a, b)| (a - b).abs());
        let values = match &self.coverage {
            Some(coverage) => differences.zip(coverage.values()).map(|(d, c)| d * c).collect(),
            None => differences.collect(),
        };
        Ok(Plane::new(self.luma.width(), self.luma.height(), values)?)
    }

    /// Red, green and blue of an image (a vec4 per pixel) at the size of the mask.
    fn colours_of(&self, rgba: &[f32], size: (u32, u32)) -> Result<Vec<f32>, Error> {
        let channel = |c: usize| -> Result<Plane, Error> {
            Ok(plane(rgba, size, |p| p[c].clamp(0.0, 1.0))?.resized(self.luma.width(), self.luma.height()))
        };
        let [r, g, b] = [channel(0)?, channel(1)?, channel(2)?];
        Ok(r.values().iter().zip(g.values()).zip(b.values()).flat_map(|((r, g), b)| [*r, *g, *b]).collect())
    }
}

/// A value of each pixel of a vec4 image; 0 where it is not finite.
fn plane(rgba: &[f32], (width, height): (u32, u32), value: impl Fn(&[f32]) -> f32) -> Result<Plane, Error> {
    let values = rgba.chunks_exact(4).map(|p| if p.iter().all(|v| v.is_finite()) { value(p) } else { 0.0 });
    Ok(Plane::new(width, height, values.collect())?)
}

/// A mask in the device's layout: a byte per value, padded to whole words.
pub(in crate::train) fn bytes(mask: &Plane) -> Vec<u8> {
    let mut bytes: Vec<u8> = mask.values().iter().map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8).collect();
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    bytes
}
