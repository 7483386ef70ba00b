//! Adam over the eight planes of a model.

use std::sync::atomic::{AtomicU32, Ordering};

use crate::pass::project_backward::Penalties;
use crate::pass::{adam, noise, project_backward_adam as fused, project_backward_adam_packed as packed};
use crate::raster::{BackwardStep, GradientTerms, OPACITIES, PLANES, Planes, RenderView, Renderer, SH0};
use crate::train::Error;
use crate::train::schedule::{Adam, StepPlan};
use crate::train::settings::Settings;
use crate::vk::{self, Buffer, DeviceKind, Gpu, Pipeline, Recorder};

/// The passes that take a step.
enum StepPasses {
    /// One pass together with the backward of the projection.
    Fused {
        /// Indexed by the highest degree of the spherical harmonics that may have moments.
        of_degree: [Pipeline; 4],
        /// The same for steps with gradients of depth and normals.
        with_aux: Option<[Pipeline; 4]>,
        /// Makes up for the steps that splats have missed.
        catch_up: Option<Pipeline>,
    },
    /// A pass over gradients in memory, for devices that bind fewer buffers to a pass.
    FromGradients(Summed),
}

/// Noise on the means after a step.
struct Noise {
    pipeline: Pipeline,
    factor: f64,
    seed: u32,
}

impl Noise {
    fn new(gpu: &Gpu, training: &Settings) -> Result<Self, vk::Error> {
        let seed = training.run.seed;
        Ok(Self {
            pipeline: gpu.pipeline(&noise::PASS.kernel, &[])?,
            factor: training.density.noise_means,
            seed: seed as u32 ^ (seed >> 32) as u32,
        })
    }
}

/// Gradients of the model in memory, and the pass that steps by them.
struct Summed {
    adam: Pipeline,
    gradients: Planes,
}

/// Inputs of an optimiser step.
#[derive(Clone, Copy)]
pub(in crate::train) struct Stepping<'a> {
    pub(in crate::train) plan: &'a StepPlan,
    pub(in crate::train) renderer: &'a Renderer,
    pub(in crate::train) model: &'a Planes,
    /// The splats' rows of statistics; the last number of a row belongs to the optimiser.
    pub(in crate::train) stats: &'a Buffer,
    /// Camera and projection whose gradients are stepped by.
    pub(in crate::train) shot: &'a RenderView,
    /// Whether the blend backward had the auxiliary channels (depth and normals).
    pub(in crate::train) aux: bool,
    /// Whether gradients of other views are already in memory.
    pub(in crate::train) beside: bool,
}

/// Moments and the passes that use them.
pub(in crate::train) struct Optimiser {
    /// First and second moments, or the words that hold both.
    moments: Vec<Planes>,
    passes: StepPasses,
    /// For steps on several views at once, if there are such steps and `passes` has no gradients in memory.
    summed: Option<Summed>,
    settings: adam::AdamSettings,
    extent: f64,
    penalties: Penalties,
    noise: Option<Noise>,
    /// Highest degree of the spherical harmonics that may have moments other than zero. Steps touch no higher degree.
    degree: AtomicU32,
}

