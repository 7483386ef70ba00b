//! Forward and backward pass of one view.

mod backward;
mod kept;

pub use backward::{BackwardStep, GradientTerms, Gradients, ImageGradients};

use backward::Backward;
use kept::{Kept, KeptForm};

use super::memory_footprint::MemoryFootprint;
use super::pass_select;
use super::planes::Planes;
use super::planes::ShStorage;
use super::scratch_buffers::{ScratchBuffers, ScratchLayout};
use super::size::{LEAST_2D, ROW_2D, Size};
use super::sort::SortShape;
use super::target::Target;
use super::tiles::{Capacities, FrameLists, SPLAT_ENTRIES, TileListInputs, TileLists};
use super::variants::{GradientSum, Variants};
use crate::pass::camera::{CameraPush, Projection, clamp_limits};
use crate::pass::plan::{self, Entry};
use crate::pass::{alpha_min, blend_forward, constrain, counters, depth_probe, project, splat_outlines};
use crate::scene::Camera;
use crate::scene::tile::TileGrid;
use crate::vk::{self, Buffer, BufferRange, Gpu, Groups, Memory, Pipeline, Recorder, slices};

/// Entries of `args` that the renderer plans from the number of splats. The entries of the tile lists follow directly,
/// because one dispatch plans both.
mod entry {
    /// One thread per splat, 64 in a workgroup.
    pub(super) const SPLATS: u32 = 0;
    /// One thread per float of rows of 3.
    pub(super) const ROWS_3: u32 = 1;
    /// One thread per float of rows of 4.
    pub(super) const ROWS_4: u32 = 2;
    /// One thread per float of rows of 12.
    pub(super) const ROWS_12: u32 = 3;
    /// One workgroup, for a pass that runs once per event.
    pub(super) const ONCE: u32 = 4;
    /// First entry of the tile lists.
    pub(super) const TILES: u32 = 5;
}

/// First entry of `args` that belongs to density control.
pub const DENSITY_ENTRY: u32 = 32;

/// Entries in the `args` buffer.
const ENTRIES: u32 = 64;

/// A view to render: camera, projection and background.
#[derive(Clone, Copy, Debug)]
pub struct RenderView {
    /// Camera in scene coordinates.
    pub camera: Camera,
    /// How splats are projected.
    pub projection: Projection,
    /// Background colour (r, g, b).
    pub background: [f32; 3],
}

/// The splats that a render shows, told apart by identity.
#[derive(Clone, Copy)]
pub struct Subset<'a> {
    /// Identities of the model's splats, one `u32` each.
    pub ids: &'a Buffer,
    /// Which splats.
    pub part: Part,
}

/// The stage in which a splat began.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Splats with an identity below the bound in [`counters::CONSTRAINED`]: those of the low-frequency stage.
    Low,
    /// All others.
    High,
}

impl RenderView {
    /// The view of a window of the image, `at` (x, y), of `size` (width, height). Pixels keep their values.
    pub fn window(&self, at: (u32, u32), size: (u32, u32)) -> Self {
        let limits = self.projection.limits.unwrap_or_else(|| clamp_limits(&self.camera));
        let projection = Projection { limits: Some(limits), ..self.projection };
        Self { camera: self.camera.window(at, size), projection, ..*self }
    }

    fn blend_push(&self) -> blend_forward::Push {
        let [red, green, blue] = self.background;
        blend_forward::Push { width: self.camera.width, height: self.camera.height, red, green, blue }
    }
}

