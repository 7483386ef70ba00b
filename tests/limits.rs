//! At and beyond limits: models whose parameters do not fit one binding, exhausted buffers and memory, very large
//! images, a single splat.

mod common;

use std::collections::HashMap;

use common::plane_scene;
use common::splats::to_scene;
use psrgs_vk::pass::camera::{NEAR, Projection};
use psrgs_vk::pass::counters;
use psrgs_vk::raster::{
    self, GradientSum, Planes, RenderView, Renderer, Size, Target, TileShape, Variants, Viewer, most_pairs, most_splats,
};
use psrgs_vk::scene::{Camera, Gaussians};
use psrgs_vk::train::{self, Input, Message, Pacing, Settings, State, Trainer};
use psrgs_vk::twin::project::project;
use psrgs_vk::twin::reference;
use psrgs_vk::twin::splat::{Splat, TwinCamera};
use psrgs_vk::vk::{Error, Gpu, Memory};

/// More than 128 MiB of spherical harmonics of degree 3: 48 floats of 4 bytes each.
const MANY: usize = 720_000;

fn settings(steps: u32) -> Settings {
    let mut s = Settings::default();
    s.run.iterations = steps;
    s.run.deterministic = true;
    s.run.eval_every = 0;
    s.model.sh_interval = 1;
    s.density.densify_from = 1;
    s.density.densify_interval = 3;
    s.density.densify_until = steps;
    s.density.opacity_reset_interval = 0;
    s
}

/// Copies splat `from` of one model to splat `to` of another, with its identity.
fn copy(source: &Gaussians, from: usize, target: &mut Gaussians, to: usize) {
    Splat::<f64>::of(source, from).store(target, to);
    target.ids[to] = source.ids[from];
}

#[derive(Debug, Default, PartialEq)]
struct Told {
    losses: Vec<u32>,
    changes: Vec<[u32; 3]>,
}

fn trained(gpu: &Gpu, input: Input, pacing: Pacing) -> (State, Told) {
    let mut trainer = Trainer::new(gpu, input, &settings(4), pacing, None).unwrap();
    let mut told = Told::default();
    while let Some(message) = trainer.next_message().unwrap() {
        match message {
            Message::Step { loss, .. } => told.losses.push(loss.to_bits()),
            Message::Density { cloned, split, pruned, .. } => told.changes.push([cloned, split, pruned]),
            _ => {}
        }
    }
    (trainer.snapshot().unwrap().state, told)
}

/// Most splats lie behind every camera. The rest must train to the bits of a small model of these splats alone, through
/// steps and a density change.
#[test]
fn splats_of_a_model_past_128_mib_train_as_those_of_a_small_one() {
    let Some(gpu) = common::gpu() else { return };
    let small_input = plane_scene::input(3, 48, 40, 180);
    let mut many = Gaussians::zeros(MANY);
    many.means.chunks_exact_mut(3).for_each(|p| p[2] = 100.0);
    many.quats.chunks_exact_mut(4).for_each(|q| q[0] = 1.0);
    many.scales.fill(-3.0);
    let mut few = small_input.initial.clone();
    // Spread over all indices, the last one included.
    for k in 0..few.len() {
        let place = (k + 1) * (MANY / few.len()) - 1;
        few.ids[k] = many.ids[place];
        copy(&few, k, &mut many, place);
    }
    assert_eq!(few.ids.last(), many.ids.last());
    assert!(many.sh.iter().map(|plane| 4 * plane.len() as u64).sum::<u64>() > 128 << 20);

    let (few_state, few_told) = trained(&gpu, Input { initial: few.clone(), ..small_input.clone() }, Pacing::default());
    let pacing = Pacing { splat_capacity: MANY as u32 + 1000, pair_capacity: 1 << 16, ..Pacing::default() };
    let (state, told) = trained(&gpu, Input { initial: many, ..small_input }, pacing);
    assert_eq!(told, few_told);
    assert!(told.changes[0][0] + told.changes[0][1] > 0, "the density change changed nothing: {told:?}");

    let born = few_state.ids.iter().filter(|id| **id as usize >= MANY).count();
    assert!(born > 0 && state.ids.len() == MANY - few.len() + few_state.ids.len());
    let rows: HashMap<u32, usize> = state.ids.iter().enumerate().map(|(row, id)| (*id, row)).collect();
    for (k, id) in few_state.ids.iter().enumerate() {
        let at = rows[id];
        for (name, many, few) in [
            ("parameters", &state.params, &few_state.params),
            ("first moments", &state.moments[0], &few_state.moments[0]),
            ("second moments", &state.moments[1], &few_state.moments[1]),
        ] {
            for (p, (plane, row)) in raster::PLANES.into_iter().enumerate() {
                let row = row as usize;
                let (a, b) = (&many[p][row * at..row * (at + 1)], &few[p][row * k..row * (k + 1)]);
                assert!(
                    a.iter().zip(b).all(|(x, y)| x.to_bits() == y.to_bits()),
                    "splat {id}, {plane} of the {name}: {a:?} instead of {b:?}"
                );
            }
        }
    }
    gpu.check_canaries().unwrap();
    common::assert_no_messages(&gpu);
}