impl Optimiser {
    /// Moments for `capacity` splats, contents undefined. `extent` is that of the scene and scales the learning rate of
    /// the means; `pixels` is the mean number of pixels of a photograph, over which the loss is a mean.
    pub(in crate::train) fn new(
        gpu: &Gpu,
        capacity: u32,
        extent: f64,
        pixels: f64,
        training: &Settings,
    ) -> Result<Self, Error> {
        let (settings, shortcuts) = (adam::AdamSettings::default(), &training.shortcuts);
        let aux = training.geometry.has_loss();
        let penalties = Penalties {
            flatten: (training.geometry.lambda_flatten / extent) as f32,
            shrink: (training.optimiser.lambda_sh / pixels) as f32,
            opacity: training.optimiser.lambda_opacity as f32,
            scale: training.optimiser.lambda_scale as f32,
            decide: (training.optimiser.lambda_binary / pixels) as f32,
        };
        let packs = shortcuts.moment_bits == 16;
        let (kernel, needed) =
            if packs { (&packed::PASS.kernel, packed::BINDINGS) } else { (&fused::PASS.kernel, fused::BINDINGS) };
        let limit = gpu.caps().limits.storage_buffers;
        // On a CPU device a second read is as slow as the first.
        let again = gpu.caps().kind != DeviceKind::Cpu;
        let given = |degree, aux| {
            let constants = fused::constants(&settings, degree, aux);
            if again { fused::reading_again(constants) } else { constants }
        };
        let passes = if limit >= needed {
            let of = |degree, aux| {
                let constants = fused::penalising(given(degree, aux), penalties);
                let listed = Self::leaves_out(gpu, training);
                gpu.pipeline(kernel, &if listed { fused::listed(constants) } else { constants })
            };
            let all =
                |aux| -> Result<[Pipeline; 4], vk::Error> { Ok([of(0, aux)?, of(1, aux)?, of(2, aux)?, of(3, aux)?]) };
            StepPasses::Fused {
                of_degree: all(false)?,
                with_aux: aux.then(|| all(true)).transpose()?,
                catch_up: match shortcuts.visible_adam {
                    true => Some(gpu.pipeline(kernel, &fused::catching_up(given(3, false)))?),
                    false => None,
                },
            }
        } else if packs || training.model.sh_share < 1.0 {
            return Err(Error::ShortcutBuffers { needed, limit });
        } else {
            StepPasses::FromGradients(Summed::new(gpu, capacity)?)
        };
        let several = training.texture.views_at_once() > 1 && matches!(passes, StepPasses::Fused { .. });
        let mut moments = vec![Planes::limited(gpu, "m_", capacity, training.model.sh_share)?];
        if !packs {
            moments.push(Planes::limited(gpu, "v_", capacity, training.model.sh_share)?);
        }
        let noise = (training.density.noise_means > 0.0).then(|| Noise::new(gpu, training)).transpose()?;
        let summed = several.then(|| Summed::new(gpu, capacity)).transpose()?;
        Ok(Self { moments, passes, summed, settings, extent, penalties, noise, degree: AtomicU32::new(0) })
    }

    /// Whether splats that are not on the image take no step: if the settings say so and the device binds the buffers
    /// of the fused pass. The separate pass steps all splats.
    pub(in crate::train) fn leaves_out(gpu: &Gpu, training: &Settings) -> bool {
        let needed = if training.shortcuts.moment_bits == 16 { packed::BINDINGS } else { fused::BINDINGS };
        training.shortcuts.visible_adam && gpu.caps().limits.storage_buffers >= needed
    }

    /// First moments, or the words that hold both.
    pub(in crate::train) fn first(&self) -> &Planes {
        &self.moments[0]
    }

    /// Second moments, if they have planes of their own.
    pub(in crate::train) fn second(&self) -> Option<&Planes> {
        self.moments.get(1)
    }

    /// Records setting every moment to zero.
    pub(in crate::train) fn clear(&self, recorder: &mut Recorder) -> Result<(), vk::Error> {
        self.moments.iter().try_for_each(|planes| planes.clear(recorder))
    }

    /// Writes moments of an earlier run. Returns an error if the number of planes differs.
    pub(in crate::train) fn restore(&self, gpu: &Gpu, moments: &[[Vec<f32>; 8]]) -> Result<(), Error> {
        if moments.len() != self.moments.len() {
            let (found, expected) = (moments.len(), self.moments.len());
            return Err(Error::Checkpoint { section: "planes of moments".to_owned(), found, expected });
        }
        for (planes, values) in self.moments.iter().zip(moments) {
            planes.write_rows(gpu, values)?;
        }
        let used = (1..=3).rev().find(|&degree| moments.iter().any(|planes| touches(planes, degree)));
        self.degree.fetch_max(used.unwrap_or(0), Ordering::Relaxed);
        Ok(())
    }

    /// The first `splats` rows of the moments. Waits.
    pub(in crate::train) fn read(&self, gpu: &Gpu, splats: u32) -> Result<Vec<[Vec<f32>; 8]>, vk::Error> {
        self.moments.iter().map(|planes| planes.read(gpu, splats)).collect()
    }

