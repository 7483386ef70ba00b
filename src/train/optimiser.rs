//! Adam over the eight planes of a model.

use std::sync::atomic::{AtomicU32, Ordering};

use super::schedule::{Adam, StepPlan};
use crate::pass::{adam, project_backward_adam as fused};
use crate::raster::{BackwardStep, OPACITIES, PLANES, Planes, Renderer, SH0, Shot};
use crate::vk::{self, Gpu, Pipeline, Recorder};

/// How a step is taken.
enum Form {
    /// In one pass with the projection's backward, one pipeline per degree of the spherical harmonics.
    Fused([Pipeline; 4]),
    /// From gradients in memory, for devices that bind fewer buffers to a pass.
    FromGradients { adam: Pipeline, gradients: Planes },
}

/// Moments and the passes that use them.
pub(super) struct Optimiser {
    /// First moments.
    pub(super) m: Planes,
    /// Second moments.
    pub(super) v: Planes,
    form: Form,
    settings: adam::Settings,
    extent: f64,
    /// Highest degree of the spherical harmonics that may have moments other than zero. Steps touch none above it.
    degree: AtomicU32,
}

impl Optimiser {
    /// Moments for `capacity` splats, contents undefined. `extent` of the scene scales the learning rate of the means.
    pub(super) fn new(gpu: &Gpu, capacity: u32, extent: f64) -> Result<Self, vk::Error> {
        let settings = adam::Settings::default();
        let form = if gpu.caps().limits.storage_buffers >= fused::BINDINGS {
            let of = |degree| gpu.pipeline(&fused::PASS.kernel, &fused::constants(&settings, degree, false));
            Form::Fused([of(0)?, of(1)?, of(2)?, of(3)?])
        } else {
            let adam = gpu.pipeline(&adam::PASS.kernel, &[])?;
            Form::FromGradients { adam, gradients: Planes::new(gpu, "g_", capacity)? }
        };
        Ok(Self {
            m: Planes::new(gpu, "m_", capacity)?,
            v: Planes::new(gpu, "v_", capacity)?,
            form,
            settings,
            extent,
            degree: AtomicU32::new(0),
        })
    }

    /// Records setting every moment to zero.
    pub(super) fn clear(&self, recorder: &mut Recorder) -> Result<(), vk::Error> {
        self.m.clear(recorder)?;
        self.v.clear(recorder)
    }

    /// Writes moments of an earlier run.
    pub(super) fn restore(&self, gpu: &Gpu, [m, v]: [&[Vec<f32>; 8]; 2]) -> Result<(), vk::Error> {
        self.m.write_rows(gpu, m)?;
        self.v.write_rows(gpu, v)?;
        let used = (1..=3).rev().find(|&degree| [m, v].iter().any(|planes| touches(planes, degree)));
        self.degree.fetch_max(used.unwrap_or(0), Ordering::Relaxed);
        Ok(())
    }

    /// Bytes of its buffers.
    pub(super) fn bytes(&self) -> u64 {
        let gradients = match &self.form {
            Form::Fused(_) => 0,
            Form::FromGradients { gradients, .. } => gradients.bytes(),
        };
        self.m.bytes() + self.v.bytes() + gradients
    }

    /// Room for more, with the same moments; gradients are lost. Waits.
    pub(super) fn grow(&mut self, gpu: &Gpu, capacity: u32) -> Result<(), vk::Error> {
        if let Form::FromGradients { gradients, .. } = &mut self.form {
            *gradients = Planes::new(gpu, "g_", 1)?;
        }
        self.m.grow(gpu, capacity)?;
        self.v.grow(gpu, capacity)?;
        if let Form::FromGradients { gradients, .. } = &mut self.form {
            *gradients = Planes::new(gpu, "g_", capacity)?;
        }
        Ok(())
    }

    /// Records one optimiser step of `model`, after the blend backward of the shot.
    pub(super) fn record(
        &self,
        recorder: &mut Recorder,
        renderer: &Renderer,
        model: &Planes,
        shot: &Shot,
        plan: &StepPlan,
    ) -> Result<(), vk::Error> {
        if plan.adam == Adam::None {
            return Ok(());
        }
        let rates = fused::Rates {
            means: plan.rates.means * self.extent,
            quats: plan.rates.rotations,
            scales: plan.rates.scales,
            opacities: plan.rates.opacities,
            sh_base: plan.rates.sh_base,
            sh_rest: plan.rates.sh_rest,
        };
        let opacities = (plan.adam == Adam::All).then_some(plan.adam_steps_opacities);
        let steps = fused::Steps { most: plan.adam_steps, opacities };
        let degree = self.degree.fetch_max(plan.sh_degree, Ordering::Relaxed).max(plan.sh_degree);
        match &self.form {
            Form::Fused(pipelines) => {
                let step = BackwardStep {
                    model,
                    moments: [&self.m, &self.v],
                    pipeline: &pipelines[degree.min(3) as usize],
                    settings: &self.settings,
                    rates: &rates,
                    steps,
                };
                renderer.record_backward_step(recorder, &step, shot)
            }
            Form::FromGradients { adam, gradients } => {
                renderer.record_project_backward(recorder, model, gradients, shot)?;
                self.record_from_gradients(recorder, (model, gradients), renderer, (&rates, steps), adam)
            }
        }
    }

    fn record_from_gradients(
        &self,
        recorder: &mut Recorder,
        (params, gradients): (&Planes, &Planes),
        renderer: &Renderer,
        (rates, steps): (&fused::Rates, fused::Steps),
        pipeline: &Pipeline,
    ) -> Result<(), vk::Error> {
        let geometry = [rates.means, rates.quats, rates.scales, rates.opacities];
        for (k, (_, row)) in PLANES.into_iter().enumerate() {
            let Some(count) = (if k == OPACITIES { steps.opacities } else { Some(steps.most) }) else { continue };
            let rest = geometry.get(k).copied().unwrap_or(rates.sh_rest);
            let head = if k == SH0 { 3 } else { 0 };
            let push = adam::Push::new(&self.settings, count, row, head, rates.sh_base, rest);
            let [g, p, m, v] = [gradients, params, &self.m, &self.v].map(|planes| &planes.buffers()[k]);
            recorder.dispatch(pipeline, &[&renderer.counters, g, p, m, v], &push, renderer.per_float(row))?;
        }
        Ok(())
    }
}

/// Whether a coefficient of this degree has a value other than zero in planes of spherical harmonics.
fn touches(planes: &[Vec<f32>; 8], degree: u32) -> bool {
    let degree = degree as usize;
    (degree * degree..(degree + 1) * (degree + 1)).any(|k| {
        let (group, at) = (k / 4, 3 * (k % 4));
        planes[SH0 + group].chunks_exact(12).any(|row| row[at..at + 3].iter().any(|v| v.to_bits() != 0))
    })
}
