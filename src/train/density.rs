//! Density control on the device: rules, and the recording of a whole density change or opacity reset.

mod rules;

pub use rules::{DensityRules, logit};

use crate::pass::densify_gather::{MODE_COPY, MODE_MOMENT, MODE_SHRINK, MODE_ZERO};
use crate::pass::plan::{self, Entry};
use crate::pass::{
    counters, densify_classify, densify_finish, densify_gather, densify_limit, densify_map, densify_means,
    opacity_reset,
};
use crate::raster::scan::{Extent, Scan, Summand};
use crate::vk::{Buffer, Gpu, Groups, Memory, Pipeline, Recorder, Result};

/// Entries of `args` that a density change plans.
pub const ARGS: u32 = 2;

const WIDTHS: [u32; 8] = [3, 4, 3, 1, 12, 12, 12, 12];
const MEANS: usize = 0;
const QUATS: usize = 1;
const SCALES: usize = 2;
const OPACITIES: usize = 3;

/// What a density change reads and writes and what outlives it. Planes are in the model's order: means, rotations, scales,
/// opacities, four groups of spherical harmonics; all have room for the same number of splats.
#[derive(Clone, Copy)]
pub struct Model<'a> {
    /// The parameters.
    pub planes: &'a [Buffer; 8],
    /// First moments of the optimiser.
    pub first_moments: &'a [Buffer; 8],
    /// Second moments of the optimiser.
    pub second_moments: &'a [Buffer; 8],
    /// Statistics, a vec4 per splat.
    pub stats: &'a Buffer,
    /// Persistent identities.
    pub ids: &'a Buffer,
    /// The counters.
    pub counters: &'a Buffer,
    /// Workgroup numbers of indirect dispatches.
    pub args: &'a Buffer,
}

/// Pipelines and scratch memory (about 88 bytes per splat of the capacity) of density changes.
pub struct DensityControl {
    capacity: u32,
    first_entry: u32,
    scan: Scan,
    /// Four segments of `capacity` words: kept, clone, first child, second child.
    flags: Buffer,
    offsets: Buffer,
    tally: Buffer,
    map: Buffer,
    old_ids: Buffer,
    /// A copy of the plane that is being moved; as large as the largest.
    source: Buffer,
    plan: Pipeline,
    classify: Pipeline,
    limit: Pipeline,
    rows: Pipeline,
    means: Pipeline,
    gathers: [(u32, Pipeline); 4],
    finish: Pipeline,
    reset: Pipeline,
}

impl DensityControl {
    /// For models with room for `capacity` splats. Entries `first_entry` to `first_entry + ARGS` of `args` are its own.
    pub fn new(gpu: &Gpu, capacity: u32, first_entry: u32) -> Result<Self> {
        let capacity = capacity.max(1);
        let n = u64::from(capacity);
        let device = |name: &str, bytes: u64| gpu.buffer(name, bytes, Memory::Device);
        let gather = |width: u32| -> Result<(u32, Pipeline)> {
            Ok((width, gpu.pipeline(&densify_gather::PASS.kernel, &[("WIDTH", width)])?))
        };
        Ok(Self {
            capacity,
            first_entry,
            scan: Scan::new(gpu, "densify_flags", 4 * n)?,
            flags: device("densify_flags", 16 * n)?,
            offsets: device("densify_offsets", 16 * n)?,
            tally: device("densify_tally", 16)?,
            map: device("densify_map", 4 * n)?,
            old_ids: device("densify_old_ids", 4 * n)?,
            source: device("densify_source", 48 * n)?,
            plan: gpu.pipeline(&plan::PASS.kernel, &[])?,
            classify: gpu.pipeline(&densify_classify::PASS.kernel, &[])?,
            limit: gpu.pipeline(&densify_limit::PASS.kernel, &[])?,
            rows: gpu.pipeline(&densify_map::PASS.kernel, &[])?,
            means: gpu.pipeline(&densify_means::PASS.kernel, &[])?,
            gathers: [gather(1)?, gather(3)?, gather(4)?, gather(12)?],
            finish: gpu.pipeline(&densify_finish::PASS.kernel, &[])?,
            reset: gpu.pipeline(&opacity_reset::PASS.kernel, &[])?,
        })
    }

    /// Splats that fit.
    pub fn capacity(&self) -> u32 {
        self.capacity
    }

