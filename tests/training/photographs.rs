//! Photographs on the device, or uploaded in their steps from memory, compressed or from files, give the same training.

use psrgs_vk::dataset::{Dataset, Depth, HostShare, LoadOptions, Pixels, Supply};
use psrgs_vk::eval::{Quality, TrainingScores};
use psrgs_vk::train::{FeedCounts, Input, Message, Pacing, Residency, Settings, Trainer, View, prepare, score};
use psrgs_vk::vk::Gpu;
use psrgs_vk::world::{WorldParams, generate};

use crate::common::{self, plane_scene};
use crate::{assert_same, run, settings};

fn streamed(events_in_flight: usize) -> Pacing {
    Pacing { events_in_flight, photographs: Residency::Streamed, decoded_ahead: 2, decoders: 2, ..Pacing::default() }
}

/// The view with 16 bits per channel, with `lower` in the low bits.
fn deepened(view: &View, lower: u16) -> View {
    let pixels = view.photograph.pixels().expect("in memory");
    let wide = |(k, v): (usize, &u8)| (257 * u16::from(*v)).saturating_add(if k % 4 < 3 { lower } else { 0 });
    let values: Vec<u16> = pixels.rgba8().iter().enumerate().map(wide).collect();
    View::new(&view.name, view.camera, Pixels::Rgba16(values))
}

#[test]
fn streamed_photographs_train_to_the_same_bits() {
    let Some(gpu) = common::gpu() else { return };
    let mut input = plane_scene::input(5, 64, 48, 300);
    // Photographs of two sizes and two depths.
    let other = plane_scene::input(5, 40, 56, 0);
    input.train[1] = other.train[1].clone();
    input.train[3] = deepened(&input.train[3], 77);
    // One photograph per step, and in some steps also those of the steps before.
    let alone = settings(60);
    let mut several = settings(60);
    several.texture.lambda_perceptual = 0.02;
    (several.texture.perceptual_every, several.texture.perceptual_views) = (2, 4);
    for settings in [&alone, &several] {
        let resident = Pacing { photographs: Residency::Resident, ..Pacing::default() };
        let truth = run(&gpu, input.clone(), settings, resident);
        assert!(truth.changed > 0);
        for events_in_flight in [1, 2, 4, 8] {
            let got = run(&gpu, input.clone(), settings, streamed(events_in_flight));
            assert_same(&truth.state, &got.state, &format!("{events_in_flight} in flight"));
            assert_eq!(truth.losses, got.losses);
        }
        // Replayed steps see their photographs again.
        let tight = Pacing { splat_capacity: 301, pair_capacity: 64, ..streamed(4) };
        let forced = run(&gpu, input.clone(), settings, tight);
        assert!(forced.grown >= 2);
        assert_same(&truth.state, &forced.state, "replayed");
    }
}

#[test]
fn streaming_waits_for_nothing_on_the_device() {
    let Some(gpu) = common::gpu() else { return };
    let mut settings = settings(40);
    settings.density.no_densify = true;
    let input = plane_scene::input(5, 64, 48, 300);
    let large = Pacing { splat_capacity: 400, pair_capacity: 400_000, ..streamed(4) };
    let mut trainer = Trainer::new(&gpu, input, &settings, large, None).expect("trainer");
    let (mut before, mut steps) = (None, 0);
    while let Some(message) = trainer.next_message().expect("message") {
        if let Message::Step { step, .. } = message {
            steps = step;
            let now = gpu.stats();
            let first = *before.get_or_insert(now);
            // The last steps have nothing submitted behind them.
            if (5..=35).contains(&step) {
                assert_eq!(now.host_waits, first.host_waits, "step {step}");
                assert!(now.pacing_waits >= first.pacing_waits);
            }
        }
    }
    assert_eq!(steps, 40);
    let counts = trainer.feed_counts().expect("streamed");
    assert_eq!((counts.asked, counts.waited), (40, 0), "waited for photographs in memory");
}

