//! Density changes and opacity resets of the engine's model.

use super::Engine;
use crate::raster::Planes;
use crate::train::Error;
use crate::train::density::{DensityModel, DensityRules, SampledGrowth, Scratch};
use crate::train::schedule::{Event, StepPlan};
use crate::train::settings::Growth;
use crate::vk::Recorder;

impl Engine {
    pub(super) fn record_density(&self, recorder: &mut Recorder, event: Event, plan: &StepPlan) -> Result<(), Error> {
        let density = &self.settings.density;
        // A change at most doubles the splats, so a limit above twice the capacity would cost a pass for nothing.
        let near = self.most_splats.filter(|most| self.size.splats.saturating_mul(2) > *most);
        let rules = DensityRules {
            clone_threshold: density.grad_threshold as f32,
            split_threshold: density.split_grad_threshold.unwrap_or(density.grad_threshold) as f32,
            split_absolute: density.absgrad,
            split_scale: density.percent_dense * self.needs.extent,
            prune_opacity: density.prune_opacity,
            prune_scale: (density.prune_extent > 0.0 && plan.densify.is_some_and(|d| d.prune_large))
                .then_some(density.prune_extent * self.needs.extent),
            max_splats: density.max_splats.into_iter().chain(near).min(),
            sampled: (density.growth == Growth::Sampled).then_some(SampledGrowth {
                low_threshold: if plan.low { density.low_grad_threshold } else { density.grad_threshold } as f32,
                high_threshold: density.grad_threshold as f32,
                absolute: density.absgrad,
                rate: density.sample_rate as f32,
                mask_share: density.sample_mask_share as f32,
                error_share: density.sample_error_share as f32,
                prune_unseen: density.prune_unseen && plan.densify.is_some_and(|d| d.sees_all),
                along_gradient: density.split_along_gradient,
            }),
            keep_opacity: density.keep_opacity as f32,
            seed: self.settings.run.seed as u32 ^ (self.settings.run.seed >> 32) as u32,
        };
        self.density.record(recorder, &self.density_model(), &rules, event.number())?;
        Ok(())
    }

    pub(super) fn density_model(&self) -> DensityModel<'_> {
        let [rows, words] = self.renderer.idle();
        DensityModel {
            planes: self.model.buffers(),
            plain: self.has_plain_splats(),
            first_moments: self.optimiser.first().buffers(),
            second_moments: self.optimiser.second().map(Planes::buffers),
            stats: self.statistics.stats(),
            scores: self.statistics.scores(),
            ids: &self.ids,
            counters: &self.renderer.counters,
            args: &self.renderer.args,
            scratch: Scratch { rows, words },
        }
    }
}
