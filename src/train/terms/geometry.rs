//! The loss on depth and normals, against priors.

use super::{LossTerm, Phase, StepContext};
use crate::loss::{self, Edges, GeometryLoss, GeometryWeights, PackedPrior, Rendered};
use crate::raster::MemoryFootprint;
use crate::scene::Camera;
use crate::stereo::Prior;
use crate::train::Error;
use crate::train::input::OptionalInput;
use crate::train::settings::Geometry as Settings;
use crate::train::state::State;
use crate::vk::{self, Buffer, Gpu, Memory, Recorder};

/// Priors of all views on the device, and the loss that compares renders with the priors.
pub(in crate::train) struct Geometry {
    priors: Vec<ViewPrior>,
    loss: GeometryLoss,
    settings: Settings,
    /// Whether priors change during the training, and are part of its state.
    propagated: bool,
}

/// Depth and normals of a view on the device.
struct ViewPrior {
    buffer: Buffer,
    size: (u32, u32),
    /// Median depth; 0 for a view without a prior.
    median: f32,
}

impl ViewPrior {
    fn words(&self) -> usize {
        2 * self.size.0 as usize * self.size.1 as usize
    }
}

impl Geometry {
    /// For views of these cameras, all without a prior.
    pub(in crate::train) fn new(gpu: &Gpu, cameras: &[Camera], settings: &Settings) -> Result<Self, vk::Error> {
        let known = |camera: &Camera| -> Result<ViewPrior, vk::Error> {
            let size = settings.prior_size(camera.width, camera.height);
            let bytes = 8 * u64::from(size.0) * u64::from(size.1);
            Ok(ViewPrior { buffer: gpu.buffer("prior", bytes, Memory::Device)?, size, median: 0.0 })
        };
        let pixels = cameras.iter().map(|c| c.width * c.height).max().unwrap_or(1);
        Ok(Self {
            priors: cameras.iter().map(known).collect::<Result<_, _>>()?,
            loss: GeometryLoss::new(gpu, pixels)?,
            settings: settings.clone(),
            propagated: false,
        })
    }

    /// Uploads the priors of the views. A view whose prior is missing or has another size stays without one.
    pub(in crate::train) fn fill(&mut self, gpu: &Gpu, input: &OptionalInput) -> Result<(), Error> {
        self.propagated = input.scene.is_some();
        for (view, prior) in input.priors.iter().enumerate() {
            if let Some(prior) = prior {
                self.set(gpu, view, prior)?;
            }
        }
        Ok(())
    }

    /// Uploads the prior of a view. A prior of another size is ignored.
    pub(in crate::train) fn set(&mut self, gpu: &Gpu, view: usize, prior: &Prior) -> Result<(), Error> {
        let Some(known) = self.priors.get_mut(view).filter(|k| k.size == (prior.width, prior.height)) else {
            return Ok(());
        };
        let packed = PackedPrior::new(known.size, &prior.depth, &prior.normals, &prior.confidence);
        let Some(packed) = packed else { return Ok(()) };
        known.median = packed.median;
        Ok(gpu.write(&known.buffer, &packed.words)?)
    }

    /// The priors of all views, if priors change: for each view the bits of the median and the words of the prior,
    /// zeros without a prior. Waits.
    fn state(&self, gpu: &Gpu) -> Result<Vec<u32>, vk::Error> {
        let mut out = Vec::new();
        if !self.propagated {
            return Ok(out);
        }
        for known in &self.priors {
            let words = known.words();
            out.push(known.median.to_bits());
            match known.median > 0.0 {
                true => out.extend(gpu.read_at::<u32>(&known.buffer, 0, words)?),
                false => out.resize(out.len() + words, 0),
            }
        }
        Ok(out)
    }

    /// Restores a state of [`Self::state`].
    fn take_back(&mut self, gpu: &Gpu, state: &[u32]) -> Result<(), Error> {
        if !self.propagated {
            return Ok(());
        }
        let expected = self.priors.iter().map(|known| 1 + known.words()).sum();
        if state.len() != expected {
            return Err(Error::Checkpoint { section: "priors".to_owned(), found: state.len(), expected });
        }
        let mut rest = state;
        for known in &mut self.priors {
            let (row, after) = rest.split_at(1 + known.words());
            rest = after;
            known.median = f32::from_bits(row[0]);
            gpu.write(&known.buffer, &row[1..])?;
        }
        Ok(())
    }

    /// Whether a view has a prior.
    fn knows(&self, view: usize) -> bool {
        self.priors.get(view).is_some_and(|known| known.median > 0.0)
    }

    fn weights(&self, times: f64) -> GeometryWeights {
        let settings = &self.settings;
        let of = |weight: f64| (weight * times) as f32;
        GeometryWeights {
            depth: of(settings.lambda_depth),
            huber: settings.depth_huber as f32,
            edges: Edges::More(settings.depth_edges as f32),
            smooth: of(settings.lambda_depth * settings.lambda_smooth),
            edge_stop: settings.smooth_edge_stop as f32,
            cosine: of(settings.lambda_normal),
            l1: of(settings.lambda_normal),
        }
    }
}

impl LossTerm for Geometry {
    fn phases(&self) -> &'static [Phase] {
        &[Phase::AfterExposureBackward]
    }

    fn due(&self, step: &StepContext<'_>) -> bool {
        step.plan.geometry.is_some() && self.knows(step.view)
    }

    fn reads_aux(&self) -> bool {
        true
    }

    /// Adds to the gradient of the transmittance, and writes the gradient of depth and normals.
    fn record<'a>(&'a self, _: Phase, recorder: &mut Recorder, step: &mut StepContext<'a>) -> Result<(), Error> {
        let known = self.priors.get(step.view).ok_or(Error::NoViews)?;
        let prior = loss::Prior { buffer: &known.buffer, size: known.size, median: known.median };
        let weights = self.weights(step.plan.geometry.unwrap_or(0.0));
        let rendered = Rendered { target: step.target, photograph: &step.photograph, prior: &prior };
        self.loss.record(recorder, rendered, &weights, step.grad_image)?;
        step.grad_aux = Some(self.loss.grad_aux());
        Ok(())
    }

    fn save(&self, gpu: &Gpu, state: &mut State) -> Result<(), Error> {
        state.priors = self.state(gpu)?;
        Ok(())
    }

    fn restore(&mut self, gpu: &Gpu, state: &State) -> Result<(), Error> {
        self.take_back(gpu, &state.priors)
    }

    fn footprint(&self) -> MemoryFootprint {
        let priors = self.priors.iter().map(|known| known.buffer.size()).sum();
        MemoryFootprint { pixels: self.loss.bytes(), fixed: priors, ..MemoryFootprint::default() }
    }
}
