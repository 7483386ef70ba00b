//! Forward and backward of one view, recorded as passes.

use super::held::Held;
use super::kernels;
use super::loan::{Layout, Loan};
use super::planes::Planes;
use super::sort::Shape;
use super::target::Target;
use super::tiles::{Capacities, Inputs, Lists, SPLAT_ENTRIES, TileLists};
use super::variants::{GradientSum, Variants};
use crate::pass::camera::{CameraPush, Projection};
use crate::pass::plan::{self, Entry};
use crate::pass::{adam, blend_forward, counters, project, project_backward, project_backward_adam, slot_sum};
use crate::scene::Camera;
use crate::twin::tile::TileGrid;
use crate::vk::{self, Buffer, BufferSlice, Gpu, Groups, Memory, Part, Pipeline, Recorder, slices};

/// Entries of `args` that the renderer plans from the number of splats; those of the tile lists follow at once, because their
/// first ones are planned with them.
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
    fn blend_push(&self) -> blend_forward::Push {
        let [red, green, blue] = self.background;
        blend_forward::Push { width: self.camera.width, height: self.camera.height, red, green, blue }
    }
}

/// Whose gradients a backward pass computes, from what, and where they go.
#[derive(Clone, Copy)]
pub struct Gradients<'a> {
    /// The model that was rendered.
    pub model: &'a Planes,
    /// dL/d(image), a vec4 per pixel.
    pub of_image: &'a Buffer,
    /// dL/d(model), written.
    pub of_model: &'a Planes,
}

/// An optimiser step that takes the place of gradients: see [`Renderer::record_backward_step`].
#[derive(Clone, Copy)]
pub struct BackwardStep<'a> {
    /// The model that was rendered, and changes.
    pub model: &'a Planes,
    /// The first and second moments, or both in one, which change with it.
    pub moments: &'a [Planes],
    /// The pipeline of [`project_backward_adam`], or of its form for packed moments, with the optimiser's constants.
    pub pipeline: &'a Pipeline,
    /// The optimiser's settings.
    pub settings: &'a adam::Settings,
    /// Learning rates.
    pub rates: &'a project_backward_adam::Rates,
    /// How many steps have been taken.
    pub steps: project_backward_adam::Steps,
}

/// Pipelines that differ by whether depth and normals are blended too.
struct Channels {
    project: Pipeline,
    blend: Pipeline,
}

/// Pipelines and buffers of the backward.
struct Backward {
    blend: Pipeline,
    slot_sum: Option<Pipeline>,
    project: Pipeline,
    slot_grads: Buffer,
    unused_normals: Buffer,
    /// Beginning of the buffer that the tile lists use before.
    grad2d: Part,
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
    lists: TileLists,
    /// See [`Layout`]; the gradients of the projected splats begin it.
    early: Buffer,
    plan: Pipeline,
    color: Channels,
    all: Channels,
    backward: Option<Backward>,
    splat_capacity: u32,
    pair_capacity: u32,
    with_aux: bool,
}

