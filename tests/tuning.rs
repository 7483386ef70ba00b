//! Variants of passes by timing: the choice, its cache on disk, and no effect on training.

mod common;

use std::fs;

use common::plane_scene;
use psrgs_vk::raster::{Chunks, GradientSum, ListSort, TileShape, Variants};
use psrgs_vk::train::settings::Tune;
use psrgs_vk::train::tune::{self, ChoiceReason, SizeClass, Tuned};
use psrgs_vk::train::{Input, Pacing, Settings, State, Trainer, chosen_variants};
use psrgs_vk::vk::{DeviceKind, Gpu};

fn settings(tune: Tune) -> Settings {
    let mut s = Settings::default();
    s.run.tune = tune;
    s.run.eval_every = 0;
    s
}

fn input() -> Input {
    plane_scene::input(3, 48, 40, 200)
}

/// A short training by slots, to the bit.
fn trained(gpu: &Gpu) -> State {
    let mut s = settings(Tune::Off);
    s.run.iterations = 12;
    s.run.deterministic = true;
    s.density.densify_from = 2;
    s.density.densify_interval = 3;
    let mut trainer = Trainer::new(gpu, input(), &s, Pacing::default(), None).expect("a training");
    while trainer.next_message().expect("training goes on").is_some() {}
    trainer.snapshot().expect("a state").state
}

fn bits(state: &State) -> Vec<u32> {
    let floats = state.params.iter().chain(state.moments.iter().flatten()).flatten().chain(&state.stats);
    floats.map(|v| v.to_bits()).chain(state.ids.iter().copied()).collect()
}

#[test]
fn timing_leaves_no_trace_in_the_training() {
    let Some(gpu) = common::gpu() else { return };
    let before = trained(&gpu);
    let memory = gpu.memory_use().current;
    let all = Variants::possible(&gpu);
    let times = tune::measure(&gpu, &input(), &settings(Tune::Again), &all).expect("timings");
    // Both tile shapes are timed; a far slower shape need not be timed in all variants.
    let tried: Vec<Variants> = times.iter().map(|t| t.0).collect();
    assert!(tried.iter().all(|form| all.contains(form)) && tried[0] == all[0], "{tried:?}");
    assert!(
        [TileShape::Column, TileShape::Pixel].iter().all(|tile| tried.iter().any(|f| f.tile == *tile)),
        "{tried:?}"
    );
    assert!(times.iter().all(|t| t.1 > 0.0 && t.1.is_finite()), "{times:?}");
    assert!(gpu.memory_use().current <= memory + (8 << 20), "buffers of the timing were not freed");
    let after = trained(&gpu);
    assert!(bits(&before) == bits(&after) && before.counters == after.counters);
    gpu.check_canaries().expect("guards are whole");
    common::assert_no_messages(&gpu);
}

#[test]
fn a_choice_is_kept_and_a_damaged_file_is_replaced() {
    let Some(gpu) = common::gpu() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let cache = folder.path().join("not/there/yet");
    let tuned = |settings: &Settings| tune::tuned(&gpu, &input(), settings, Some(&cache)).expect("a choice");
    let timed = |t: &Tuned| matches!(&t.why, ChoiceReason::Timed(times) if times.len() >= 2);
    let auto = settings(Tune::Auto);

    let first = tuned(&auto);
    assert!(timed(&first) && first.warning.is_none(), "{first}");
    assert!(first.to_string().contains(" ms") && first.to_string().contains("timed"), "{first}");
    let again = tuned(&auto);
    assert_eq!((&again.why, again.variants), (&ChoiceReason::Kept, first.variants));
    assert!(again.to_string().contains("`tune` again"), "{again}");
    assert!(timed(&tuned(&settings(Tune::Again))), "asked to time again");

    // Another size is another entry; the entry of this size stays.
    let large = plane_scene::input(2, 48, 40, 4000);
    assert_ne!(SizeClass::of(&large, 1), SizeClass::of(&input(), 1));
    assert_ne!(SizeClass::of(&large, 1), SizeClass::of(&large, 4), "steps of a quarter of a photograph");
    let other = tune::tuned(&gpu, &large, &auto, Some(&cache)).expect("a choice");
    assert!(timed(&other));
    assert_eq!(tuned(&auto).why, ChoiceReason::Kept);

    let file = cache.join("forms.json");
    let good = fs::read_to_string(&file).expect("a file");
    for damaged in [&good[..good.len() / 2], "", "[{}]", "\u{0}\u{1}"] {
        fs::write(&file, damaged).expect("written");
        let got = tuned(&auto);
        assert!(timed(&got), "{damaged:?}: {got}");
        let warning = got.warning.expect("a warning");
        assert!(warning.contains("forms.json") && warning.contains("written anew"), "{warning}");
        assert_eq!(tuned(&auto).why, ChoiceReason::Kept);
    }
    // Entries of another driver, or of a variant that this device cannot run, are ignored.
    for (from, to) in [("\"driver\": \"", "\"driver\": \"other "), ("\"tile\": \"", "\"tile\": \"hexagonal ")] {
        fs::write(&file, fs::read_to_string(&file).expect("a file").replace(from, to)).expect("written");
        assert!(timed(&tuned(&auto)), "{to}");
    }
    // A folder that cannot be written is a warning, and timing works.
    let file = folder.path().join("file");
    fs::write(&file, "").expect("written");
    let got = tune::tuned(&gpu, &input(), &auto, Some(&file.join("below"))).expect("a choice");
    assert!(timed(&got) && got.warning.expect("a warning").contains("variants could not be kept"));
}

#[test]
fn what_is_fixed_is_not_timed() {
    let Some(gpu) = common::gpu() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let why = |settings: &Settings| {
        let tuned = tune::tuned(&gpu, &input(), settings, Some(folder.path())).expect("a choice");
        assert_eq!(tuned.variants, chosen_variants(&gpu, settings).expect("forms"));
        match tuned.why {
            ChoiceReason::Capability(why) => why,
            other => panic!("{other:?}"),
        }
    };
    let mut s = settings(Tune::Again);
    s.run.deterministic = true;
    assert_eq!(why(&s), "`deterministic`");
    assert_eq!(why(&settings(Tune::Off)), "`tune` is off");
    let mut s = settings(Tune::Auto);
    s.run.iterations = 999;
    assert!(why(&s).contains("too short"));
    let named = Variants::choose(&gpu, false);
    let mut s = settings(Tune::Again);
    s.blending.tile_shape = Some(named.tile);
    s.stepping.gradient_sum = Some(GradientSum::Slots);
    assert_eq!(why(&s), "no other variant is possible");
    assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 0, "nothing was timed, so nothing is kept");

    // With a named part the rest is timed, and is no entry for runs that name nothing.
    s.blending.tile_shape = Some(TileShape::Pixel);
    s.stepping.gradient_sum = None;
    let tuned = tune::tuned(&gpu, &input(), &s, Some(folder.path())).expect("a choice");
    let ChoiceReason::Timed(times) = &tuned.why else { panic!("{tuned}") };
    assert!(times.len() > 1 && times.iter().all(|t| t.0.tile == TileShape::Pixel), "{tuned}");
    // The best of the others is also timed without chunks; lists are sorted in tiles on CPU devices only by name.
    let [whole, in_tiles] = [
        times.iter().filter(|t| t.0.chunks == Chunks::Whole).count(),
        times.iter().filter(|t| t.0.lists == ListSort::Tiles).count(),
    ];
    assert_eq!((whole, in_tiles), (1, if gpu.caps().kind == DeviceKind::Cpu { 0 } else { times.len() - 1 }), "{tuned}");
    assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 0);
}