/// A generated scene on disk, with photographs in memory or not.
struct OnDisk {
    _folder: tempfile::TempDir,
    dataset: Dataset,
    settings: Settings,
}

impl OnDisk {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let params = WorldParams { images: 9, max_side: 96, pixels_per_point: 16, ..WorldParams::default() };
        generate(&params, folder.path(), &mut |_| ()).expect("a scene");
        // Reduced, so that compressed photographs are not the files.
        let dataset =
            Dataset::load(folder.path(), &LoadOptions { max_side: Some(64), ..LoadOptions::default() }).expect("loads");
        let mut settings = settings(36);
        settings.run.eval_every = 12;
        Self { _folder: folder, dataset, settings }
    }

    fn input(&self, keep: u64) -> Input {
        let initial = prepare::initial(&self.dataset, &self.settings).expect("points");
        let share = HostShare { keep, decoding: 1 << 20, threads: 2 };
        prepare::input_within(&self.dataset, initial, share).expect("decoded")
    }
}

fn scored(
    gpu: &Gpu,
    input: Input,
    settings: &Settings,
    pacing: Pacing,
) -> (psrgs_vk::train::State, Vec<u64>, Option<FeedCounts>) {
    let mut trainer = Trainer::new(gpu, input, settings, pacing, None).expect("trainer");
    let mut scores = Vec::new();
    while let Some(message) = trainer.next_message().expect("message") {
        if let Message::Evaluated { quality, .. } = message {
            scores.push(quality.psnr.to_bits());
        }
    }
    let state = trainer.snapshot().expect("snapshot").state;
    (state, scores, trainer.feed_counts())
}

#[test]
fn photographs_not_kept_in_memory_train_and_score_the_same() {
    let Some(gpu) = common::gpu() else { return };
    let scene = OnDisk::new();
    let whole = scene.input(u64::MAX);
    let kept: u64 = whole.train.iter().chain(&whole.held_out).map(|view| view.photograph.kept_bytes()).sum();
    let (truth, scores, nothing) =
        scored(&gpu, whole, &scene.settings, Pacing { photographs: Residency::Resident, ..Pacing::default() });
    assert_eq!((scores.len(), nothing), (3, None));
    // All compressed in memory, some, none; and uploaded from there at the beginning.
    for (keep, photographs) in [
        (kept / 2, Residency::Streamed),
        (kept / 8, Residency::Streamed),
        (0, Residency::Streamed),
        (0, Residency::Resident),
    ] {
        let input = scene.input(keep);
        let held: u64 = input.train.iter().chain(&input.held_out).map(|view| view.photograph.kept_bytes()).sum();
        assert!(held <= keep, "{held} bytes are kept of {keep}");
        let (state, again, counts) = scored(&gpu, input, &scene.settings, Pacing { photographs, ..streamed(4) });
        assert_same(&truth, &state, &format!("{keep} bytes kept, {photographs:?}"));
        assert_eq!(scores, again);
        if photographs == Residency::Streamed {
            // Seven views, five passes: each photograph is decoded several times, unless it is needed twice in a
            // row.
            let counts = counts.expect("streamed");
            assert!(counts.asked >= 36 && counts.decoded > 7, "{counts:?}");
            assert!((36..=counts.asked + 2).contains(&(counts.decoded + counts.reused)), "{counts:?}");
        }
    }
}