    /// Bytes of the buffers.
    pub(in crate::train) fn bytes(&self) -> u64 {
        let gradients = self.summed().map_or(0, |summed| summed.gradients.bytes());
        self.moments.iter().map(Planes::bytes).sum::<u64>() + gradients
    }

    fn summed(&self) -> Option<&Summed> {
        match &self.passes {
            StepPasses::Fused { .. } => self.summed.as_ref(),
            StepPasses::FromGradients(summed) => Some(summed),
        }
    }

    fn summed_mut(&mut self) -> Option<&mut Summed> {
        match &mut self.passes {
            StepPasses::Fused { .. } => self.summed.as_mut(),
            StepPasses::FromGradients(summed) => Some(summed),
        }
    }

    /// Room for `capacity` splats, with the same moments; gradients are lost. Waits.
    pub(in crate::train) fn grow(&mut self, gpu: &Gpu, capacity: u32) -> Result<(), vk::Error> {
        // The old gradients go first, so that memory never holds both.
        if let Some(summed) = self.summed_mut() {
            summed.gradients = Planes::new(gpu, "g_", 1)?;
        }
        self.moments.iter_mut().try_for_each(|planes| planes.grow(gpu, capacity))?;
        if let Some(summed) = self.summed_mut() {
            summed.gradients = Planes::new(gpu, "g_", capacity)?;
        }
        Ok(())
    }

    /// Records the gradients of `model` for a view beside the step's own, after the blend backward of `shot`. Does
    /// nothing if steps look at one view only.
    pub(in crate::train) fn record_beside(
        &self,
        recorder: &mut Recorder,
        renderer: &Renderer,
        model: &Planes,
        shot: &RenderView,
        terms: GradientTerms,
    ) -> Result<(), vk::Error> {
        let Some(summed) = self.summed() else { return Ok(()) };
        renderer.record_project_backward_of(recorder, model, &summed.gradients, shot, terms)
    }

    /// Records one step of the optimiser, after the blend backward. A splat makes up for missed steps when it steps;
    /// where the plan says so, all splats do. Returns the optimiser step up to which all splats were caught up.
    pub(in crate::train) fn record(
        &self,
        recorder: &mut Recorder,
        of: &Stepping<'_>,
    ) -> Result<Option<u32>, vk::Error> {
        let Stepping { plan, renderer, model, stats, shot, aux, beside } = *of;
        let rates = self.rates(plan);
        let opacities = (plan.adam == Adam::All).then_some(plan.adam_steps_opacities);
        let steps = fused::StepCounts { most: plan.adam_steps, opacities };
        let step = |pipeline, steps, catches_up| BackwardStep {
            model,
            moments: &self.moments,
            pipeline,
            settings: &self.settings,
            rates: &rates,
            steps,
            decides: plan.decides,
            stats,
            catches_up,
        };
        let catch_up = |recorder: &mut Recorder, most: u32| -> Result<Option<u32>, vk::Error> {
            let StepPasses::Fused { catch_up: Some(pipeline), .. } = &self.passes else { return Ok(None) };
            let steps = fused::StepCounts { most, opacities: Some(plan.adam_steps_opacities) };
            renderer.record_backward_step(recorder, &step(pipeline, steps, true), shot)?;
            Ok(Some(most))
        };
        let used = if plan.adam == Adam::None { 0 } else { plan.sh_degree };
        let degree = self.degree.fetch_max(used, Ordering::Relaxed).max(used);
        match &self.passes {
            _ if plan.adam == Adam::None => {}
            StepPasses::Fused { of_degree, with_aux, .. } if !beside || self.summed.is_none() => {
                let of_degree = with_aux.as_ref().filter(|_| aux).unwrap_or(of_degree);
                let pipeline = &of_degree[degree.min(3) as usize];
                renderer.record_backward_step(recorder, &step(pipeline, steps, false), shot)?;
            }
            _ => {
                let Some(Summed { adam, gradients }) = self.summed() else { return Ok(None) };
                let terms = GradientTerms { aux, penalties: self.penalties(plan.decides), add: beside };
                renderer.record_project_backward_of(recorder, model, gradients, shot, terms)?;
                // All splats take this step, so all make up for missed steps first.
                let caught_up = catch_up(recorder, plan.adam_steps.saturating_sub(1))?;
                self.record_from_gradients(recorder, of, gradients, steps, adam)?;
                return Ok(caught_up.map(|before| before + 1));
            }
        }
        if plan.catch_up { catch_up(recorder, plan.adam_steps) } else { Ok(None) }
    }