impl Renderer {
    /// Room for `splats` splats, `pairs` (splat, tile) pairs and images of up to `pixels` pixels and `tiles` tiles.
    /// `aux` makes depth and normals available, `train` the backward.
    pub fn new(gpu: &Gpu, variants: Variants, size: Size) -> Result<Self, vk::Error> {
        let n = u64::from(size.splats.max(1));
        let side = variants.tile.size();
        let channels = |aux: u32| -> Result<Channels, vk::Error> {
            let constants = [("TILE_W", side), ("TILE_H", side), ("AUX", aux)];
            let chosen = kernels::blend_forward(gpu, variants);
            let mut switches = vec![("AUX", aux), ("COUNT", u32::from(size.count))];
            switches.extend(chosen.constants);
            Ok(Channels {
                project: gpu.pipeline(&project::PASS.kernel, &constants)?,
                blend: gpu.pipeline(&chosen.pass.kernel, &switches)?,
            })
        };
        let counters = gpu.buffer("counters", 4 * counters::COUNT as u64, Memory::Device)?;
        let args = gpu.buffer("args", 16 * u64::from(ENTRIES), Memory::Device)?;
        let (splats, pairs, tiles) = (u64::from(size.splats), u64::from(size.pairs), u64::from(size.tiles));
        let capacities = Capacities { splats, pairs, tiles };
        let shape = Shape::of(gpu.caps());
        let slots = size.train && variants.gradients == GradientSum::Slots;
        let for_lists = Layout::new(gpu, &capacities, shape, slots).bytes();
        let early = if size.train {
            gpu.buffer("grad2d", for_lists.max(ROW_2D * n).max(LEAST_2D), Memory::Device)?
        } else {
            gpu.buffer("lists", for_lists, Memory::Device)?
        };
        let backward =
            if size.train { Some(Backward::new(gpu, variants, &size, Part::of(&early, 0..ROW_2D * n))?) } else { None };
        // Splats of slots are dead when gradients come to the slots.
        let slot_splat = backward.as_ref().filter(|_| slots).map(|b| Part::of(&b.slot_grads, 0..4 * pairs.max(1)));
        let lists = TileLists::within(gpu, capacities, shape, Loan { early: &early, slot_splat })?;
        Ok(Self {
            gpu: gpu.clone(),
            variants,
            counters,
            args,
            splat2d: gpu.buffer("splat2d", (ROW_2D * n).max(LEAST_2D), Memory::Device)?,
            tile_counts: gpu.buffer("tile_counts", 4 * n, Memory::Device)?,
            normals: gpu.buffer("normals", if size.aux { 16 * n } else { 16 }, Memory::Device)?,
            pair_counts: gpu.buffer("pair_counts", 16, Memory::Device)?,
            lists,
            early,
            plan: gpu.pipeline(&plan::PASS.kernel, &[])?,
            color: channels(0)?,
            all: channels(u32::from(size.aux))?,
            backward,
            splat_capacity: size.splats,
            pair_capacity: size.pairs,
            with_aux: size.aux,
        })
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
        let channels = if aux && self.with_aux { &self.all } else { &self.color };
        let (width, height) = (shot.camera.width, shot.camera.height);
        self.record_plan(recorder)?;
        let push = CameraPush::new(&shot.camera, &shot.projection);
        let mut buffers = vec![&self.counters];
        buffers.extend(model.buffers());
        buffers.extend([&self.splat2d, &self.tile_counts, &self.normals]);
        recorder.dispatch(&channels.project, &buffers, &push, self.per_splat())?;

        let side = self.variants.tile.size();
        let inputs = Inputs {
            splat2d: &self.splat2d,
            tile_counts: &self.tile_counts,
            counters: &self.counters,
            args: &self.args,
            first_entry: entry::TILES,
            entries: ENTRIES,
        };
        let lists = self.lists.record(recorder, inputs, &TileGrid { image: [width, height], tile: [side, side] })?;

        let push = shot.blend_push();
        let [splat2d, normals, image, aux, last, counted] =
            slices([&self.splat2d, &self.normals, &target.image, &target.aux, &target.last, &self.pair_counts]);
        let buffers = [splat2d, normals, lists.sorted_splats, lists.tile_ranges, image, aux, last, counted];
        recorder.dispatch(&channels.blend, &buffers, &push, Groups::Workgroups(self.tiles(width, height)))?;
        Ok(lists)
    }

    fn tiles(&self, width: u32, height: u32) -> u64 {
        let side = self.variants.tile.size();
        u64::from(width.div_ceil(side)) * u64::from(height.div_ceil(side))
    }

    /// Gradients of a model from those of its image, after [`Self::record_forward`] of the same shot. Does nothing without a
    /// backward.
    pub fn record_backward(
        &self,
        recorder: &mut Recorder,
        lists: &Lists<'_>,
        gradients: &Gradients<'_>,
        shot: &Shot,
        target: &Target,
    ) -> Result<(), vk::Error> {
        self.record_blend_backward(recorder, lists, gradients.of_image, shot, target)?;
        self.record_project_backward(recorder, gradients.model, gradients.of_model, shot)
    }

