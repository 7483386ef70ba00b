//! Device memory: a training takes what was planned, and keeps to a limit.

mod common;

use std::path::Path;

use common::plane_scene;
use psrgs_vk::format::checkpoint;
use psrgs_vk::train::settings::{Gate, Growth, SigmaLearning};
use psrgs_vk::train::{
    Checkpointed, Error, Input, MemoryPlan, Message, Pacing, Settings, Trainer, chosen_variants, shares_memory,
};
use psrgs_vk::vk::{self, Gpu, Memory};

fn settings(steps: u32) -> Settings {
    let mut s = Settings::default();
    s.run.iterations = steps;
    s.run.deterministic = true;
    s.run.eval_every = 0;
    s.density.densify_from = 1;
    s.density.densify_interval = 2;
    s.density.densify_until = steps;
    s.density.grad_threshold = 1e-9;
    s.density.opacity_reset_interval = 0;
    s
}

fn plan(gpu: &Gpu, input: &Input, settings: &Settings, pacing: Pacing) -> MemoryPlan {
    let variants = chosen_variants(gpu, settings).expect("variants");
    MemoryPlan::new(gpu, input, settings, variants, pacing, input.initial.len() as u32).expect("a plan")
}

#[test]
fn buffers_of_a_planning_handle_are_counted_and_useless() {
    let Some(gpu) = common::gpu() else { return };
    let (before, counting) = (gpu.memory_use().current, gpu.planning());
    let buffer = counting.buffer("planned", 1 << 30, Memory::Device).expect("counted");
    counting.buffer("small", 1, Memory::Device).expect("counted");
    let planned = counting.planned_bytes();
    assert!((1 << 30..(1 << 30) + 2048).contains(&planned), "{planned}");
    assert_eq!((gpu.memory_use().current, gpu.planned_bytes()), (before, 0));
    let real = gpu.buffer("real", 64, Memory::Device).expect("a buffer");
    let mut recorder = gpu.recorder("misuse").expect("a recorder");
    for refused in [
        recorder.copy(&buffer, 0, &real, 0, 4),
        recorder.copy(&real, 0, &buffer, 0, 4),
        recorder.upload(&buffer, 0, &[0; 4]),
        recorder.fill(buffer.slice(0..4), 0),
    ] {
        assert!(matches!(refused, Err(vk::Error::BadRange { .. })), "{refused:?}");
    }
    let error = counting.buffer("huge", u64::MAX, Memory::Device).expect_err("larger than any allocation");
    assert!(matches!(error, vk::Error::BufferTooLarge { .. }), "{error}");
}

#[test]
fn a_training_takes_what_was_planned() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(3, 96, 80, 300);
    for pacing in [Pacing::default(), Pacing { splat_capacity: 70_000, pair_capacity: 300_000, ..Pacing::default() }] {
        let settings = settings(2);
        let plan = plan(&gpu, &input, &settings, pacing);
        let before = gpu.memory_use().current;
        let mut trainer = Trainer::new(&gpu, input.clone(), &settings, pacing, None).expect("a training");
        while trainer.next_message().expect("training goes on").is_some() {}
        trainer.evaluate().expect("pictures");
        // Staging memory for uploads stays allocated.
        let taken = gpu.memory_use().current - before;
        println!("{plan}; taken {taken}");
        assert!(taken <= plan.at_start + (4 << 20), "{taken} bytes, planned {}", plan.at_start);
        assert!(taken as f64 >= 0.7 * plan.at_start as f64, "{taken} bytes, planned {}", plan.at_start);
    }
    assert_eq!(plan(&gpu, &input, &settings(2), Pacing::default()).photographs, (3, 3 * 4 * 96 * 80 + canaries(&gpu)));
}

#[test]
fn renders_that_sigma_is_learned_from_are_planned() {
    let Some(gpu) = common::gpu() else { return };
    if !shares_memory(&gpu) {
        return;
    }
    let input = plane_scene::input(3, 96, 80, 300);
    let planned = |how: SigmaLearning| {
        let mut settings = settings(2);
        settings.frequencies.gate = Gate::Spectral;
        settings.frequencies.sigma_learning = how;
        plan(&gpu, &input, &settings, Pacing::default()).at_start
    };
    // Two steps are in flight at least.
    let renders = 2 * 16 * 96 * 80;
    let [off, errors, composite] = [SigmaLearning::Off, SigmaLearning::Errors, SigmaLearning::Composite].map(planned);
    assert!(errors >= off + renders, "{errors} and {off}, and the renders take {renders}");
    assert!(composite >= off + 2 * renders, "{composite} and {off}, and the renders take {renders}");
}

/// Bytes of the guards behind three buffers; 0 without guards.
fn canaries(gpu: &Gpu) -> u64 {
    let counting = gpu.planning();
    counting.buffer("b", 4 * 96 * 80, Memory::Device).expect("counted");
    3 * (counting.planned_bytes() - 4 * 96 * 80)
}