    /// Gradient terms of the `first` or a later view beside the step's own.
    pub(in crate::train) fn terms_beside(&self, plan: &StepPlan, first: bool) -> GradientTerms {
        GradientTerms { aux: false, penalties: self.penalties(plan.decides).beside(), add: !first }
    }

    /// Records the noise on the means, after a step in which parameters change. Does nothing without noise.
    pub(in crate::train) fn record_noise(
        &self,
        recorder: &mut Recorder,
        of: &Stepping<'_>,
        ids: &Buffer,
    ) -> Result<(), vk::Error> {
        let Some(noise) = self.noise.as_ref().filter(|_| of.plan.adam != Adam::None) else { return Ok(()) };
        let rate = (noise.factor * self.rates(of.plan).means) as f32;
        let push = noise::Push { rate, seed: noise.seed, step: of.plan.step };
        let [means, quats, scales, opacities, ..] = of.model.buffers();
        let buffers = [&of.renderer.counters, means, quats, scales, opacities, ids];
        recorder.dispatch(&noise.pipeline, &buffers, &push, of.renderer.per_float(1))
    }

    fn penalties(&self, decides: bool) -> Penalties {
        Penalties { decide: if decides { self.penalties.decide } else { 0.0 }, ..self.penalties }
    }

    fn rates(&self, plan: &StepPlan) -> fused::LearningRates {
        fused::LearningRates {
            means: plan.rates.means * self.extent,
            quats: plan.rates.rotations,
            scales: plan.rates.scales,
            opacities: plan.rates.opacities,
            sh_base: plan.rates.sh_base,
            sh_rest: plan.rates.sh_rest,
        }
    }

    fn record_from_gradients(
        &self,
        recorder: &mut Recorder,
        of: &Stepping<'_>,
        gradients: &Planes,
        steps: fused::StepCounts,
        pipeline: &Pipeline,
    ) -> Result<(), vk::Error> {
        let Stepping { renderer, model: params, .. } = *of;
        let rates = self.rates(of.plan);
        let geometry = [rates.means, rates.quats, rates.scales, rates.opacities];
        for (k, (_, row)) in PLANES.into_iter().enumerate() {
            let Some(count) = (if k == OPACITIES { steps.opacities } else { Some(steps.most) }) else { continue };
            let rest = geometry.get(k).copied().unwrap_or(rates.sh_rest);
            let head = if k == SH0 { 3 } else { 0 };
            let push = adam::Push::new(&self.settings, count, row, head, rates.sh_base, rest);
            let mut buffers = vec![&renderer.counters];
            buffers.extend([gradients, params].into_iter().chain(&self.moments).map(|planes| &planes.buffers()[k]));
            recorder.dispatch(pipeline, &buffers, &push, renderer.per_float(row))?;
        }
        Ok(())
    }
}

impl Summed {
    fn new(gpu: &Gpu, capacity: u32) -> Result<Self, vk::Error> {
        Ok(Self { adam: gpu.pipeline(&adam::PASS.kernel, &[])?, gradients: Planes::new(gpu, "g_", capacity)? })
    }
}

/// Whether any coefficient of this degree of the spherical harmonics is not zero.
fn touches(planes: &[Vec<f32>; 8], degree: u32) -> bool {
    let degree = degree as usize;
    (degree * degree..(degree + 1) * (degree + 1)).any(|k| {
        let (group, at) = (k / 4, 3 * (k % 4));
        planes[SH0 + group].chunks_exact(12).any(|row| row[at..at + 3].iter().any(|v| v.to_bits() != 0))
    })
}
