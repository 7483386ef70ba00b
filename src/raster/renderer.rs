//! Forward and backward of one view, recorded as passes.

mod backward;

pub use backward::{BackwardStep, Gradients, ImageGradients, Terms};

use backward::Backward;

use super::memory_footprint::MemoryFootprint;
use super::pass_select;
use super::planes::Planes;
use super::planes::ShStorage;
use super::scratch_buffers::{Layout, ScratchBuffers};
use super::size::{LEAST_2D, ROW_2D, Size};
use super::sort::Shape;
use super::target::Target;
use super::tiles::{Capacities, Inputs, Lists, SPLAT_ENTRIES, TileLists};
use super::variants::{GradientSum, Variants};
use crate::pass::camera::{CameraPush, Projection, clamp_limits};
use crate::pass::plan::{self, Entry};
use crate::pass::{alpha_min, blend_forward, constrain, counters, project};
use crate::scene::Camera;
use crate::scene::tile::TileGrid;
use crate::vk::{self, Buffer, BufferRange, Gpu, Groups, Memory, Pipeline, Recorder, slices};

/// Entries of `args` that the renderer plans from the number of splats; those of the tile lists follow at once, because
/// their first ones are planned with them.
mod entry {
    /// One thread per splat, 64 in a workgroup.
    pub(super) const SPLATS: u32 = 0;
    /// One thread per float of rows of 3.
    pub(super) const ROWS_3: u32 = 1;
    /// One thread per float of rows of 4.
    pub(super) const ROWS_4: u32 = 2;
    /// One thread per float of rows of 12.
    pub(super) const ROWS_12: u32 = 3;
    /// One workgroup of a pass that does something once per event.
    pub(super) const ONCE: u32 = 4;
    /// First entry of the tile lists.
    pub(super) const TILES: u32 = 5;
}

/// First entry of `args` that belongs to density control.
pub const DENSITY_ENTRY: u32 = 32;

/// Entries in the `args` buffer.
const ENTRIES: u32 = 64;

/// A view to render.
#[derive(Clone, Copy, Debug)]
pub struct Shot {
    /// Camera in scene coordinates.
    pub camera: Camera,
    /// How splats are projected.
    pub projection: Projection,
    /// Colour behind the splats.
    pub background: [f32; 3],
}

impl Shot {
    /// The same of a window of the image: its pixels are the same.
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

/// Pipelines that differ by whether depth and normals are blended too, and by where alphas are cut off.
#[derive(Clone)]
struct Channels {
    project: Pipeline,
    /// Constants of the projection, in whichever form.
    projection: [(&'static str, u32); 4],
    blend: Pipeline,
}

impl Channels {
    /// `cutoff`: see [`alpha_min`].
    fn new(gpu: &Gpu, variants: Variants, cutoff: Option<u32>, aux: bool, count: bool) -> Result<Self, vk::Error> {
        let (side, aux) = (variants.tile.size(), ("AUX", u32::from(aux)));
        let alpha_min = alpha_min::constant(cutoff);
        let projection = [("TILE_W", side), ("TILE_H", side), aux, alpha_min];
        let chosen = pass_select::blend_forward(gpu, variants);
        let mut switches = vec![aux, ("COUNT", u32::from(count)), alpha_min];
        switches.extend(chosen.constants);
        Ok(Self {
            project: gpu.pipeline(&pass_select::projection(gpu).kernel, &projection)?,
            projection,
            blend: gpu.pipeline(&chosen.pass.kernel, &switches)?,
        })
    }
}

/// The passes from a model to an image and back, with the buffers between them.
pub struct Renderer {
    gpu: Gpu,
    variants: Variants,
    /// Counts and status; see [`counters`].
    pub counters: Buffer,
    /// Indirect workgroup numbers.
    pub args: Buffer,
    /// Projected splats, 12 floats each.
    pub splat2d: Buffer,
    /// Tiles touched by each splat; 0 when culled.
    pub tile_counts: Buffer,
    normals: Buffer,
    pair_counts: Buffer,
    /// Stands for the largest weights of splats where these are not asked for.
    no_weights: Buffer,
    lists: TileLists,
    /// See [`Layout`]; the gradients of the projected splats begin it.
    early: Buffer,
    plan: Pipeline,
    colour: Channels,
    all: Channels,
    backward: Option<Backward>,
    splat_capacity: u32,
    pair_capacity: u32,
    with_aux: bool,
    counts: bool,
}

impl Renderer {
    /// Room for `splats` splats, `pairs` (splat, tile) pairs and images of up to `pixels` pixels and `tiles` tiles.
    /// `aux` makes depth and normals available, `train` the backward, both the backward of depth and normals.
    pub fn new(gpu: &Gpu, variants: Variants, size: Size) -> Result<Self, vk::Error> {
        let n = u64::from(size.splats.max(1));
        let channels = |aux: bool| Channels::new(gpu, variants, None, aux, size.count);
        let counters = gpu.buffer("counters", 4 * counters::COUNT as u64, Memory::Device)?;
        let args = gpu.buffer("args", 16 * u64::from(ENTRIES), Memory::Device)?;
        let (splats, pairs, tiles) = (u64::from(size.splats), u64::from(size.pairs), u64::from(size.tiles));
        let capacities = Capacities { splats, pairs, tiles };
        let shape = Shape::of(gpu.caps(), pairs);
        let slots = size.train && variants.gradients == GradientSum::Slots;
        let for_lists = Layout::new(gpu, &capacities, shape).bytes();
        let early = if size.train {
            gpu.buffer("grad2d", for_lists.max(ROW_2D * n).max(LEAST_2D), Memory::Device)?
        } else {
            gpu.buffer("lists", for_lists, Memory::Device)?
        };
        let backward = if size.train {
            Some(Backward::new(gpu, variants, &size, BufferRange::of(&early, 0..ROW_2D * n))?)
        } else {
            None
        };
        // Splats of slots are dead when gradients come to the slots.
        let slot_splat =
            backward.as_ref().filter(|_| slots).map(|b| BufferRange::of(&b.slot_grads, 0..4 * pairs.max(1)));
        let lists =
            TileLists::within(gpu, capacities, shape, ScratchBuffers { early: &early, slot_splat }, size.listed)?;
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
            backward,
            splat_capacity: size.splats,
            pair_capacity: size.pairs,
            with_aux: size.aux,
            counts: size.count,
        })
    }