/// All splats are visible in a tiny image: forward, backward, and a handful of splats against the projection's twin.
#[test]
fn a_model_past_128_mib_is_rendered_and_differentiated_whole() {
    let Some(gpu) = common::gpu() else { return };
    let camera = common::splats::camera(64, 48);
    let mut model = Gaussians::zeros(MANY);
    let mut random = common::splats::seeded(4);
    for i in 0..MANY {
        let z = random.range(2.0, 5.0);
        let (u, v) = (random.range(1.0, 63.0), random.range(1.0, 47.0));
        let mean = to_scene(&camera, [(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z]);
        model.means[3 * i..3 * i + 3].copy_from_slice(&mean.map(|x| x as f32));
        model.quats[4 * i] = 1.0;
    }
    model.scales.fill(-5.0);
    // Faint, so that light passes the whole stack, and visible at the nearest pixel centre.
    model.opacities.fill(-4.4);
    model.sh.iter_mut().flatten().for_each(|f| *f = 0.2 * random.symmetric() as f32);
    let projection = Projection { near: NEAR, ..Projection::default() };
    let shot = RenderView { camera, projection, background: [0.5; 3] };
    let variants = Variants::choose(&gpu, true);
    let side = variants.tile.size();
    let tiles = 64u32.div_ceil(side) * 48u32.div_ceil(side);
    let pairs = most_pairs(&gpu, variants).min(4 * MANY as u32);
    let renderer = Renderer::new(&gpu, variants, Size::training(MANY as u32, pairs, tiles)).unwrap();
    let planes = Planes::new(&gpu, "", MANY as u32).unwrap();
    let grads = Planes::new(&gpu, "g_", MANY as u32).unwrap();
    planes.write(&gpu, &model).unwrap();
    let target = Target::new(&gpu, "", 64 * 48, false).unwrap();
    let of_image = gpu.buffer("grad_image", 16 * 64 * 48, Memory::Device).unwrap();
    let mut words = [0u32; counters::COUNT];
    words[counters::SPLATS] = MANY as u32;
    let mut rec = gpu.recorder("many").unwrap();
    rec.upload(&renderer.counters, 0, bytemuck::cast_slice(&words)).unwrap();
    rec.fill(&of_image, 1.0f32.to_bits()).unwrap();
    for buffer in grads.buffers() {
        rec.fill(buffer, f32::NAN.to_bits()).unwrap();
    }
    let lists = renderer.record_forward(&mut rec, &planes, &shot, &target, false).unwrap();
    let gradients = raster::Gradients { model: &planes, of_model: &grads, of_image: (&of_image).into() };
    renderer.record_backward(&mut rec, &lists, &gradients, &shot, &target).unwrap();
    rec.submit().unwrap();

    let counts: Vec<u32> = gpu.read(&renderer.counters).unwrap();
    assert_eq!((counts[counters::STATUS], counts[counters::VISIBLE]), (0, MANY as u32));
    assert!(counts[counters::PAIRS] > MANY as u32);
    let image: Vec<f32> = gpu.read(&target.image).unwrap();
    assert!(image.iter().all(|v| v.is_finite()) && image.chunks(4).all(|p| p[3] < 1.0));
    let view = TwinCamera::<f64>::exact(&camera, &projection);
    let mut moved = 0;
    for i in [0, 1, MANY / 2, 699_049, 699_050, 699_051, 710_000, MANY - 2, MANY - 1] {
        let want = project(&Splat::<f64>::of(&model, i), &view, None).ok().unwrap().row();
        let got: Vec<f32> = gpu.read_at(&renderer.splat2d, 48 * i as u64, 12).unwrap();
        // Without normals there are no slopes of depths.
        assert_eq!(got[11], 0.0);
        for (k, (g, w)) in got.iter().zip(want).enumerate().take(11) {
            assert!((f64::from(*g) - w).abs() < 1e-4 * (1.0 + w.abs()), "splat {i}, column {k}: {g} instead of {w}");
        }
    }
    for (buffer, (_, row)) in grads.buffers().iter().zip(raster::PLANES) {
        // The last rows of each plane: finite, and mostly not zero.
        let rows = 2000 * u64::from(row);
        let tail: Vec<f32> = gpu.read_at(buffer, buffer.size() - 4 * rows, rows as usize).unwrap();
        assert!(tail.iter().all(|v| v.is_finite()), "{buffer:?}");
        moved += tail.iter().filter(|v| **v != 0.0).count();
    }
    assert!(moved > 10_000, "{moved} elements with a gradient");
    gpu.check_canaries().unwrap();
    common::assert_no_messages(&gpu);
}

#[test]
fn a_buffer_past_the_largest_binding_is_named_with_the_limit() {
    let Some(gpu) = common::gpu_with(|o| o.addresses = Some(false)) else { return };
    let limit = gpu.caps().limits.storage_range;
    if limit > 1 << 30 {
        common::left_out(format_args!("one binding of this device holds {limit} bytes"));
        return;
    }
    let variants = Variants::new(Variants::choose(&gpu, true).tile, GradientSum::Slots);
    let pairs = most_pairs(&gpu, variants);
    let record = |pairs: u32| {
        let renderer = Renderer::new(&gpu, variants, Size::training(1, pairs, 4)).unwrap();
        let planes = Planes::new(&gpu, "", 1).unwrap();
        let target = Target::new(&gpu, "", 256, false).unwrap();
        let shot = RenderView {
            camera: common::splats::camera(16, 16),
            projection: Projection::default(),
            background: [0.0; 3],
        };
        let mut rec = gpu.recorder("too large").unwrap();
        let lists = renderer.record_forward(&mut rec, &planes, &shot, &target, false).unwrap();
        let gradients = raster::Gradients { model: &planes, of_model: &planes, of_image: (&target.image).into() };
        renderer.record_backward(&mut rec, &lists, &gradients, &shot, &target)
    };
    record(pairs).unwrap();
    let error = record(pairs + 1).unwrap_err();
    assert!(
        matches!(&error, Error::BindingTooLarge { buffer, bytes, limit: l } if buffer == "slot_grads" && *l == limit && *bytes > limit),
        "{error}"
    );
    assert!(error.to_string().contains(&limit.to_string()) && error.to_string().contains("slot_grads"));
    // The trainer takes no more than fits, or reports what is too much.
    let pacing = Pacing { pair_capacity: u32::MAX, ..Pacing::default() };
    let mut trainer = Trainer::new(&gpu, plane_scene::input(2, 24, 16, 30), &settings(2), pacing, None).unwrap();
    while trainer.next_message().unwrap().is_some() {}
    drop(trainer);
    let most = most_splats(&gpu) as usize;
    let input = Input { initial: Gaussians::zeros(most + 1), ..plane_scene::input(2, 24, 16, 0) };
    let error = Trainer::new(&gpu, input, &settings(2), Pacing::default(), None).err().unwrap();
    assert!(
        matches!(error, train::Error::TooMany { wanted, limit, .. } if wanted == limit + 1 && limit == most as u64),
        "{error}"
    );
}

#[test]
fn memory_that_runs_out_is_an_error_and_the_device_goes_on() {
    let limit = 48 << 20;
    let Some(gpu) = common::gpu_with(|o| o.max_device_memory = Some(limit)) else { return };
    let input = plane_scene::input(3, 48, 40, 300);
    let start = |pacing: Pacing| Trainer::new(&gpu, input.clone(), &settings(8), pacing, None);
    let finish = |mut trainer: Trainer| -> Result<u32, train::Error> {
        while trainer.next_message()?.is_some() {}
        Ok(trainer.snapshot()?.step)
    };
    let check = |error: train::Error| match error {
        train::Error::Device(Error::OutOfDeviceMemory { requested, name, in_use, limit: l }) => {
            assert!(l == limit && !name.is_empty() && in_use <= limit && in_use + requested > limit);
        }
        other => panic!("{other}"),
    };
    let small = Pacing { splat_capacity: 4000, pair_capacity: 100_000, ..Pacing::default() };
    assert_eq!(finish(start(small).unwrap()).unwrap(), 8);
    let in_use = || {
        gpu.wait(gpu.last_ticket()).unwrap();
        gpu.memory_use().current
    };
    for _ in 0..3 {
        // Too large from the start. Capacities beyond the need are reduced instead.
        let large = Input { initial: plane_scene::splats(60_000), ..input.clone() };
        let error = Trainer::new(&gpu, large, &settings(8), small, None).err().unwrap();
        assert!(matches!(error, train::Error::MemoryLimit { wanted: 60_000, .. }), "{error}");
        assert_eq!(finish(start(Pacing { splat_capacity: 100_000, ..small }).unwrap()).unwrap(), 8);
        // Too large after growth: almost no memory is left when the first view needs more pairs than the capacity.
        let trainer = start(Pacing { pair_capacity: 64, ..small }).unwrap();
        let held = gpu.buffer("held", limit - in_use() - (256 << 10), Memory::Device).unwrap();
        check(finish(trainer).expect_err("no room to grow"));
        drop(held);
        // Only staging memory is kept, for the next uploads.
        assert!(in_use() < 12 << 20, "{} bytes were not given back", in_use());
    }
    assert_eq!(finish(start(small).unwrap()).unwrap(), 8);
    gpu.check_canaries().unwrap();
}

/// A camera that sees a part of another's image.
fn crop(camera: &Camera, x: u32, y: u32, width: u32, height: u32) -> Camera {
    Camera { cx: camera.cx - f64::from(x), cy: camera.cy - f64::from(y), width, height, ..*camera }
}

#[test]
fn a_picture_of_3840_by_2160_is_right_in_its_corners() {
    let Some(gpu) = common::gpu() else { return };
    let (width, height) = (3840, 2160);
    let camera = common::splats::camera(width, height);
    // Crops of 40x30 pixels in the first and the last tiles and in the middle, a few splats in each.
    let crops = [(0, 0), (3800, 0), (1904, 1065), (0, 2130), (3800, 2130)];
    let mut random = common::splats::seeded(8);
    let mut model = Gaussians::zeros(6 * crops.len());
    for i in 0..model.len() {
        let (x, y) = crops[i % crops.len()];
        let (u, v) = (f64::from(x) + random.range(8.0, 32.0), f64::from(y) + random.range(8.0, 22.0));
        let z = random.range(2.0, 3.0);
        let mean = to_scene(&camera, [(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z]);
        let splat = Splat {
            mean,
            quat: std::array::from_fn(|_| random.symmetric()),
            log_scale: std::array::from_fn(|_| random.range(-6.5, -6.0)),
            logit: random.range(0.0, 2.0),
            sh: std::array::from_fn(|k| {
                common::splats::vector(&mut random).map(|v| v * if k == 0 { 1.5 } else { 0.2 })
            }),
        };
        splat.store(&mut model, i);
    }
    let background = [0.25f32, 0.5, 0.75];
    let shot = RenderView { camera, projection: Projection { near: NEAR, ..Projection::default() }, background };
    let wanted = reference::Settings {
        sh_degree: 3,
        near: NEAR,
        antialias: false,
        background: background.map(f64::from),
        ..reference::Settings::default()
    };
    let splats = Splat::<f64>::all(&model);
    for tile in [TileShape::Column, TileShape::Pixel] {
        let variants = Variants::new(tile, GradientSum::Slots);
        let mut viewer = Viewer::with_variants(&gpu, variants);
        let planes = viewer.upload(&model).unwrap();
        let picture = viewer.render(&planes, model.len() as u32, &shot, false).unwrap();
        let mut seen = 0;
        for (x, y) in crops {
            let want = reference::render(&splats, &crop(&camera, x, y, 40, 30), &wanted);
            for (i, w) in want.colour.iter().enumerate().filter(|(i, _)| want.margin[*i] > 4e-6) {
                let (px, py) = (x + i as u32 % 40, y + i as u32 / 40);
                let at = 4 * (py * width + px) as usize;
                let error = (0..3).map(|c| (f64::from(picture.rgbt[at + c]) - w[c]).abs()).fold(0.0, f64::max);
                // Means are exact to 2e-4 px at such coordinates, and an edge is some px wide.
                assert!(error < 1e-3, "{tile:?}, pixel ({px}, {py}): off by {error:e}");
                seen += u32::from(want.blended[i] > 0);
            }
        }
        assert!(seen > 500, "{seen} pixels with a splat");
        let empty = 4 * (300 * width + 900) as usize;
        assert_eq!(picture.rgbt[empty..empty + 4], [0.25, 0.5, 0.75, 1.0]);
    }
    gpu.check_canaries().unwrap();
    common::assert_no_messages(&gpu);
}

#[test]
fn one_splat_is_drawn_and_trained() {
    let Some(gpu) = common::gpu() else { return };
    let camera = common::splats::camera(33, 17);
    let mut model = Gaussians::zeros(1);
    common::splats::in_view(&mut common::splats::seeded(2), &camera).store(&mut model, 0);
    let shot =
        RenderView { camera, projection: Projection { near: NEAR, ..Projection::default() }, background: [0.0; 3] };
    let wanted = reference::Settings {
        sh_degree: 3,
        near: NEAR,
        antialias: false,
        background: [0.0; 3],
        ..reference::Settings::default()
    };
    let want = reference::render(&Splat::all(&model), &camera, &wanted);
    let mut viewer = Viewer::new(&gpu);
    let planes = viewer.upload(&model).unwrap();
    let picture = viewer.render(&planes, 1, &shot, false).unwrap();
    for (i, w) in want.colour.iter().enumerate().filter(|(i, _)| want.margin[*i] > 1e-6) {
        let got = &picture.rgbt[4 * i..4 * i + 3];
        assert!(got.iter().zip(w).all(|(g, w)| (f64::from(*g) - w).abs() < 2e-5), "pixel {i}: {got:?} against {w:?}");
    }
    assert!(want.blended.iter().sum::<u32>() > 20);
    let input = Input { initial: plane_scene::splats(1), ..plane_scene::input(3, 33, 17, 0) };
    let (state, told) = trained(&gpu, input, Pacing::default());
    assert!(told.losses.len() == 4 && told.losses.iter().all(|l| f32::from_bits(*l).is_finite()));
    assert!(state.ids.len() <= 2);
    gpu.check_canaries().unwrap();
}