    /// Records a density change: clone, split, prune. The host learns of no count: when the result has no room, the status
    /// and the wish are noted and nothing else is written. `event` keys the random draws.
    pub fn record(&self, rec: &mut Recorder, model: &Model<'_>, rules: &DensityRules, event: u32) -> Result<()> {
        self.decide(rec, model, rules)?;

        // The capacity is checked first: once it has failed, `plan` writes nothing but zeros.
        let [entry_new, entry_old] = [self.first_entry, self.first_entry + 1];
        let items = [Entry::items(64)];
        let new = plan::Push::unlimited(counters::SCAN_TOTAL as u32, entry_new, &items);
        let new = new.limited(self.capacity, counters::SPLATS_BIT, counters::WANT_SPLATS as u32);
        let old = plan::Push::unlimited(counters::SPLATS as u32, entry_old, &items);
        for push in [new, old] {
            rec.dispatch(&self.plan, &[model.counters, model.args], &push, Groups::Workgroups(1))?;
        }
        let new_rows = Groups::Indirect(model.args, Entry::offset(entry_new));
        let old_rows = Groups::Indirect(model.args, Entry::offset(entry_old));

        rec.copy(model.ids, 0, &self.old_ids, 0, 4 * u64::from(self.capacity))?;
        let buffers = [model.counters, &self.flags, &self.offsets, &self.old_ids, &self.map, model.ids];
        rec.dispatch(&self.rows, &buffers, &densify_map::Push { stride: self.capacity }, old_rows)?;

        // Centres before rotations and scales: children are drawn from their parents' old ones.
        let [means, quats, scales] = [MEANS, QUATS, SCALES].map(|p| &model.planes[p]);
        self.set_aside(rec, means, WIDTHS[MEANS])?;
        let buffers = [model.counters, &self.map, &self.old_ids, &self.source, quats, scales, means];
        rec.dispatch(&self.means, &buffers, &densify_means::Push { seed: rules.seed, event }, new_rows)?;
        for (p, (plane, width)) in model.planes.iter().zip(WIDTHS).enumerate().filter(|(p, _)| *p != MEANS) {
            let mode = if p == SCALES { MODE_SHRINK } else { MODE_COPY };
            self.gather(rec, model, plane, width, mode)?;
        }
        for moments in [model.first_moments, model.second_moments] {
            for (plane, width) in moments.iter().zip(WIDTHS) {
                self.gather(rec, model, plane, width, MODE_MOMENT)?;
            }
        }
        self.gather(rec, model, model.stats, 4, MODE_ZERO)?;

        let push = densify_finish::Push { stride: self.capacity };
        rec.dispatch(&self.finish, &[model.counters, &self.offsets, &self.tally], &push, Groups::Workgroups(1))
    }

    /// Records an opacity reset: every opacity at most `cap`, moments of opacities zero.
    pub fn record_reset(&self, rec: &mut Recorder, model: &Model<'_>, cap: f64) -> Result<()> {
        let push = plan::Push::unlimited(counters::SPLATS as u32, self.first_entry, &[Entry::items(64)]);
        rec.dispatch(&self.plan, &[model.counters, model.args], &push, Groups::Workgroups(1))?;
        let [plane, first, second] =
            [model.planes, model.first_moments, model.second_moments].map(|planes| &planes[OPACITIES]);
        let push = opacity_reset::Push { logit_cap: logit(cap) };
        let rows = Groups::Indirect(model.args, Entry::offset(self.first_entry));
        rec.dispatch(&self.reset, &[model.counters, plane, first, second], &push, rows)
    }

    /// Flags and where the flagged rows go.
    fn decide(&self, rec: &mut Recorder, model: &Model<'_>, rules: &DensityRules) -> Result<()> {
        let all = Groups::Items(u64::from(self.capacity));
        rec.fill(&self.tally, 0)?;
        let [means, quats, scales, opacities, sh0, sh1, sh2, sh3] = model.planes;
        let buffers = [
            model.counters,
            means,
            quats,
            scales,
            opacities,
            sh0,
            sh1,
            sh2,
            sh3,
            model.stats,
            &self.flags,
            &self.tally,
        ];
        rec.dispatch(&self.classify, &buffers, &rules.classify_push(self.capacity), all)?;
        self.scan_flags(rec, model)?;
        if let Some(max_splats) = rules.max_splats {
            let push = densify_limit::Push { stride: self.capacity, max_splats };
            rec.dispatch(&self.limit, &[model.counters, &self.offsets, &self.flags], &push, all)?;
            self.scan_flags(rec, model)?;
        }
        Ok(())
    }

    fn scan_flags(&self, rec: &mut Recorder, model: &Model<'_>) -> Result<()> {
        let extent = Extent::host(4 * self.capacity);
        let total = counters::SCAN_TOTAL as u32;
        self.scan.record(rec, [&self.flags, &self.offsets], model.counters, extent, Summand::Words, total)
    }

    fn set_aside(&self, rec: &mut Recorder, plane: &Buffer, width: u32) -> Result<()> {
        rec.copy(plane, 0, &self.source, 0, 4 * u64::from(width) * u64::from(self.capacity))
    }

    fn gather(&self, rec: &mut Recorder, model: &Model<'_>, plane: &Buffer, width: u32, mode: u32) -> Result<()> {
        let Some((_, pipeline)) = self.gathers.iter().find(|(w, _)| *w == width) else {
            return Ok(());
        };
        if mode != MODE_ZERO {
            self.set_aside(rec, plane, width)?;
        }
        let buffers = [model.counters, &self.map, &self.source, plane];
        let rows = Groups::Indirect(model.args, Entry::offset(self.first_entry));
        rec.dispatch(pipeline, &buffers, &densify_gather::Push { mode }, rows)
    }
}