    /// Sorts by so many of the highest bits of a depth: see [`TileLists::sort_depths_by`].
    pub fn sort_depths_by(&mut self, bits: u32) {
        self.lists.sort_depths_by(bits);
    }

    /// The variant set in use.
    pub fn variants(&self) -> Variants {
        self.variants
    }

    /// Splats that fit.
    pub fn splat_capacity(&self) -> u32 {
        self.splat_capacity
    }

    /// Pairs that fit.
    pub fn pair_capacity(&self) -> u32 {
        self.pair_capacity
    }

    /// Evaluated and blended pixel-splats, forward then backward, since the last clearing; zeros unless counting is on.
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

    /// One workgroup, or none when the event is lost.
    pub fn once(&self) -> Groups<'_> {
        Groups::Indirect(&self.args, Entry::offset(entry::ONCE))
    }

    /// Plans the dispatches that depend on the number of splats alone.
    fn record_plan(&self, recorder: &mut Recorder) -> Result<(), vk::Error> {
        let rows = |floats: u32| Entry { divide: 1, multiply: floats, items: 64 };
        let [scan, items, once] = SPLAT_ENTRIES;
        let entries = [Entry::items(64), rows(3), rows(4), rows(12), Entry::fixed(1), scan, items, once];
        let push = plan::Push::unlimited(counters::SPLATS as u32, entry::SPLATS, &entries)
            .limited(self.splat_capacity, counters::SPLATS_BIT, plan::NO_COUNTER)
            .voiding(ENTRIES);
        recorder.dispatch(&self.plan, &[&self.counters, &self.args], &push, Groups::Workgroups(1))
    }

