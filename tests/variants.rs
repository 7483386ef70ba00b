//! One training under every variant of the passes (tile shapes, sums of gradients, emulated subgroups of every width):
//! losses are alike, and integers are equal.

mod common;

use common::plane_scene;
use common::splats::{camera, seeded, spread};
use psrgs_vk::pass::camera::Projection;
use psrgs_vk::pass::counters;
use psrgs_vk::raster::{
    Chunks, GradientSum, ListSort, NamedVariants, Planes, RenderView, Renderer, Size, Target, TileShape, Variants,
};
use psrgs_vk::scene::Gaussians;
use psrgs_vk::train::{self, Input, Message, Pacing, Settings, Trainer};
use psrgs_vk::vk::{self, DeviceKind, FloatAtomics, Gpu};

const STEPS: u32 = 8;
const SHAPES: [TileShape; 2] = [TileShape::Column, TileShape::Pixel];

fn settings(variants: Variants) -> Settings {
    let mut s = Settings::default();
    s.run.iterations = STEPS;
    s.run.eval_every = 0;
    s.model.sh_interval = 2;
    s.model.antialias = true;
    // Few steps need large rates to show an effect.
    s.optimiser.lr_sh_base = 0.02;
    s.optimiser.lr_opacities = 0.1;
    s.name_variants(variants);
    s
}

fn losses(gpu: &Gpu, input: &Input, variants: Variants) -> Vec<f32> {
    let mut trainer =
        Trainer::new(gpu, Input { held_out: vec![], ..input.clone() }, &settings(variants), Pacing::default(), None)
            .unwrap();
    let mut losses = Vec::new();
    while let Some(message) = trainer.next_message().unwrap() {
        if let Message::Step { loss, .. } = message {
            losses.push(loss);
        }
    }
    assert_eq!(trainer.snapshot().unwrap().variants, variants, "another variant ran than was asked for");
    gpu.check_canaries().unwrap();
    common::assert_no_messages(gpu);
    losses
}

/// The losses of a few steps keep the bound of gradients, 1e-3. The first step's image is equal up to rounding.
fn check(what: &str, got: &[f32], want: &[f32]) {
    assert_eq!(got.len(), STEPS as usize, "{what}");
    for (k, (g, w)) in got.iter().zip(want).enumerate() {
        let bound = if k == 0 { 1e-5 } else { 1e-3 };
        assert!((g - w).abs() < bound * w, "{what}: loss {g} instead of {w} at step {}", k + 1);
    }
}

#[test]
fn every_form_learns_alike() {
    let Some(native) = common::gpu() else { return };
    let input = plane_scene::input(4, 48, 40, 150);
    let want = losses(&native, &input, Variants::choose(&native, true));
    let epoch = |losses: &[f32]| losses.iter().sum::<f32>();
    assert!(epoch(&want[4..]) < 0.97 * epoch(&want[..4]), "nothing is learnt: {want:?}");
    let mut devices = vec![("native".to_owned(), native)];
    devices.push((
        "compare-and-swap".into(),
        common::gpu_with(|o| o.float_atomics = Some(FloatAtomics::CompareAndSwap)).unwrap(),
    ));
    for width in [32, 64] {
        let gpu = common::gpu_with(|o| o.emulate_subgroup = Some(width)).unwrap();
        devices.push((format!("subgroups of {width} emulated"), gpu));
    }
    let mut ran = 0;
    for (name, gpu) in &devices {
        for variants in Variants::possible(gpu) {
            check(&format!("{name}, {variants:?}"), &losses(gpu, &input, variants), &want);
            ran += 1;
        }
    }
    assert!(ran >= 3 + 3 + 3 + 3, "only {ran} forms ran");
}

