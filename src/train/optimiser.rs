//! Adam over the eight planes of a model.

use super::schedule::{Adam, StepPlan};
use crate::pass::adam;
use crate::raster::{OPACITIES, PLANES, Planes};
use crate::vk::{self, Buffer, Gpu, Groups, Pipeline, Recorder};

/// Moments and the pass that uses them.
pub(super) struct Optimiser {
    /// First moments.
    pub(super) m: Planes,
    /// Second moments.
    pub(super) v: Planes,
    pipeline: Pipeline,
    settings: adam::Settings,
    extent: f64,
}

impl Optimiser {
    /// Moments for `capacity` splats, contents undefined. `extent` of the scene scales the learning rate of the means.
    pub(super) fn new(gpu: &Gpu, capacity: u32, extent: f64) -> Result<Self, vk::Error> {
        Ok(Self {
            m: Planes::new(gpu, "m_", capacity)?,
            v: Planes::new(gpu, "v_", capacity)?,
            pipeline: gpu.pipeline(&adam::PASS.kernel, &[])?,
            settings: adam::Settings::default(),
            extent,
        })
    }

    /// Records one optimiser step. `rows(k)` are the workgroups for plane k: one thread per float of the live rows.
    pub(super) fn record<'a>(
        &self,
        recorder: &mut Recorder,
        params: &Planes,
        grads: &Planes,
        counters: &Buffer,
        plan: &StepPlan,
        rows: impl Fn(u32) -> Groups<'a>,
    ) -> Result<(), vk::Error> {
        if plan.adam == Adam::None {
            return Ok(());
        }
        let rates = &plan.rates;
        let lr = [
            (rates.means * self.extent, 0),
            (rates.rotations, 0),
            (rates.scales, 0),
            (rates.opacities, 0),
            (rates.sh_rest, 3),
            (rates.sh_rest, 0),
            (rates.sh_rest, 0),
            (rates.sh_rest, 0),
        ];
        for (k, ((_, row), (rest, head))) in PLANES.into_iter().zip(lr).enumerate() {
            let steps = if k == OPACITIES {
                if plan.adam == Adam::AllButOpacities {
                    continue;
                }
                plan.adam_steps_opacities
            } else {
                plan.adam_steps
            };
            let push = adam::Push::new(&self.settings, steps, row, head, rates.sh_base, rest);
            let (g, p) = (&grads.buffers()[k], &params.buffers()[k]);
            let buffers = [counters, g, p, &self.m.buffers()[k], &self.v.buffers()[k]];
            recorder.dispatch(&self.pipeline, &buffers, &push, rows(row))?;
        }
        Ok(())
    }
}