/// Forward pipelines that depend on the auxiliary channels (depth, normals) and on the alpha cutoff.
#[derive(Clone)]
struct ForwardPipelines {
    project: Pipeline,
    /// Constants of every variant of the projection.
    projection: [(&'static str, u32); 5],
    blend: Pipeline,
}

/// What forward pipelines are made for.
#[derive(Clone, Copy, Default)]
struct ForwardForm {
    /// See [`alpha_min`].
    cutoff: Option<u32>,
    aux: bool,
    orthographic: bool,
}

impl ForwardPipelines {
    fn new(gpu: &Gpu, variants: Variants, form: ForwardForm, count: bool, kept: KeptForm) -> Result<Self, vk::Error> {
        let (side, aux) = (variants.tile.size(), ("AUX", u32::from(form.aux)));
        let alpha_min = alpha_min::constant(form.cutoff);
        let orthographic = ("ORTHOGRAPHIC", u32::from(form.orthographic));
        let projection = [("TILE_W", side), ("TILE_H", side), aux, orthographic, alpha_min];
        let chosen = pass_select::blend_forward(gpu, variants);
        let mut switches = vec![aux, ("COUNT", u32::from(count)), alpha_min];
        switches.extend(chosen.constants);
        switches.extend(kept.of_forward());
        Ok(Self {
            project: gpu.pipeline(&pass_select::projection(gpu).kernel, &projection)?,
            projection,
            blend: gpu.pipeline(&chosen.pass.kernel, &switches)?,
        })
    }
}

/// The differentiable renderer: passes from a model to an image and back, with their intermediate buffers.
pub struct Renderer {
    gpu: Gpu,
    variants: Variants,
    /// Counters and status: see [`counters`].
    pub counters: Buffer,
    /// Indirect workgroup counts.
    pub args: Buffer,
    /// Projected splats, 12 floats each.
    pub splat2d: Buffer,
    /// Tiles touched by each splat; 0 when culled.
    pub tile_counts: Buffer,
    normals: Buffer,
    pair_counts: Buffer,
    /// Placeholder for the weights buffer of [`Self::record_weights`].
    no_weights: Buffer,
    lists: TileLists,
    /// Scratch memory: see [`ScratchLayout`]. Begins with the gradients of the projected splats.
    early: Buffer,
    plan: Pipeline,
    colour: ForwardPipelines,
    all: ForwardPipelines,
    kept: Kept,
    backward: Option<Backward>,
    splat_capacity: u32,
    pair_capacity: u32,
    with_aux: bool,
    counts: bool,
}

impl Renderer {
    /// Allocates buffers and creates pipelines for models and images of up to `size`.
    pub fn new(gpu: &Gpu, variants: Variants, size: Size) -> Result<Self, vk::Error> {
        let n = u64::from(size.splats.max(1));
        let kept = Kept::new(gpu, variants, &size)?;
        let channels = |aux: bool| {
            let form = ForwardForm { aux, ..ForwardForm::default() };
            ForwardPipelines::new(gpu, variants, form, size.count, kept.form())
        };
        let counters = gpu.buffer("counters", 4 * counters::COUNT as u64, Memory::Device)?;
        let args = gpu.buffer("args", 16 * u64::from(ENTRIES), Memory::Device)?;
        let (splats, pairs, tiles) = (u64::from(size.splats), u64::from(size.pairs), u64::from(size.tiles));
        let capacities = Capacities { splats, pairs, tiles };
        let (lists, shape) = (variants.lists, SortShape::of(gpu.caps()));
        let slots = size.train && variants.gradients == GradientSum::Slots;
        let for_lists = ScratchLayout::new(gpu, &capacities, lists, shape).bytes();
        let early = if size.train {
            gpu.buffer("grad2d", for_lists.max(ROW_2D * n).max(LEAST_2D), Memory::Device)?
        } else {
            gpu.buffer("lists", for_lists, Memory::Device)?
        };
        let backward = if size.train {
            Some(Backward::new(gpu, variants, &size, BufferRange::of(&early, 0..ROW_2D * n), kept.form())?)
        } else {
            None
        };
        // The splats of slots are no longer needed when gradients are written to the slots, so both share memory.
        let slot_splat =
            backward.as_ref().filter(|_| slots).map(|b| BufferRange::of(&b.slot_grads, 0..4 * pairs.max(1)));
        let lists = TileLists::within(
            gpu,
            capacities,
            lists,
            shape,
            ScratchBuffers { early: &early, slot_splat },
            size.listed,
        )?;
        Ok(Self {
            gpu: gpu.clone(),
            variants,
            counters,
            args,
            splat2d: gpu.buffer("splat2d", (ROW_2D * n).max(LEAST_2D), Memory::Device)?,
            tile_counts: gpu.buffer("tile_counts", 4 * n, Memory::Device)?,
            normals: gpu.buffer("normals", if size.aux { 16 * n } else { 16 }, Memory::Device)?,
            pair_counts: gpu.buffer("pair_counts", 16, Memory::Device)?,
            no_weights: gpu.buffer("no_weights", 16, Memory::Device)?,
            lists,
            early,
            plan: gpu.pipeline(&plan::PASS.kernel, &[])?,
            colour: channels(false)?,
            all: channels(size.aux)?,
            kept,
            backward,
            splat_capacity: size.splats,
            pair_capacity: size.pairs,
            with_aux: size.aux,
            counts: size.count,
        })
    }

    /// Sorts splats by only the highest `bits` bits of their depth: see [`TileLists::sort_depths_by`].
    pub fn sort_depths_by(&mut self, bits: u32) {
        self.lists.sort_depths_by(bits);
    }

    /// The variant set in use.
    pub fn variants(&self) -> Variants {
        self.variants
    }

    /// Most splats that fit.
    pub fn splat_capacity(&self) -> u32 {
        self.splat_capacity
    }

    /// Most (splat, tile) pairs that fit.
    pub fn pair_capacity(&self) -> u32 {
        self.pair_capacity
    }

    /// Counts of evaluated and blended (pixel, splat) pairs, forward then backward, since the last clearing; zeros
    /// unless [`Size::count`] is on.
    pub fn pair_counts(&self) -> &Buffer {
        &self.pair_counts
    }

    /// Workgroups for one thread per splat of the model.
    pub fn per_splat(&self) -> Groups<'_> {
        Groups::Indirect(&self.args, Entry::offset(entry::SPLATS))
    }

    /// Workgroups for one thread per float of rows of `row` floats.
    pub fn per_float(&self, row: u32) -> Groups<'_> {
        let entry = match row {
            3 => entry::ROWS_3,
            4 => entry::ROWS_4,
            12 => entry::ROWS_12,
            _ => entry::SPLATS,
        };
        Groups::Indirect(&self.args, Entry::offset(entry))
    }