    /// Gradients of `model`, written to `of_model`, after [`Self::record_blend_backward`] of the same shot. Does nothing without
    /// a backward.
    pub fn record_project_backward(
        &self,
        recorder: &mut Recorder,
        model: &Planes,
        of_model: &Planes,
        shot: &Shot,
    ) -> Result<(), vk::Error> {
        let Some(backward) = &self.backward else { return Ok(()) };
        let push = CameraPush::new(&shot.camera, &shot.projection);
        let [counts, splat2d, tile_counts, unused] =
            slices([&self.counters, &self.splat2d, &self.tile_counts, &backward.unused_normals]);
        let mut buffers = vec![counts];
        buffers.extend(model.buffers().iter().map(BufferSlice::from));
        buffers.extend([splat2d, tile_counts, backward.grad2d.slice(), unused]);
        buffers.extend(of_model.buffers().iter().map(BufferSlice::from));
        recorder.dispatch(&backward.project, &buffers, &push, self.per_splat())
    }

    /// One optimiser step, after [`Self::record_blend_backward`] of the same shot: what gradients of the model and the optimiser
    /// would do, without gradients in memory. Does nothing without a backward.
    pub fn record_backward_step(
        &self,
        recorder: &mut Recorder,
        step: &BackwardStep<'_>,
        shot: &Shot,
    ) -> Result<(), vk::Error> {
        let Some(backward) = &self.backward else { return Ok(()) };
        let camera = CameraPush::new(&shot.camera, &shot.projection);
        let push = project_backward_adam::Push::new(&camera, step.settings, step.rates, step.steps);
        let [counts, splat2d, tile_counts, unused] =
            slices([&self.counters, &self.splat2d, &self.tile_counts, &backward.unused_normals]);
        let mut buffers = vec![counts, splat2d, tile_counts, backward.grad2d.slice(), unused];
        for planes in std::iter::once(step.model).chain(step.moments) {
            buffers.extend(planes.buffers().iter().map(BufferSlice::from));
        }
        recorder.dispatch(step.pipeline, &buffers, &push, self.per_splat())
    }

    /// Gradients of the projected splats ([`Self::grad2d`]) from those of the image, after [`Self::record_forward`] of the same
    /// shot. Does nothing without a backward.
    pub fn record_blend_backward(
        &self,
        recorder: &mut Recorder,
        lists: &Lists<'_>,
        of_image: &Buffer,
        shot: &Shot,
        target: &Target,
    ) -> Result<(), vk::Error> {
        let Some(backward) = &self.backward else { return Ok(()) };
        let (width, height) = (shot.camera.width, shot.camera.height);
        let push = shot.blend_push();
        let [splat2d, normals, image, last, of_image] =
            slices([&self.splat2d, &self.normals, &target.image, &target.last, of_image]);
        let [unused, slot_grads, counted] = slices([&backward.unused_normals, &backward.slot_grads, &self.pair_counts]);
        let grad2d = backward.grad2d.slice();
        // Without the auxiliary channels these stand for what is not read; another buffer stands for what is not written.
        let unread = normals;
        let mut buffers = vec![splat2d, normals, lists.sorted_splats, lists.tile_ranges, image, last, of_image, unread];
        let groups = Groups::Workgroups(self.tiles(width, height));
        if let (Some(slot_sum), Some(slots)) = (&backward.slot_sum, &lists.slots) {
            buffers.extend([slots.sorted_slots, slot_grads, unused, counted]);
            recorder.dispatch(&backward.blend, &buffers, &push, groups)?;
            let [counts, tile_counts] = slices([&self.counters, &self.tile_counts]);
            let buffers = [counts, slots.order, slots.pair_offsets, tile_counts, slot_grads, unread, grad2d, unused];
            recorder.dispatch(slot_sum, &buffers, &(), lists.slot_sums)
        } else {
            recorder.fill(grad2d, 0)?;
            buffers.extend([grad2d, unused, counted]);
            recorder.dispatch(&backward.blend, &buffers, &push, groups)
        }
    }

