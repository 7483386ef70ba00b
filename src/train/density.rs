//! Density control on the device: rules, statistics, density changes and opacity resets.

mod order;
mod rules;
mod statistics;

pub use rules::{DensityRules, SampledGrowth, logit};
pub(super) use statistics::{Statistics, StatisticsInput};

use order::{ByBirth, Ordering};

use crate::pass::densify_gather::{MODE_COPY, MODE_MOMENT, MODE_SHARE, MODE_SHRINK, MODE_SHRINK_AXIS, MODE_ZERO};
use crate::pass::plan::{self, Entry};
use crate::pass::{
    counters, densify_axes, densify_classify, densify_finish, densify_gather, densify_limit, densify_map,
    densify_means, densify_sample, opacity_reset,
};
use crate::raster::SH_HIGHER;
use crate::raster::scan::{Scan, ScanExtent, Summand};
use crate::raster::sort::SortShape;
use crate::vk::{Buffer, BufferSlice, Gpu, Groups, Memory, Pipeline, Recorder, Result, slices};

/// Number of entries of `args` that a density change uses.
pub const ARGS: u32 = 5;

const WIDTHS: [u32; 8] = [3, 4, 3, 1, 12, 12, 12, 12];
const MEANS: usize = 0;
const QUATS: usize = 1;
const SCALES: usize = 2;
const OPACITIES: usize = 3;

/// Buffers that a density change reads and writes. Planes are in the model's order: means, quats, scales, opacities,
/// four groups of spherical harmonics. All planes have room for the same number of splats, except for harmonics above
/// degree 1 of a `plain` model.
#[derive(Clone, Copy)]
pub struct DensityModel<'a> {
    /// The parameters.
    pub planes: &'a [Buffer; 8],
    /// Whether no splat has harmonics above degree 1 yet. Their planes may have fewer rows and are left as they are.
    pub plain: bool,
    /// First moments of the optimiser, or the words that hold both moments.
    pub first_moments: &'a [Buffer; 8],
    /// Second moments of the optimiser, if they have planes of their own.
    pub second_moments: Option<&'a [Buffer; 8]>,
    /// Statistics, a vec4 per splat.
    pub stats: &'a Buffer,
    /// Scores of sampled growth, a vec2 per splat; `None` for growth by thresholds.
    pub scores: Option<&'a Buffer>,
    /// Persistent identities.
    pub ids: &'a Buffer,
    /// The counters.
    pub counters: &'a Buffer,
    /// Workgroup numbers of indirect dispatches.
    pub args: &'a Buffer,
    /// Scratch memory.
    pub scratch: Scratch<'a>,
}

impl DensityModel<'_> {
    /// Whether the rows of plane `p` move with the splats.
    fn moves(&self, p: usize) -> bool {
        p < SH_HIGHER || !self.plain
    }
}

/// Memory that density changes overwrite: two buffers of [`SCRATCH_BYTES`] per splat of the capacity, at least
/// [`SCRATCH_LEAST`] each. Training lends the buffers of the projected splats and of their gradients, which no pass
/// reads between two steps.
///
/// | bytes of `words`, per splat | contents |
/// |---|---|
/// | 16 | flags in four segments of `capacity` words: kept, clone, first child, second child |
/// | 16 | new rows of the flagged splats, in the same segments |
/// | 4 | source and kind of each new row |
/// | 4 | identities before the change |
///
/// `rows` holds the parts of `order::ByBirth`, and later a copy of the plane that is being moved, up to 48 bytes per
/// splat.
#[derive(Clone, Copy)]
pub struct Scratch<'a> {
    /// A copy of a plane.
    pub rows: &'a Buffer,
    /// Words of bookkeeping.
    pub words: &'a Buffer,
}

/// Bytes per splat that each buffer of [`Scratch`] has.
pub const SCRATCH_BYTES: u64 = 48;
/// Least bytes of each buffer of [`Scratch`]: room for the alignment of its parts.
pub const SCRATCH_LEAST: u64 = crate::raster::LEAST_2D;

