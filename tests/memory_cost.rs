//! Device memory of a training, from real allocations.

mod common;

use common::plane_scene;
use psrgs_vk::pass::counters;
use psrgs_vk::raster::{Chunks, GradientSum, ListSort, TileShape, Variants};
use psrgs_vk::train::schedule::DensityChange;
use psrgs_vk::train::settings::Shortcuts;
use psrgs_vk::train::{Engine, Event, Input, Kind, MemoryCost, Pacing, Schedule, Settings, StepPlan};
use psrgs_vk::vk::Gpu;

const SPLATS: u32 = 100_000;

fn pacing() -> Pacing {
    Pacing { splat_capacity: SPLATS, pair_capacity: 8 * SPLATS, ..Pacing::default() }
}

fn engine(gpu: &Gpu, input: &Input, variants: Variants) -> Engine {
    Engine::new(gpu, input, &Settings::default(), variants, pacing(), None).expect("an engine")
}

/// At most 830 bytes per splat, 16 per pair and 80 per pixel; slots are counted apart. Pairs of lists that are sorted in
/// tiles take 12 without slots. Pixel tiles keep a bit for each pair and block of 8 pixels, and with chunks, in images of up
/// to 1,024 tiles, 16 bytes per pixel at the ends of seven chunks.
fn assert_bar(memory: &MemoryCost, variants: Variants) {
    let what = format!("{variants:?}: {memory:?}");
    assert!(memory.per_splat > 236.0 * 3.0 && memory.per_splat <= 830.0, "{what}");
    let masks = if variants.tile == TileShape::Pixel { 4.0 } else { 0.0 };
    let states = if variants.chunks == Chunks::ByNeed { 7.0 * 16.0 + 1.0 } else { 0.0 };
    let slots = variants.gradients == GradientSum::Slots;
    let pair = masks + if variants.lists == ListSort::Global || slots { 16.0 } else { 12.0 };
    assert!(memory.per_pair >= pair && memory.per_pair < 0.01 + pair, "{what}");
    assert!(memory.per_pixel > 40.0 && memory.per_pixel <= 80.0 + states, "{what}");
    assert!(if slots { memory.slots_per_pair < 48.01 } else { memory.slots_per_pair < 0.01 }, "{what}");
    assert_eq!(memory.slots_per_splat, if slots { 8.0 } else { 0.0 }, "{what}");
}

#[test]
fn training_keeps_to_its_bytes_per_splat_pair_and_pixel() {
    let Some(gpu) = common::gpu_with(|o| o.canaries = false) else { return };
    let input = plane_scene::input(2, 320, 240, 300);
    for variants in Variants::possible(&gpu) {
        // A device for each case: the memory of an earlier engine is freed some submits later.
        let Some(gpu) = common::gpu_with(|o| o.canaries = false) else { return };
        let before = gpu.memory_use().current;
        let engine = engine(&gpu, &input, variants);
        let memory = engine.memory();
        assert_bar(&memory, variants);
        // Every buffer is in one of the terms; allocations are rounded up, and staging memory for uploads is kept.
        let allocated = gpu.memory_use().current - before;
        let unaccounted = allocated as i64 - memory.total as i64;
        assert!((0..6 << 20).contains(&unaccounted), "{unaccounted} of {allocated} bytes are in no term");
    }
}

/// With moments of 16 bits: 600 bytes per splat, without slots.
#[test]
fn shortcuts_keep_to_600_bytes_per_splat() {
    let Some(gpu) = common::gpu_with(|o| o.canaries = false) else { return };
    let input = plane_scene::input(2, 320, 240, 300);
    let settings = Settings { shortcuts: Shortcuts { moment_bits: 16, ..Shortcuts::default() }, ..Settings::default() };
    let variants = Variants::choose(&gpu, true);
    let memory = Engine::new(&gpu, &input, &settings, variants, pacing(), None).expect("an engine").memory();
    let full = engine(&gpu, &input, variants).memory();
    assert!(memory.per_splat <= 600.0, "{memory:?}");
    assert!((full.per_splat - memory.per_splat - 236.0).abs() < 1e-9, "{full:?} {memory:?}");
    assert_eq!((memory.per_pair, memory.per_pixel), (full.per_pair, full.per_pixel));
    // The list of the splats on the image: a word per splat.
    for (shortcuts, without) in
        [(Shortcuts { moment_bits: 16, ..Shortcuts::default() }, &memory), (Shortcuts::default(), &full)]
    {
        let listed = Settings { shortcuts: Shortcuts { visible_adam: true, ..shortcuts }, ..Settings::default() };
        let listed = Engine::new(&gpu, &input, &listed, variants, pacing(), None).expect("an engine").memory();
        assert_eq!(listed.per_splat, without.per_splat + 4.0, "{listed:?}");
    }
}

fn density(engine: &mut Engine, step: u32) -> Vec<u32> {
    let schedule = Schedule::new(&Settings::default(), 2);
    let plan = StepPlan { densify: Some(DensityChange { prune_large: false, sees_all: true }), ..schedule.step(step) };
    let ticket = engine.submit(Event { step, kind: Kind::Density }, &plan, 0).expect("a density change");
    engine.outcome(ticket).expect("its end").counters
}

#[test]
fn a_density_change_needs_no_memory_and_growth_one_plane_more() {
    let Some(gpu) = common::gpu_with(|o| o.canaries = false) else { return };
    let input = plane_scene::input(2, 64, 48, 300);
    let mut engine = engine(&gpu, &input, Variants::choose(&gpu, true));
    let schedule = Schedule::new(&Settings::default(), 2);
    let ticket = engine.submit(Event::of_step(1), &schedule.step(1), 0).expect("a step");
    engine.outcome(ticket).expect("its end");
    gpu.restart_peak();
    let before = gpu.memory_use().current;
    let counts = density(&mut engine, 1);
    assert_eq!(counts[counters::STATUS], 0);
    assert_eq!(gpu.memory_use().peak, before, "a density change allocated something");

    // Growth, as after an event that needed more splats than fit.
    let mut words = counts;
    words[counters::STATUS] = counters::SPLATS_BIT;
    words[counters::WANT_SPLATS] = 2 * SPLATS;
    gpu.write(&engine.renderer().counters, &words).expect("the counters");
    gpu.restart_peak();
    engine.grow().expect("growth");
    let memory = engine.memory();
    assert_eq!(memory.splats, 2 * SPLATS + SPLATS / 2);
    assert_bar(&memory, Variants::choose(&gpu, true));
    // Buffers that no later step needs are freed before planes are copied, one after the other.
    let peak = gpu.memory_use().peak;
    let after = gpu.memory_use().current;
    assert!(peak <= after + 48 * u64::from(memory.splats), "peak {peak}, {after} afterwards");
}