    /// Gradients of the projected splats; `None` without a backward.
    pub fn grad2d(&self) -> Option<BufferSlice<'_>> {
        self.backward.as_ref().map(|b| b.grad2d.slice())
    }

    /// Two buffers of at least 48 bytes per splat and [`LEAST_2D`] bytes: the projected splats and their gradients. Between two
    /// steps nobody reads them.
    pub fn idle(&self) -> [&Buffer; 2] {
        [&self.splat2d, &self.early]
    }

    /// Bytes of its buffers.
    pub fn held(&self) -> Held {
        let backward = self.backward.as_ref();
        // What the lists need beyond the gradients is there for pairs: the tables of their sort.
        let of_splats = backward.map_or(self.early.size(), |b| b.grad2d.slice().bytes().max(LEAST_2D));
        let slots = backward.map_or(0, |b| b.slot_grads.size() + b.unused_normals.size());
        let own = Held {
            splats: self.splat2d.size() + self.tile_counts.size() + self.normals.size() + of_splats,
            pairs: self.early.size() - of_splats,
            slot_pairs: slots,
            fixed: self.counters.size() + self.args.size() + self.pair_counts.size(),
            ..Held::default()
        };
        own + self.lists.held()
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }
}

/// Most splats that fit the buffers of the device, each plane being used whole.
pub fn most_splats(gpu: &Gpu) -> u32 {
    most(gpu, LARGEST_ROW)
}

/// Most pairs that fit the buffers of the device: slots are rows of 12 floats per pair, all else is no more than a word.
pub fn most_pairs(gpu: &Gpu, variants: Variants) -> u32 {
    let row = if variants.gradients == GradientSum::Slots { LARGEST_ROW } else { 4 };
    most(gpu, row)
}

/// Rows of `bytes` bytes in the largest buffer that a kernel can use. Words are indexed with 32 bits, of which SPIR-V lets a
/// driver take the highest as a sign.
fn most(gpu: &Gpu, bytes: u64) -> u32 {
    let words = (gpu.caps().largest_buffer() / 4).min(i32::MAX as u64);
    (words / (bytes / 4)) as u32
}

/// Bytes of the largest row of a plane or of the gradients.
pub(crate) const LARGEST_ROW: u64 = 48;
/// Bytes of a row of the projected splats and of their gradients.
const ROW_2D: u64 = 48;
/// Least bytes of those buffers, so that others can lay out parts in them when there are few splats.
pub const LEAST_2D: u64 = 8192;

/// How large a renderer is.
#[derive(Clone, Copy, Debug)]
pub struct Size {
    /// Splats that fit.
    pub splats: u32,
    /// (splat, tile) pairs that fit.
    pub pairs: u32,
    /// Tiles of the largest image.
    pub tiles: u32,
    /// Whether depth and normals can be rendered.
    pub aux: bool,
    /// Whether there is a backward.
    pub train: bool,
    /// Whether evaluated and blended pixel-splats are counted (slower; for benchmarks).
    pub count: bool,
    /// Whether gradients pass through the clamp of alpha at 0.99, as in the 3DGS reference.
    pub clamp_gradient_passes: bool,
}

impl Backward {
    fn new(gpu: &Gpu, variants: Variants, size: &Size, grad2d: Part) -> Result<Self, vk::Error> {
        let chosen = kernels::blend_backward(gpu, variants)?;
        let slots = variants.gradients == GradientSum::Slots;
        let mut switches =
            vec![("COUNT", u32::from(size.count)), ("CLAMP_GRADIENT_PASSES", u32::from(size.clamp_gradient_passes))];
        switches.extend(chosen.constants);
        Ok(Self {
            blend: gpu.pipeline(&chosen.pass.kernel, &switches)?,
            slot_sum: if slots { Some(gpu.pipeline(&slot_sum::PASS.kernel, &[])?) } else { None },
            project: gpu.pipeline(&project_backward::PASS.kernel, &[])?,
            slot_grads: gpu.buffer(
                "slot_grads",
                if slots { 48 * u64::from(size.pairs) } else { 16 },
                Memory::Device,
            )?,
            unused_normals: gpu.buffer("unused_normals", 16, Memory::Device)?,
            grad2d,
        })
    }
}