/// The scores of photographs trained on are those of renders compared by hand, wherever the photographs lie; and asking
/// for them changes nothing.
#[test]
fn training_scores_are_those_of_a_comparison_by_hand() {
    let Some(gpu) = common::gpu() else { return };
    let mut input = plane_scene::input(35, 24, 18, 100);
    // Of those that are scored one has a mask, and one 16 bits per channel.
    let mut masked = input.train[8].photograph.pixels().expect("in memory").rgba8().into_owned();
    masked.chunks_exact_mut(4).take(200).for_each(|pixel| pixel.copy_from_slice(&[255, 0, 255, 0]));
    input.train[8] = View::new(&input.train[8].name, input.train[8].camera, Pixels::Rgba8(masked));
    input.train[3] = deepened(&input.train[3], 77);
    let sample = TrainingScores::sample(input.train.len());
    assert!(sample.contains(&8) && sample.contains(&3) && sample.len() < input.train.len());
    let mut all = Vec::new();
    for photographs in [Residency::Resident, Residency::Streamed] {
        let pacing = Pacing { photographs, ..streamed(4) };
        let mut trainer = Trainer::new(&gpu, input.clone(), &settings(40), pacing, None).expect("trainer");
        while trainer.next_message().expect("message").is_some() {}
        let before = trainer.snapshot().expect("snapshot").state;
        let scores = trainer.training_scores().expect("scores");
        let by_hand = sample.iter().map(|at| {
            let view = &input.train[*at];
            let rgb = trainer.picture(&view.camera).expect("a render").rgb8();
            score(view, &view.photograph.pixels().expect("in memory"), &rgb)
        });
        let Quality { psnr, ssim, images } = Quality::of(by_hand.collect());
        assert_eq!(scores, TrainingScores { psnr: Some(psnr), ssim: Some(ssim) }, "{photographs:?}");
        assert!(images.iter().any(|image| (image.psnr - psnr).abs() > 0.1), "all photographs are alike");
        assert_same(&before, &trainer.snapshot().expect("snapshot").state, "scored");
        all.push(scores);
    }
    assert_eq!(all[0], all[1], "resident and streamed");
}

/// Without kept photographs, every photograph is decoded for its step. Decoding is requested before the step in front
/// is submitted: at the start, after scorings and density changes, in replays after buffers have grown, and in a
/// resumed training. So a step waits only where decoding takes longer than training.
#[test]
fn every_photograph_is_asked_for_one_step_ahead() {
    let Some(gpu) = common::gpu() else { return };
    let scene = OnDisk::new();
    let tight = |decoded_ahead| Pacing { splat_capacity: 1, pair_capacity: 64, decoded_ahead, ..streamed(4) };
    let followed = |pacing, restart| {
        let mut trainer = Trainer::new(&gpu, scene.input(0), &scene.settings, pacing, restart).expect("trainer");
        let (mut grown, mut scored) = (0, 0);
        while let Some(message) = trainer.next_message().expect("message") {
            grown += u32::from(matches!(message, Message::Grown { .. }));
            scored += u32::from(matches!(message, Message::Evaluated { .. }));
        }
        let counts = trainer.feed_counts().expect("streamed");
        let streaming = trainer.streaming().expect("streamed");
        assert_eq!(streaming.waits.len() as u64, counts.waited);
        assert!(streaming.waits.iter().all(|wait| (1..=36).contains(&wait.step) && wait.seconds >= 0.0));
        (counts, grown, scored)
    };
    for decoded_ahead in [2, 4] {
        let (counts, grown, scored) = followed(tight(decoded_ahead), None);
        assert!(grown >= 2 && scored == 3, "{grown} times grown, {scored} times scored");
        assert!(counts.asked > 36 && counts.decoded > 7, "no step was replayed: {counts:?}");
        assert_eq!(counts.unforeseen, 0, "{counts:?}");
        // Replayed steps decode nothing again.
        assert!(counts.decoded + counts.reused <= counts.asked + decoded_ahead as u64, "{counts:?}");
    }
    // With one photograph at a time, no decoding can begin in advance.
    let (alone, ..) = followed(tight(1), None);
    assert!(alone.unforeseen > 7, "{alone:?}");

    let mut first = Trainer::new(&gpu, scene.input(0), &scene.settings, tight(2), None).expect("trainer");
    while !matches!(first.next_message().expect("message"), Some(Message::Step { step: 20, .. })) {}
    let restart = first.snapshot().expect("snapshot");
    let (resumed, ..) = followed(streamed(4), Some(restart));
    assert!(resumed.asked > 0 && resumed.unforeseen == 0, "{resumed:?}");
}