/// Terms of the plan against the known rows of buffers, so that a change of either shows.
#[test]
fn terms_of_the_plan_are_those_of_the_known_rows() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(3, 96, 80, 300);
    let plan = plan(&gpu, &input, &settings(2), Pacing::default());
    println!("{plan}");
    // Model and moments are 59 floats each; keys, values, slots and gradients of a pair are 24 + 48 bytes.
    assert!(plan.per_splat >= 3.0 * 236.0 && plan.per_splat < 3000.0, "{} B per splat", plan.per_splat);
    assert!(plan.per_pair >= 24.0 && plan.per_pair < 120.0, "{} B per pair", plan.per_pair);
    assert!(plan.per_pixel >= 36.0 && plan.per_pixel < 160.0, "{} B per pixel", plan.per_pixel);
}

/// Under `--max-splats` there is no room for more splats, at the start and after growth.
#[test]
fn no_room_is_made_for_more_splats_than_are_allowed() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(3, 64, 48, 400);
    let mut settings = settings(30);
    settings.density.max_splats = Some(1000);
    assert_eq!(plan(&gpu, &input, &settings, Pacing::default()).capacities.0, 1000);
    settings.density.max_splats = Some(100);
    assert_eq!(plan(&gpu, &input, &settings, Pacing::default()).capacities.0, 400, "room for the first splats alone");
    settings.density.max_splats = Some(700);
    let start = Pacing { splat_capacity: 650, ..Pacing::default() };
    let mut trainer = Trainer::new(&gpu, input, &settings, start, None).expect("a training");
    let (mut made, mut most) = (Vec::new(), 0);
    while let Some(message) = trainer.next_message().expect("training goes on") {
        match message {
            Message::Grown { what: "splats", capacity, .. } => made.push(capacity),
            Message::Density { splats, .. } => most = most.max(splats),
            _ => (),
        }
    }
    assert_eq!((made, most), (vec![700], 700));
}

/// A device with a limit of `bytes` bytes.
fn limited(bytes: u64) -> Option<Gpu> {
    common::gpu_with(|options| options.max_device_memory = Some(bytes))
}

#[test]
fn growth_stops_where_memory_ends_and_training_goes_on() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(3, 64, 48, 400);
    let settings = settings(30);
    // Room for 1500 splats with their pairs, beside the assumed need of other users of the device.
    let pacing = Pacing { splat_capacity: 1500, pair_capacity: 8 * 1500, ..Pacing::default() };
    let limit = plan(&gpu, &input, &settings, pacing).at_start + (1 << 20);
    let train = || {
        let gpu = limited(limit)?;
        let start = Pacing { splat_capacity: 450, ..Pacing::default() };
        let mut trainer = Trainer::new(&gpu, input.clone(), &settings, start, None).expect("a training");
        let (mut warnings, mut losses, mut most) = (Vec::new(), Vec::new(), 0);
        while let Some(message) = trainer.next_message().expect("training goes on") {
            match message {
                Message::Warning(text) => warnings.push(text),
                Message::Density { splats, .. } => most = splats.max(most),
                Message::Step { loss, .. } => losses.push(loss.to_bits()),
                _ => {}
            }
        }
        assert!(gpu.memory_use().peak <= limit, "{} of {limit} bytes", gpu.memory_use().peak);
        gpu.check_canaries().expect("guards are whole");
        Some((warnings, losses, most))
    };
    let Some((warnings, losses, most)) = train() else { return };
    println!("limit {limit}, {most} splats, {warnings:?}");
    assert_eq!(losses.len(), 30);
    assert!((1000..4000).contains(&most), "{most} splats");
    let told: Vec<&String> = warnings.iter().filter(|w| w.contains("growth stops")).collect();
    assert_eq!(told.len(), 1, "{warnings:?}");
    assert!(
        told[0].contains(&format!("{} splats", psrgs_vk::numbers::grouped(most)))
            && told[0].contains("`max-device-memory`"),
        "{}",
        told[0]
    );
    let again = train().expect("a device");
    assert_eq!((again.1, again.2), (losses, most), "the same bits under the same limit");
}

#[test]
fn what_does_not_fit_at_all_is_refused_with_numbers() {
    let Some(gpu) = limited(1 << 20) else { return };
    // More than 1 MiB by model and moments alone, 708 bytes per splat. Staging counts only where the device uses host
    // memory.
    let input = plane_scene::input(3, 64, 48, 2000);
    let error = Trainer::new(&gpu, input, &settings(3), Pacing::default(), None).err().expect("no room");
    let text = error.to_string();
    assert!(matches!(error, Error::MemoryLimit { saved: None, .. }), "{text}");
    for word in ["2,000 splats to begin with", "MiB", "the limit is 1.0 MiB", "`max-device-memory`", "`max-side`"] {
        assert!(text.contains(word), "{text}");
    }
}