impl<'a> Scratch<'a> {
    fn parts(self, capacity: u32, alignment: u64) -> ScratchParts<'a> {
        let mut end = 0u64;
        let [flags, offsets, map, old_ids] = [16, 16, 4, 4].map(|bytes| {
            let begin = end.next_multiple_of(alignment);
            end = begin + bytes * u64::from(capacity);
            self.words.slice(begin..end)
        });
        ScratchParts { flags, offsets, map, old_ids, scratch: self }
    }
}

/// The parts of the scratch memory.
#[derive(Clone, Copy)]
struct ScratchParts<'a> {
    flags: BufferSlice<'a>,
    offsets: BufferSlice<'a>,
    map: BufferSlice<'a>,
    old_ids: BufferSlice<'a>,
    scratch: Scratch<'a>,
}

/// The rules that decide which splats grow and which are pruned, and the event that keys the random draws.
#[derive(Clone, Copy)]
struct Decision<'a> {
    rules: &'a DensityRules,
    event: u32,
}

/// A plane whose rows have `width` floats.
#[derive(Clone, Copy)]
struct PlaneRows<'a> {
    plane: &'a Buffer,
    width: u32,
}

/// Pipelines of density changes.
pub struct DensityControl {
    capacity: u32,
    first_entry: u32,
    scan: Scan,
    tally: Buffer,
    alignment: u64,
    plan: Pipeline,
    classify: Pipeline,
    sample: Pipeline,
    limit: Pipeline,
    rows: Pipeline,
    axes: Pipeline,
    means: Pipeline,
    gathers: [(u32, Pipeline); 5],
    finish: Pipeline,
    reset: Pipeline,
    shape: SortShape,
    order: Ordering,
}

impl DensityControl {
    /// For models with room for `capacity` splats in a scene of the given extent. Uses entries `first_entry` to
    /// `first_entry + ARGS` of `args`, which no other pass may use; `shape` is that of the sorts.
    pub fn new(gpu: &Gpu, capacity: u32, first_entry: u32, extent: f64, shape: SortShape) -> Result<Self> {
        let capacity = capacity.max(1);
        let n = u64::from(capacity);
        let gather = |width: u32| -> Result<(u32, Pipeline)> {
            Ok((width, gpu.pipeline(&densify_gather::PASS.kernel, &[("WIDTH", width)])?))
        };
        Ok(Self {
            capacity,
            first_entry,
            scan: Scan::new(gpu, "densify_flags", 4 * n)?,
            tally: gpu.buffer("densify_tally", 16, Memory::Device)?,
            alignment: gpu.caps().limits.storage_alignment,
            plan: gpu.pipeline(&plan::PASS.kernel, &[])?,
            classify: gpu.pipeline(&densify_classify::PASS.kernel, &[])?,
            sample: gpu.pipeline(&densify_sample::PASS.kernel, &[])?,
            limit: gpu.pipeline(&densify_limit::PASS.kernel, &[])?,
            rows: gpu.pipeline(&densify_map::PASS.kernel, &[])?,
            axes: gpu.pipeline(&densify_axes::PASS.kernel, &[])?,
            means: gpu.pipeline(&densify_means::PASS.kernel, &[])?,
            gathers: [gather(1)?, gather(2)?, gather(3)?, gather(4)?, gather(12)?],
            finish: gpu.pipeline(&densify_finish::PASS.kernel, &[])?,
            reset: gpu.pipeline(&opacity_reset::PASS.kernel, &[])?,
            shape,
            order: Ordering::new(gpu, capacity, extent, shape)?,
        })
    }

    /// Bytes of the buffers, without the scratch memory, which is lent.
    pub fn bytes(&self) -> u64 {
        self.tally.size() + self.scan.bytes() + self.order.bytes()
    }

    /// Splats that fit.
    pub fn capacity(&self) -> u32 {
        self.capacity
    }