    /// One workgroup, or none when the event is void.
    pub fn once(&self) -> Groups<'_> {
        Groups::Indirect(&self.args, Entry::offset(entry::ONCE))
    }

    /// Plans the dispatches that depend only on the number of splats.
    fn record_plan(&self, recorder: &mut Recorder) -> Result<(), vk::Error> {
        let rows = |floats: u32| Entry { divide: 1, multiply: floats, items: 64 };
        let [scan, items, once] = SPLAT_ENTRIES;
        let entries = [Entry::items(64), rows(3), rows(4), rows(12), Entry::fixed(1), scan, items, once];
        let push = plan::Push::unlimited(counters::SPLATS as u32, entry::SPLATS, &entries)
            .limited(self.splat_capacity, counters::SPLATS_BIT, plan::NO_COUNTER)
            .voiding(ENTRIES);
        recorder.dispatch(&self.plan, &[&self.counters, &self.args], &push, Groups::Workgroups(1))
    }

    /// Renders `model` into `target`. `aux` adds depth and normals; the renderer and the target must have auxiliary
    /// channels.
    pub fn record_forward(
        &self,
        recorder: &mut Recorder,
        model: &Planes,
        view: &RenderView,
        target: &Target,
        aux: bool,
    ) -> Result<FrameLists<'_>, vk::Error> {
        self.record_forward_of(recorder, model, view, target, aux, None)
    }

    /// Renders `model` into `target`, and raises `weights` (one float per splat) to the splat's largest blending
    /// weight, alpha times transmittance, in any pixel.
    pub fn record_weights(
        &self,
        recorder: &mut Recorder,
        model: &Planes,
        view: &RenderView,
        target: &Target,
        weights: &Buffer,
    ) -> Result<(), vk::Error> {
        let chosen = pass_select::blend_forward(&self.gpu, self.variants);
        let mut switches = vec![("AUX", 0), ("WEIGHTS", 1), alpha_min::constant(view.projection.alpha_cutoff)];
        switches.extend(chosen.constants);
        let blend = self.gpu.pipeline(&chosen.pass.kernel, &switches)?;
        let channels = self.channels(view, false)?;
        self.record_lists(recorder, model, view, &channels, None)
            .and_then(|lists| self.record_blend(recorder, &blend, &lists, view, target, weights))
    }

    /// Draws the outlines of the splats of `model` into `target`: see [`splat_outlines`].
    pub fn record_outlines(
        &self,
        recorder: &mut Recorder,
        model: &Planes,
        view: &RenderView,
        target: &Target,
        subset: Option<Subset<'_>>,
    ) -> Result<(), vk::Error> {
        let (width, height) = (view.camera.width, view.camera.height);
        let pipeline = self.gpu.pipeline(&splat_outlines::PASS.kernel, &[])?;
        let channels = self.channels(view, false)?;
        let lists = self.record_lists(recorder, model, view, &channels, subset)?;
        let [splat2d, image] = slices([&self.splat2d, &target.image]);
        let [red, green, blue] = view.background;
        let push = splat_outlines::Push { width, height, side: self.variants.tile.size(), red, green, blue };
        let groups = Groups::Workgroups(u64::from(depth_probe::groups(width, height)));
        recorder.dispatch(&pipeline, &[splat2d, lists.sorted_splats, lists.tile_ranges, image], &push, groups)
    }

    /// Writes (median depth, weight in front, weight behind, final transmittance) of each pixel of a picture of `model`
    /// to `probe`, rows of four floats, as [`depth_probe`] has them. `known` has a depth in scene units for each pixel,
    /// 0 where none is known.
    pub fn record_probe(
        &self,
        recorder: &mut Recorder,
        model: &Planes,
        view: &RenderView,
        known: Option<&Buffer>,
        probe: &Buffer,
    ) -> Result<(), vk::Error> {
        let lists = self.record_lists(recorder, model, view, &self.channels(view, true)?, None)?;
        self.record_depths(recorder, &lists, view, known, probe)
    }

    fn record_depths(
        &self,
        recorder: &mut Recorder,
        lists: &FrameLists<'_>,
        view: &RenderView,
        known: Option<&Buffer>,
        probe: &Buffer,
    ) -> Result<(), vk::Error> {
        let (width, height) = (view.camera.width, view.camera.height);
        let given = [("KNOWN", u32::from(known.is_some())), alpha_min::constant(view.projection.alpha_cutoff)];
        let pipeline = self.gpu.pipeline(&depth_probe::PASS.kernel, &given)?;
        // Without known depths another buffer stands for them, and is not read.
        let [splat2d, normals, known, probe] =
            slices([&self.splat2d, &self.normals, known.unwrap_or(&self.no_weights), probe]);
        let buffers = [splat2d, normals, lists.sorted_splats, lists.tile_ranges, known, probe];
        let push = depth_probe::Push { width, height, side: self.variants.tile.size() };
        let groups = Groups::Workgroups(u64::from(depth_probe::groups(width, height)));
        recorder.dispatch(&pipeline, &buffers, &push, groups)
    }

    /// Renders `model` into `target` without auxiliary channels, and writes the rows of [`Self::record_probe`], without
    /// known depths, to `probe`: both of one projection.
    pub fn record_surface(
        &self,
        recorder: &mut Recorder,
        model: &Planes,
        view: &RenderView,
        target: &Target,
        probe: &Buffer,
    ) -> Result<(), vk::Error> {
        let lists = self.record_lists(recorder, model, view, &self.channels(view, true)?, None)?;
        let blend = self.channels(view, false)?.blend;
        self.record_blend(recorder, &blend, &lists, view, target, &self.no_weights)?;
        self.record_depths(recorder, &lists, view, None, probe)
    }

    /// Like [`Self::record_forward`]. With `subset`, renders only the splats of a part of the model.
    pub fn record_forward_of(
        &self,
        recorder: &mut Recorder,
        model: &Planes,
        view: &RenderView,
        target: &Target,
        aux: bool,
        subset: Option<Subset<'_>>,
    ) -> Result<FrameLists<'_>, vk::Error> {
        let channels = self.channels(view, aux)?;
        let lists = self.record_lists(recorder, model, view, &channels, subset)?;
        self.record_blend(recorder, &channels.blend, &lists, view, target, &self.no_weights)?;
        Ok(lists)
    }

    fn channels(&self, view: &RenderView, aux: bool) -> Result<ForwardPipelines, vk::Error> {
        let aux = aux && self.with_aux;
        let Projection { alpha_cutoff: cutoff, orthographic, .. } = view.projection;
        if cutoff.is_none() && !orthographic {
            return Ok(if aux { &self.all } else { &self.colour }.clone());
        }
        let form = ForwardForm { cutoff, aux, orthographic };
        ForwardPipelines::new(&self.gpu, self.variants, form, self.counts, self.kept.form())
    }

    /// Projects `model` and builds the splat list of every tile.
    fn record_lists(
        &self,
        recorder: &mut Recorder,
        model: &Planes,
        view: &RenderView,
        channels: &ForwardPipelines,
        subset: Option<Subset<'_>>,
    ) -> Result<FrameLists<'_>, vk::Error> {
        let (width, height) = (view.camera.width, view.camera.height);
        self.record_plan(recorder)?;
        let push = CameraPush::new(&view.camera, &view.projection);
        let mut buffers = vec![&self.counters];
        buffers.extend(model.buffers());
        buffers.extend([&self.splat2d, &self.tile_counts, &self.normals]);
        match model.sh() {
            ShStorage::Full => recorder.dispatch(&channels.project, &buffers, &push, self.per_splat())?,
            ShStorage::Half => {
                let project = self.gpu.pipeline(&project::HALF.kernel, &channels.projection)?;
                recorder.dispatch(&project, &buffers, &push, self.per_splat())?;
            }
        }
        if let Some(Subset { ids, part }) = subset {
            let constrain = self.gpu.pipeline(&constrain::PASS.kernel, &[])?;
            let push = constrain::Push { others: u32::from(part == Part::High) };
            recorder.dispatch(&constrain, &[&self.counters, ids, &self.tile_counts], &push, self.per_splat())?;
        }

        let side = self.variants.tile.size();
        let inputs = TileListInputs {
            splat2d: &self.splat2d,
            tile_counts: &self.tile_counts,
            counters: &self.counters,
            args: &self.args,
            first_entry: entry::TILES,
            entries: ENTRIES,
            alpha_cutoff: view.projection.alpha_cutoff,
        };
        self.lists.record(recorder, inputs, &TileGrid::new([width, height], [side, side]))
    }

    fn record_blend(
        &self,
        recorder: &mut Recorder,
        blend: &Pipeline,
        lists: &FrameLists<'_>,
        view: &RenderView,
        target: &Target,
        weights: &Buffer,
    ) -> Result<(), vk::Error> {
        let (width, height) = (view.camera.width, view.camera.height);
        let [splat2d, normals, image, aux, last, counted, weights] = slices([
            &self.splat2d,
            &self.normals,
            &target.image,
            &target.aux,
            &target.last,
            &self.pair_counts,
            weights,
        ]);
        let mut buffers =
            vec![splat2d, normals, lists.sorted_splats, lists.tile_ranges, image, aux, last, counted, weights];
        if self.kept.form().pixel {
            buffers.extend(slices([&self.kept.masks, &self.kept.states]));
        }
        recorder.dispatch(blend, &buffers, &view.blend_push(), Groups::Workgroups(self.tiles(width, height)))
    }

    fn tiles(&self, width: u32, height: u32) -> u64 {
        let side = self.variants.tile.size();
        u64::from(width.div_ceil(side)) * u64::from(height.div_ceil(side))
    }

    /// Two buffers, each of at least 48 bytes per splat and at least [`LEAST_2D`] bytes: the projected splats and their
    /// gradients. Free for other use between two steps.
    pub fn idle(&self) -> [&Buffer; 2] {
        [&self.splat2d, &self.early]
    }

    /// Bytes of the renderer's buffers.
    pub fn held(&self) -> MemoryFootprint {
        let backward = self.backward.as_ref();
        // Memory of the lists beyond the gradients is for pairs: the tables of their sort.
        let of_splats = backward.map_or(self.early.size(), |b| b.grad2d.slice().bytes().max(LEAST_2D));
        let slots = backward.map_or(0, |b| b.slot_grads.size() + b.slot_normals.size());
        let of_normals = backward.map_or(0, |b| b.grad_normals.size());
        let own = MemoryFootprint {
            splats: self.splat2d.size() + self.tile_counts.size() + self.normals.size() + of_normals + of_splats,
            pairs: self.early.size() - of_splats,
            slot_pairs: slots,
            fixed: self.counters.size() + self.args.size() + self.pair_counts.size() + self.no_weights.size(),
            ..MemoryFootprint::default()
        };
        own + self.kept.held() + self.lists.held()
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }
}