#[test]
fn forms_that_the_device_cannot_run_are_refused() {
    let Some(gpu) = common::gpu_with(|o| {
        o.float_atomics = Some(FloatAtomics::CompareAndSwap);
        o.emulate_subgroup = Some(32);
    }) else {
        return;
    };
    let start = |tile, gradients| {
        let input = plane_scene::input(2, 24, 16, 20);
        Trainer::new(&gpu, input, &settings(Variants::new(tile, gradients)), Pacing::default(), None).err()
    };
    assert!(matches!(start(TileShape::Pixel, GradientSum::Atomic), Some(train::Error::NoFloatAtomics)));
    assert!(matches!(
        start(TileShape::Column, GradientSum::CompareAndSwap),
        Some(train::Error::Device(vk::Error::MissingFeature { .. }))
    ));
    assert!(start(TileShape::Column, GradientSum::Slots).is_none());
    // The default variants are always possible.
    for deterministic in [false, true] {
        let mut s = settings(Variants::choose(&gpu, deterministic));
        s.run.deterministic = deterministic;
        assert!(Trainer::new(&gpu, plane_scene::input(2, 24, 16, 20), &s, Pacing::default(), None).is_ok());
        Renderer::new(&gpu, Variants::choose(&gpu, deterministic).without_slots(&gpu), Size::training(10, 10, 10))
            .unwrap();
    }
}

/// Vulkan's minimum of shared memory is 16 KiB.
#[test]
fn forms_with_too_much_shared_memory_are_not_chosen() {
    let Some(gpu) = common::gpu_with(|o| o.max_shared_bytes = Some(16 << 10)) else { return };
    assert_eq!(gpu.caps().limits.shared_bytes, 16 << 10);
    let possible = Variants::possible(&gpu);
    let start = |variants: Variants| {
        let input = plane_scene::input(2, 24, 16, 20);
        Trainer::new(&gpu, input, &settings(variants), Pacing::default(), None).err()
    };
    let large = Variants::new(TileShape::Pixel, GradientSum::Slots);
    assert!(!possible.contains(&large) && !large.runs_on(&gpu));
    let refused = start(large).expect("a form that does not fit");
    assert!(matches!(refused, train::Error::SharedMemory { most: 16_384, .. }), "{refused}");
    let made = Renderer::new(&gpu, large, Size::training(10, 10, 10)).err().map(|error| error.to_string());
    assert!(made.as_ref().is_some_and(|text| text.contains("bytes of shared memory")), "{made:?}");
    for variants in possible {
        assert!(start(variants).is_none(), "{variants}");
    }
    // A device with less shared memory than any variant of pixel tiles or the sort needs.
    let little = common::gpu_with(|o| {
        o.max_shared_bytes = Some(4 << 10);
        o.emulate_subgroup = Some(32);
    })
    .unwrap();
    for deterministic in [false, true] {
        let chosen = Variants::choose(&little, deterministic);
        assert_eq!(chosen, Variants::new(TileShape::Column, GradientSum::Slots));
        Renderer::new(&little, chosen, Size::training(10, 10, 10)).unwrap();
    }
}

#[test]
fn what_is_possible_can_be_made_and_nothing_else() {
    let Some(native) = common::gpu() else { return };
    let emulated = common::gpu_with(|o| o.emulate_subgroup = Some(32)).unwrap();
    for gpu in [&native, &emulated] {
        let possible = Variants::possible(gpu);
        for deterministic in [false, true] {
            assert!(possible.contains(&Variants::choose(gpu, deterministic)));
        }
        for tile in SHAPES {
            for gradients in [GradientSum::Slots, GradientSum::CompareAndSwap, GradientSum::Atomic] {
                let variants = Variants::new(tile, gradients);
                let made = Renderer::new(gpu, variants, Size::training(10, 10, 10));
                assert_eq!(made.is_ok(), possible.contains(&variants), "{variants:?}");
            }
        }
    }
}