    /// Records a density change: clone, split, prune. Afterwards rows are in Morton order. No count comes back to the
    /// host: if the result has no room, status and wanted capacity are written to the counters and nothing else is
    /// written. `event` keys the random draws.
    pub fn record(&self, rec: &mut Recorder, model: &DensityModel<'_>, rules: &DensityRules, event: u32) -> Result<()> {
        let parts = model.scratch.parts(self.capacity, self.alignment);
        let ScratchParts { flags, offsets, map, old_ids, scratch } = parts;
        let sorted = self.order.record_births(rec, model)?;
        self.decide(rec, model, &parts, &sorted, Decision { rules, event })?;

        // The capacity is checked first: if the check fails, `plan` writes zeros only.
        let [entry_new, entry_old] = [self.first_entry, self.first_entry + ARGS - 1];
        let items = Entry::items(64);
        let [sort, table, once] = Ordering::entries(self.shape);
        let new = plan::Push::unlimited(counters::SCAN_TOTAL as u32, entry_new, &[items, sort, table, once]);
        let new = new.limited(self.capacity, counters::SPLATS_BIT, counters::WANT_SPLATS as u32);
        let old = plan::Push::unlimited(counters::SPLATS as u32, entry_old, &[items]);
        for push in [new, old] {
            rec.dispatch(&self.plan, &[model.counters, model.args], &push, Groups::Workgroups(1))?;
        }
        let new_rows = Groups::Indirect(model.args, Entry::offset(entry_new));
        let old_rows = Groups::Indirect(model.args, Entry::offset(entry_old));

        rec.copy(model.ids, 0, scratch.words, old_ids.offset(), 4 * u64::from(self.capacity))?;
        let counts: BufferSlice<'_> = model.counters.into();
        let buffers = [counts, flags, offsets, sorted.ids, sorted.map, sorted.new_ids];
        rec.dispatch(&self.rows, &buffers, &densify_map::Push { stride: self.capacity }, old_rows)?;
        self.order.record_rows(rec, &sorted, model, map, entry_new)?;

        if rules.sampled.is_some_and(|sampled| sampled.along_gradient) {
            let [quats, scales, moments] =
                slices([&model.planes[QUATS], &model.planes[SCALES], &model.first_moments[MEANS]]);
            let push = densify_axes::Push { packed_moments: u32::from(model.second_moments.is_none()) };
            rec.dispatch(&self.axes, &[counts, quats, scales, moments, map], &push, new_rows)?;
        }

        // Means before quats and scales: children are drawn from the old quats and scales of their parents.
        self.set_aside(rec, scratch, &model.planes[MEANS], WIDTHS[MEANS])?;
        let [source, means, quats, scales] =
            slices([scratch.rows, &model.planes[MEANS], &model.planes[QUATS], &model.planes[SCALES]]);
        let buffers = [counts, map, old_ids, source, quats, scales, means];
        let along_axis = u32::from(rules.sampled.is_some());
        let push = densify_means::Push { seed: rules.seed, event, along_axis };
        rec.dispatch(&self.means, &buffers, &push, new_rows)?;
        for (p, (plane, width)) in
            model.planes.iter().zip(WIDTHS).enumerate().filter(|(p, _)| *p != MEANS && model.moves(*p))
        {
            let mode = match p {
                SCALES if rules.sampled.is_some() => MODE_SHRINK_AXIS,
                SCALES => MODE_SHRINK,
                OPACITIES if rules.sampled.is_some() => MODE_SHARE,
                _ => MODE_COPY,
            };
            let push = densify_gather::Push { mode, keep: rules.keep_opacity };
            self.gather(rec, model, &parts, PlaneRows { plane, width }, push)?;
        }
        for moments in [model.first_moments].into_iter().chain(model.second_moments) {
            for (_, (plane, width)) in moments.iter().zip(WIDTHS).enumerate().filter(|(p, _)| model.moves(*p)) {
                let push = densify_gather::Push { mode: MODE_MOMENT, keep: 1.0 };
                self.gather(rec, model, &parts, PlaneRows { plane, width }, push)?;
            }
        }
        let zero = densify_gather::Push { mode: MODE_ZERO, keep: 1.0 };
        self.gather(rec, model, &parts, PlaneRows { plane: model.stats, width: 4 }, zero)?;
        if let Some(plane) = model.scores {
            self.gather(rec, model, &parts, PlaneRows { plane, width: 2 }, zero)?;
        }

        let push = densify_finish::Push { stride: self.capacity };
        rec.dispatch(&self.finish, &[counts, offsets, (&self.tally).into()], &push, Groups::Workgroups(1))
    }