#[test]
fn streamed_training_stops_and_resumes_without_a_trace() {
    let Some(gpu) = common::gpu() else { return };
    let scene = OnDisk::new();
    let (truth, ..) = scored(&gpu, scene.input(u64::MAX), &scene.settings, Pacing::default());
    for stop in [5, 15, 29] {
        let mut first = Trainer::new(&gpu, scene.input(0), &scene.settings, streamed(4), None).expect("trainer");
        while let Some(message) = first.next_message().expect("message") {
            if matches!(message, Message::Step { step, .. } if step == stop) {
                break;
            }
        }
        let restart = first.snapshot().expect("snapshot");
        drop(first);
        let mut second =
            Trainer::new(&gpu, scene.input(0), &scene.settings, streamed(3), Some(restart)).expect("trainer");
        while second.next_message().expect("message").is_some() {}
        assert_same(&truth, &second.snapshot().expect("snapshot").state, &format!("resumed near {stop}"));
    }
}

#[test]
fn a_missing_photograph_ends_the_training_and_is_named() {
    let Some(gpu) = common::gpu() else { return };
    let scene = OnDisk::new();
    let mut trainer = Trainer::new(&gpu, scene.input(0), &scene.settings, streamed(2), None).expect("trainer");
    trainer.next_message().expect("a step");
    std::fs::remove_dir_all(scene.dataset.path.join("images")).expect("removed");
    let error = loop {
        match trainer.next_message() {
            Ok(Some(_)) => {}
            Ok(None) => panic!("trained without photographs"),
            Err(error) => break error.to_string(),
        }
    };
    assert!(error.contains("view_") && error.contains("No such file"), "{error}");
}

#[test]
fn deep_photographs_train_as_8_bit_copies_with_finer_digits() {
    let Some(gpu) = common::gpu() else { return };
    let eight = plane_scene::input(4, 64, 48, 300);
    let deep = |lower| {
        let mut input = eight.clone();
        input.train.iter_mut().for_each(|view| *view = deepened(view, lower));
        input
    };
    assert!(deep(0).outline().train.iter().all(|(_, depth)| *depth == Depth::Sixteen));
    let first = run(&gpu, eight.clone(), &settings(12), Pacing::default());
    let same = run(&gpu, deep(0), &settings(12), Pacing::default());
    let other = run(&gpu, deep(128), &settings(12), Pacing::default());
    for (step, ((eight, deep), other)) in first.losses.iter().zip(&same.losses).zip(&other.losses).enumerate() {
        assert!((eight - deep).abs() < 2e-4, "step {step}: {eight} with 8 bits, {deep} with 16");
        assert!(step > 0 || eight != other && (eight - other).abs() < 4e-3, "{eight} and {other}");
    }
    assert!((first.losses[0] - same.losses[0]).abs() < 1e-6);
}

#[test]
fn pixels_that_do_not_fit_their_camera_are_refused() {
    let Some(gpu) = common::gpu() else { return };
    for photographs in [Residency::Resident, Residency::Streamed] {
        let mut input = plane_scene::input(3, 40, 30, 20);
        input.train[1].photograph = Supply::of(Pixels::Rgba8(vec![0; 40]));
        let pacing = Pacing { photographs, ..Pacing::default() };
        let trained = Trainer::new(&gpu, input, &settings(12), pacing, None).and_then(|mut trainer| {
            while trainer.next_message()?.is_some() {}
            Ok(())
        });
        let error = trained.expect_err("refused").to_string();
        assert!(error.contains("train1") && error.contains("40 bytes") && error.contains("4800"), "{error}");
    }
}