/// Trains splats that swell until their pairs no longer fit. The error, the last step that was told, and the input.
fn swollen(gpu: &Gpu, settings: &mut Settings, folder: &Path) -> Option<(Error, u32, Input)> {
    let mut input = plane_scene::input(3, 256, 192, 2000);
    settings.optimiser.lr_scales = 0.3;
    // At this rate splats grow without bound and cover more and more tiles.
    input.initial.scales.iter_mut().for_each(|s| *s -= 3.0);
    let tight = Pacing { splat_capacity: 2000, pair_capacity: 9000, ..Pacing::default() };
    let limit = plan(gpu, &input, settings, tight).at_start.next_multiple_of(1 << 20) + (1 << 19);
    let gpu = limited(limit)?;
    let pacing = Pacing { splat_capacity: 2000, pair_capacity: 4000, ..Pacing::default() };
    let mut trainer = Trainer::new(&gpu, input.clone(), settings, pacing, None).expect("a training");
    trainer.keep_checkpoints(folder);
    let mut last = 0;
    loop {
        match trainer.next_message() {
            Ok(Some(Message::Step { step, .. })) => last = step,
            Ok(Some(_)) => {}
            Ok(None) => panic!("everything fitted"),
            Err(error) => {
                println!("{error}");
                return Some((error, last, input));
            }
        }
    }
}

/// Between a relocation and its step the model is of no whole step: it is not saved, and the error comes all the same.
#[test]
fn pairs_that_do_not_fit_after_a_relocation_end_it_too() {
    let Some(gpu) = common::gpu() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut settings = settings(60);
    settings.density.growth = Growth::Relocated;
    settings.density.densify_interval = 1;
    settings.density.max_splats = Some(2000);
    let Some((error, _, _)) = swollen(&gpu, &mut settings, folder.path()) else { return };
    assert!(matches!(error, Error::MemoryLimit { saved: None, .. }), "{error}");
    assert!(checkpoint::latest(folder.path()).expect("readable").is_none());
}

/// Relocation grows a model too, and says where memory has ended that.
#[test]
fn relocation_that_memory_stops_says_so() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(3, 64, 48, 400);
    let mut settings = settings(30);
    settings.density.growth = Growth::Relocated;
    settings.density.relocate_growth = 0.5;
    settings.density.max_splats = Some(100_000);
    let pacing = Pacing { splat_capacity: 1500, pair_capacity: 8 * 1500, ..Pacing::default() };
    let limit = plan(&gpu, &input, &settings, pacing).at_start + (1 << 20);
    let Some(gpu) = limited(limit) else { return };
    let start = Pacing { splat_capacity: 450, ..Pacing::default() };
    let mut trainer = Trainer::new(&gpu, input, &settings, start, None).expect("a training");
    let (mut told, mut most) = (Vec::new(), 0);
    while let Some(message) = trainer.next_message().expect("training goes on") {
        match message {
            Message::Warning(text) if text.contains("growth stops") => told.push(text),
            Message::Step { splats, .. } => most = splats.max(most),
            _ => {}
        }
    }
    assert_eq!(told.len(), 1, "{told:?}, {most} splats");
    assert!(told[0].contains(&psrgs_vk::numbers::grouped(most)), "{}, {most} splats", told[0]);
}

/// Splats swell until their pairs no longer fit: the training ends with an error and a state to resume from.
#[test]
fn pairs_that_do_not_fit_end_the_training_with_a_checkpoint() {
    let Some(gpu) = common::gpu() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut settings = settings(60);
    settings.density.no_densify = true;
    let Some((error, last, input)) = swollen(&gpu, &mut settings, folder.path()) else { return };
    let Error::MemoryLimit { what, wanted, needed, room, saved: Some(file), .. } = &error else {
        panic!("{error}");
    };
    assert!(*what == "(splat, tile) pairs" && *wanted > 9000 && needed > room, "{error}");
    assert!(error.to_string().contains("`resume`"), "{error}");
    let latest = checkpoint::latest(folder.path()).expect("readable").expect("saved");
    assert_eq!(&latest.file, file);
    let restart = Checkpointed::from_checkpoint(&latest.checkpoint).expect("whole").restart;
    assert_eq!(restart.step, last, "a reported step is lost");
    // With more memory the training continues from this state.
    let gpu = common::gpu().expect("a device");
    let mut trainer = Trainer::new(&gpu, input, &settings, Pacing::default(), Some(restart)).expect("a training");
    let steps = std::iter::from_fn(|| trainer.next_message().expect("training goes on"));
    let steps: Vec<u32> =
        steps.filter_map(|m| if let Message::Step { step, .. } = m { Some(step) } else { None }).collect();
    assert_eq!((steps.first(), steps.last()), (Some(&(last + 1)), Some(&60)));
}