    /// Records an opacity reset: clamps every opacity to at most `cap`, and sets the moments of opacities to zero.
    pub fn record_reset(&self, rec: &mut Recorder, model: &DensityModel<'_>, cap: f64) -> Result<()> {
        let push = plan::Push::unlimited(counters::SPLATS as u32, self.first_entry, &[Entry::items(64)]);
        rec.dispatch(&self.plan, &[model.counters, model.args], &push, Groups::Workgroups(1))?;
        let [plane, first, second] =
            [model.planes, model.first_moments, model.second_moments.unwrap_or(model.first_moments)]
                .map(|planes| &planes[OPACITIES]);
        let push = opacity_reset::Push { logit_cap: logit(cap) };
        let rows = Groups::Indirect(model.args, Entry::offset(self.first_entry));
        rec.dispatch(&self.reset, &[model.counters, plane, first, second], &push, rows)
    }

    /// Records the flags and the new rows of the flagged splats, in the order of birth.
    fn decide(
        &self,
        rec: &mut Recorder,
        model: &DensityModel<'_>,
        parts: &ScratchParts<'_>,
        sorted: &ByBirth<'_>,
        by: Decision<'_>,
    ) -> Result<()> {
        let Decision { rules, event } = by;
        let all = Groups::Items(u64::from(self.capacity));
        rec.fill(&self.tally, 0)?;
        let [means, quats, scales, opacities, sh0, sh1, sh2, sh3] = model.planes;
        let counts: BufferSlice<'_> = model.counters.into();
        let model_and_stats =
            slices([model.counters, means, quats, scales, opacities, sh0, sh1, sh2, sh3, model.stats]);
        let mut buffers = model_and_stats.to_vec();
        match (&rules.sampled, model.scores) {
            (Some(sampled), Some(scores)) => {
                buffers.extend([scores.into(), model.ids.into(), sorted.flags, (&self.tally).into()]);
                rec.dispatch(&self.sample, &buffers, &rules.sample_push(sampled, self.capacity, event), all)?;
            }
            _ => {
                buffers.extend([sorted.flags, (&self.tally).into()]);
                rec.dispatch(&self.classify, &buffers, &rules.classify_push(self.capacity), all)?;
            }
        }
        self.order.record_flags(rec, sorted, parts.flags)?;
        self.scan_flags(rec, model, parts)?;
        if let Some(max_splats) = rules.max_splats {
            let push = densify_limit::Push { stride: self.capacity, max_splats, seed: rules.seed, event };
            rec.dispatch(&self.limit, &[counts, parts.offsets, parts.flags], &push, all)?;
            self.scan_flags(rec, model, parts)?;
        }
        Ok(())
    }

    fn scan_flags(&self, rec: &mut Recorder, model: &DensityModel<'_>, parts: &ScratchParts<'_>) -> Result<()> {
        let extent = ScanExtent::host(4 * self.capacity);
        let total = counters::SCAN_TOTAL as u32;
        self.scan.record(rec, [parts.flags, parts.offsets], model.counters, extent, Summand::Words, total)
    }

    fn set_aside(&self, rec: &mut Recorder, scratch: Scratch<'_>, plane: &Buffer, width: u32) -> Result<()> {
        rec.copy(plane, 0, scratch.rows, 0, 4 * u64::from(width) * u64::from(self.capacity))
    }

    fn gather(
        &self,
        rec: &mut Recorder,
        model: &DensityModel<'_>,
        parts: &ScratchParts<'_>,
        rows: PlaneRows<'_>,
        push: densify_gather::Push,
    ) -> Result<()> {
        let PlaneRows { plane, width } = rows;
        let Some((_, pipeline)) = self.gathers.iter().find(|(w, _)| *w == width) else {
            return Ok(());
        };
        if push.mode != MODE_ZERO {
            self.set_aside(rec, parts.scratch, plane, width)?;
        }
        let [counts, source, plane] = slices([model.counters, parts.scratch.rows, plane]);
        let rows = Groups::Indirect(model.args, Entry::offset(self.first_entry));
        rec.dispatch(pipeline, &[counts, parts.map, source, plane], &push, rows)
    }
}