    /// Renders `model` into `target`. `aux` blends depth and normals too (the renderer and the target must have them).
    pub fn record_forward(
        &self,
        recorder: &mut Recorder,
        model: &Planes,
        shot: &Shot,
        target: &Target,
        aux: bool,
    ) -> Result<Lists<'_>, vk::Error> {
        self.record_forward_of(recorder, model, shot, target, aux, None)
    }

    /// Renders `model` into `target`, and raises `weights` (a float for each splat) to the largest weight, alpha times
    /// transmittance, that a splat has in any pixel.
    pub fn record_weights(
        &self,
        recorder: &mut Recorder,
        model: &Planes,
        shot: &Shot,
        target: &Target,
        weights: &Buffer,
    ) -> Result<(), vk::Error> {
        let chosen = pass_select::blend_forward(&self.gpu, self.variants);
        let mut switches = vec![("AUX", 0), ("WEIGHTS", 1), alpha_min::constant(shot.projection.alpha_cutoff)];
        switches.extend(chosen.constants);
        let blend = self.gpu.pipeline(&chosen.pass.kernel, &switches)?;
        let channels = self.channels(shot, false)?;
        self.record_lists(recorder, model, shot, &channels, None)
            .and_then(|lists| self.record_blend(recorder, &blend, &lists, shot, target, weights))
    }

    /// The same of the constrained set alone, where the model's identities are given: of those below the bound that
    /// stands in [`counters::CONSTRAINED`].
    pub fn record_forward_of(
        &self,
        recorder: &mut Recorder,
        model: &Planes,
        shot: &Shot,
        target: &Target,
        aux: bool,
        constrained: Option<&Buffer>,
    ) -> Result<Lists<'_>, vk::Error> {
        let channels = self.channels(shot, aux)?;
        let lists = self.record_lists(recorder, model, shot, &channels, constrained)?;
        self.record_blend(recorder, &channels.blend, &lists, shot, target, &self.no_weights)?;
        Ok(lists)
    }

    fn channels(&self, shot: &Shot, aux: bool) -> Result<Channels, vk::Error> {
        let aux = aux && self.with_aux;
        match shot.projection.alpha_cutoff {
            cutoff @ Some(_) => Channels::new(&self.gpu, self.variants, cutoff, aux, self.counts),
            None => Ok(if aux { &self.all } else { &self.colour }.clone()),
        }
    }

    /// Projects `model` and lists its splats by tile.
    fn record_lists(
        &self,
        recorder: &mut Recorder,
        model: &Planes,
        shot: &Shot,
        channels: &Channels,
        constrained: Option<&Buffer>,
    ) -> Result<Lists<'_>, vk::Error> {
        let (width, height) = (shot.camera.width, shot.camera.height);
        self.record_plan(recorder)?;
        let push = CameraPush::new(&shot.camera, &shot.projection);
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
        if let Some(ids) = constrained {
            let constrain = self.gpu.pipeline(&constrain::PASS.kernel, &[])?;
            recorder.dispatch(&constrain, &[&self.counters, ids, &self.tile_counts], &(), self.per_splat())?;
        }

        let side = self.variants.tile.size();
        let inputs = Inputs {
            splat2d: &self.splat2d,
            tile_counts: &self.tile_counts,
            counters: &self.counters,
            args: &self.args,
            first_entry: entry::TILES,
            entries: ENTRIES,
            alpha_cutoff: shot.projection.alpha_cutoff,
        };
        self.lists.record(recorder, inputs, &TileGrid::new([width, height], [side, side]))
    }

    fn record_blend(
        &self,
        recorder: &mut Recorder,
        blend: &Pipeline,
        lists: &Lists<'_>,
        shot: &Shot,
        target: &Target,
        weights: &Buffer,
    ) -> Result<(), vk::Error> {
        let (width, height) = (shot.camera.width, shot.camera.height);
        let [splat2d, normals, image, aux, last, counted, weights] = slices([
            &self.splat2d,
            &self.normals,
            &target.image,
            &target.aux,
            &target.last,
            &self.pair_counts,
            weights,
        ]);
        let buffers = [splat2d, normals, lists.sorted_splats, lists.tile_ranges, image, aux, last, counted, weights];
        recorder.dispatch(blend, &buffers, &shot.blend_push(), Groups::Workgroups(self.tiles(width, height)))
    }

    fn tiles(&self, width: u32, height: u32) -> u64 {
        let side = self.variants.tile.size();
        u64::from(width.div_ceil(side)) * u64::from(height.div_ceil(side))
    }

    /// Two buffers of at least 48 bytes per splat and [`LEAST_2D`] bytes: the projected splats and their gradients.
    /// Between two steps nobody reads them.
    pub fn idle(&self) -> [&Buffer; 2] {
        [&self.splat2d, &self.early]
    }

    /// Bytes of its buffers.
    pub fn held(&self) -> MemoryFootprint {
        let backward = self.backward.as_ref();
        // What the lists need beyond the gradients is there for pairs: the tables of their sort.
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
        own + self.lists.held()
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }
}
