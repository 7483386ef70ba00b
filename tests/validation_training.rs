//! Training with every watcher on: the Khronos layer (core and synchronization), the hazard checker, and the guards
//! behind buffers. There must be no message, and the checker must report a hazard without any barrier of an event.

mod common;

use common::plane_scene;
use psrgs_vk::dataset::Dataset;
use psrgs_vk::raster::Variants;
use psrgs_vk::train::settings::Exposure;
use psrgs_vk::train::{
    Engine, Event, Input, Kind, Message, Pacing, Residency, Restart, Schedule, Settings, Trainer, prepare,
};
use psrgs_vk::vk::{Gpu, OpenOptions, Validation};

const STEPS: u32 = 40;

fn watch(options: &mut OpenOptions) {
    options.validation = Validation::CoreAndSync;
    options.canaries = true;
    options.check_hazards = true;
}

fn settings() -> Settings {
    let mut s = Settings::default();
    s.photographs.max_side = 96;
    s.run.iterations = STEPS;
    s.run.eval_every = 15;
    s.model.sh_interval = 8;
    s.model.antialias = true;
    s.density.densify_from = 4;
    s.density.densify_until = STEPS;
    s.density.densify_interval = 6;
    s.density.opacity_reset_interval = 16;
    s
}

/// Events of a training.
#[derive(Debug, Default)]
struct Seen {
    steps: u32,
    grown: Vec<&'static str>,
    changed: u32,
    resets: u32,
    evaluations: u32,
}

/// Trains until step `stop`, or to the end; gives the state for a restart.
fn train(
    gpu: &Gpu,
    input: &Input,
    settings: &Settings,
    restart: Option<Restart>,
    stop: Option<u32>,
    seen: &mut Seen,
) -> Restart {
    // Room for the first splats and almost no pairs: both must grow, with events in flight. After a restart,
    // photographs are uploaded in their steps.
    let photographs = if restart.is_some() { Residency::Streamed } else { Residency::Auto };
    let pacing = Pacing { splat_capacity: 1, pair_capacity: 64, photographs, ..Pacing::default() };
    let mut trainer = Trainer::new(gpu, input.clone(), settings, pacing, restart).unwrap();
    while let Some(message) = trainer.next_message().unwrap() {
        match message {
            Message::Step { step, .. } => {
                seen.steps = seen.steps.max(step);
                if Some(step) == stop {
                    break;
                }
            }
            Message::Grown { what, .. } => seen.grown.push(what),
            Message::Density { cloned, split, pruned, .. } => seen.changed += cloned + split + pruned,
            Message::OpacityReset { .. } => seen.resets += 1,
            Message::Evaluated { quality, .. } => {
                assert!(quality.psnr.is_finite());
                seen.evaluations += 1;
            }
            _ => {}
        }
    }
    trainer.picture(&input.train[0].camera).unwrap();
    trainer.snapshot().unwrap()
}

#[test]
fn whole_training_of_the_fox_leaves_no_message() {
    let Some(path) = common::data("fox") else { return };
    let Some(gpu) = common::gpu_with(watch) else { return };
    let settings = settings();
    let dataset =
        Dataset::load(&path, &prepare::load_options(&settings.photographs, settings.model.background.evaluated()))
            .unwrap();
    let input = prepare::input(&dataset, &settings).unwrap();
    let mut seen = Seen::default();
    let restart = train(&gpu, &input, &settings, None, Some(20), &mut seen);
    assert!((20..STEPS).contains(&restart.step));
    let end = train(&gpu, &input, &settings, Some(restart), None, &mut seen);
    assert_eq!((seen.steps, end.step), (STEPS, STEPS));
    assert!(seen.grown.contains(&"pairs") && seen.grown.contains(&"splats"), "{seen:?}");
    assert!(seen.changed > 0 && seen.resets >= 2 && seen.evaluations >= 3, "{seen:?}");
    gpu.check_canaries().unwrap();
    common::assert_no_messages(&gpu);
    assert!(gpu.stats().barriers > 1000, "{:?}", gpu.stats());
}

/// Settings under which the plane scene changes density at step 3.
fn short() -> Settings {
    let mut s = settings();
    s.run.iterations = 6;
    s.run.eval_every = 0;
    s.density.densify_from = 1;
    s.density.densify_interval = 3;
    s.density.densify_until = 5;
    s.density.opacity_reset_interval = 4;
    s
}

/// Trains in every variant on the device, without any message.
fn every_form(gpu: &Gpu) {
    let input = plane_scene::input(3, 40, 30, 60);
    for variants in Variants::possible(gpu) {
        let mut settings = short();
        settings.optimiser.exposure = Exposure::Affine;
        settings.name_variants(variants);
        let mut seen = Seen::default();
        let end = train(gpu, &input, &settings, None, None, &mut seen);
        assert_eq!((end.variants, end.step), (variants, 6));
        assert!(seen.grown.contains(&"pairs"), "{seen:?}");
        gpu.check_canaries().unwrap_or_else(|error| panic!("{variants:?}: {error}"));
        let messages = gpu.validation_messages();
        assert!(messages.is_empty(), "{variants:?}: {}", messages[0]);
    }
}

#[test]
fn every_form_trains_without_a_message() {
    if let Some(gpu) = common::gpu_with(watch) {
        every_form(&gpu);
    }
}

/// The layer also checks for races between the threads of a workgroup.
#[test]
fn every_form_trains_within_its_buffers() {
    let assisted = |options: &mut OpenOptions| {
        options.validation = Validation::GpuAssisted;
        options.canaries = false;
    };
    if let Some(gpu) = common::layer_assists().then(|| common::gpu_with(assisted)).flatten() {
        every_form(&gpu);
    }
}

#[test]
fn checker_misses_every_barrier_of_every_event() {
    let Some(gpu) = common::gpu_with(watch) else { return };
    let mut settings = short();
    let input = plane_scene::input(3, 40, 30, 60);
    let schedule = Schedule::new(&settings, input.train.len());
    for (i, variants) in Variants::possible(&gpu).into_iter().enumerate() {
        // Every second variant with exposures, every other pair with photographs uploaded in their steps.
        settings.optimiser.exposure = [Exposure::Off, Exposure::Affine][i % 2];
        let photographs = [Residency::Streamed, Residency::Resident][i / 2 % 2];
        let pacing = Pacing { photographs, ..Pacing::default() };
        let mut engine = Engine::new(&gpu, &input, &settings, variants, pacing, None).unwrap();
        // Twice, so that in the second round every event has barriers against the events before.
        for step in [3, 4] {
            for kind in [Kind::Step, Kind::Density, Kind::Reset] {
                // The plan of an optimiser step, and of a step with a density change.
                let (event, plan) = (Event { step, kind }, schedule.step(if kind == Kind::Step { 2 } else { 3 }));
                let mut recorder = gpu.recorder("event").unwrap();
                engine.record(&mut recorder, event, &plan, 0).unwrap();
                let (total, unmissed) = gpu.missed_barriers(&recorder).unwrap();
                assert!(unmissed.is_empty(), "{variants:?}, {kind:?}: {} of {total}: {unmissed:?}", unmissed.len());
                let least = match kind {
                    Kind::Step => 40,
                    Kind::Density => 20,
                    Kind::Reset => 3,
                };
                assert!(total >= least, "{variants:?}, {kind:?}: only {total} barriers");
                engine.submit_recorded(recorder).unwrap();
            }
        }
    }
    gpu.check_canaries().unwrap();
    common::assert_no_messages(&gpu);
}