#[test]
fn parts_that_are_not_named_suit_the_device() {
    let Some(gpu) = common::gpu() else { return };
    let usual = if gpu.caps().kind == DeviceKind::Cpu { ListSort::Global } else { ListSort::Tiles };
    let of = |named| {
        let variants = Variants::choose(&gpu, true).with(&gpu, named);
        assert!(variants.runs_on(&gpu), "{variants}");
        (variants.lists, variants.chunks)
    };
    let pixel = NamedVariants { tile: Some(TileShape::Pixel), ..NamedVariants::default() };
    assert_eq!(of(pixel), (usual, Chunks::ByNeed));
    assert_eq!(of(NamedVariants { tile: Some(TileShape::Column), ..pixel }), (ListSort::Global, Chunks::Whole));
    assert_eq!(of(NamedVariants { lists: Some(ListSort::Tiles), ..pixel }), (ListSort::Tiles, Chunks::ByNeed));
    assert_eq!(of(NamedVariants { chunks: Some(Chunks::Whole), ..pixel }), (usual, Chunks::Whole));
}

/// Counts, and the used part of every array of the tile lists.
fn lists(gpu: &Gpu, variants: Variants, model: &Gaussians, shot: &RenderView) -> Vec<Vec<u32>> {
    let n = model.len() as u32;
    let side = variants.tile.size();
    let (width, height) = (shot.camera.width, shot.camera.height);
    let tiles = width.div_ceil(side) * height.div_ceil(side);
    let renderer = Renderer::new(gpu, variants, Size::training(n, 60_000, tiles)).unwrap();
    let planes = Planes::new(gpu, "", n).unwrap();
    planes.write(gpu, model).unwrap();
    let target = Target::new(gpu, "", width * height, false).unwrap();
    let mut words = [0u32; counters::COUNT];
    words[counters::SPLATS] = n;
    let mut rec = gpu.recorder("lists").unwrap();
    rec.upload(&renderer.counters, 0, bytemuck::cast_slice(&words)).unwrap();
    let lists = renderer.record_forward(&mut rec, &planes, shot, &target, false).unwrap();
    rec.submit().unwrap();
    let counts: Vec<u32> = gpu.read(&renderer.counters).unwrap();
    assert_eq!(counts[counters::STATUS], 0);
    let (visible, pairs) = (counts[counters::VISIBLE] as usize, counts[counters::PAIRS] as usize);
    assert!(visible > 500 && pairs > 2 * visible, "{visible} visible, {pairs} pairs");
    let read = |slice, words| gpu.read_slice::<u32>(slice, words).unwrap();
    let mut all = vec![
        vec![visible as u32, pairs as u32],
        read((&renderer.tile_counts).into(), n as usize),
        read(lists.sorted_splats, pairs),
        read(lists.tile_ranges, 2 * tiles as usize),
    ];
    // Slots exist exactly where gradients are summed in slots.
    assert_eq!(lists.slots.is_some(), variants.gradients == GradientSum::Slots);
    if let Some(slots) = lists.slots {
        all.push(read(slots.listed, visible));
        all.push(read(slots.slot_offsets, n as usize));
        all.push(read(slots.slot_splat, pairs));
        all.push(read(slots.sorted_slots, pairs));
    }
    all
}

#[test]
fn tile_lists_are_the_same_bits_in_every_form() {
    let Some(native) = common::gpu() else { return };
    let camera = camera(150, 110);
    let mut random = seeded(9);
    let mut model = Gaussians::zeros(1500);
    (0..model.len()).for_each(|i| spread(&mut random, &camera, 1.4).store(&mut model, i));
    let shot = RenderView { camera, projection: Projection::default(), background: [0.0; 3] };
    let emulated = [8, 16, 32, 64].map(|width| common::gpu_with(|o| o.emulate_subgroup = Some(width)).unwrap());
    for tile in SHAPES {
        let want = lists(&native, Variants::new(tile, GradientSum::Slots), &model, &shot);
        for gpu in std::iter::once(&native).chain(&emulated) {
            for variants in Variants::possible(gpu).into_iter().filter(|v| v.tile == tile) {
                let got = lists(gpu, variants, &model, &shot);
                for (k, (g, w)) in got.iter().zip(&want).enumerate() {
                    assert!(g == w, "{variants:?}, {:?}: array {k} differs", gpu.caps().subgroup);
                }
            }
        }
    }
}
