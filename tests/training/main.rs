//! Whole trainings on a small scene in memory: training learns, repeats bit for bit, survives buffers that are too
//! small, and stops and resumes without a trace.

mod bands;
mod clouds;
#[path = "../common/mod.rs"]
mod common;
mod early;
mod exposed_world;
mod exposures;
mod harmonics;
mod host_actions;
mod methods;
mod photographs;
mod propagation;
mod pruning;
mod relocation;
mod visible_adam;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use common::plane_scene;
use psrgs_vk::dataset::Pixels;
use psrgs_vk::scene::Gaussians;
use psrgs_vk::train::settings::Shortcuts;
use psrgs_vk::train::{Checkpointed, Input, Message, Pacing, Restart, Settings, State, Trainer, View};
use psrgs_vk::vk::{DeviceKind, Gpu};

fn settings(iterations: u32) -> Settings {
    let mut s = Settings::default();
    s.run.iterations = iterations;
    s.run.deterministic = true;
    s.run.eval_every = 0;
    s.density.densify_from = 10;
    s.density.densify_until = iterations;
    s.density.densify_interval = 15;
    s.density.opacity_reset_interval = 40;
    s.model.sh_interval = 20;
    // A scene this small needs larger steps than the reference's.
    s.optimiser.lr_sh_base = 0.02;
    s.optimiser.lr_opacities = 0.1;
    s
}

struct Run {
    state: State,
    losses: Vec<f32>,
    grown: usize,
    changed: u32,
}

fn run(gpu: &Gpu, input: Input, settings: &Settings, pacing: Pacing) -> Run {
    let mut trainer = Trainer::new(gpu, input, settings, pacing, None).expect("trainer");
    let (mut losses, mut grown, mut changed) = (Vec::new(), 0, 0);
    while let Some(message) = trainer.next_message().expect("message") {
        match message {
            Message::Step { step, loss, .. } => {
                losses.truncate(step as usize - 1);
                losses.push(loss);
            }
            Message::Grown { .. } => grown += 1,
            Message::Density { cloned, split, pruned, .. } => changed += cloned + split + pruned,
            _ => {}
        }
    }
    let state = trainer.snapshot().expect("snapshot").state;
    Run { state, losses, grown, changed }
}

/// Equal bits, NaN included.
fn assert_same(a: &State, b: &State, what: &str) {
    assert_eq!(a.ids, b.ids, "{what}: ids");
    let bits = |v: &[f32]| v.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    let planes =
        |s: &State| -> Vec<[Vec<f32>; 8]> { [s.params.clone()].into_iter().chain(s.moments.clone()).collect() };
    assert_eq!(a.moments.len(), b.moments.len(), "{what}: planes of moments");
    for (n, (x, y)) in planes(a).iter().zip(planes(b)).enumerate() {
        for k in 0..8 {
            assert_eq!(bits(&x[k]), bits(&y[k]), "{what}: plane {k} of {}", ["params", "m", "v"][n]);
        }
    }
    assert_eq!(bits(&a.stats), bits(&b.stats), "{what}: statistics");
    assert_eq!(bits(&a.scores), bits(&b.scores), "{what}: scores");
}

#[test]
fn training_learns_and_changes_density() {
    let Some(gpu) = common::gpu() else { return };
    let run = run(&gpu, plane_scene::input(6, 64, 48, 300), &settings(80), Pacing::default());
    assert_eq!(run.losses.len(), 80);
    let mean = |x: &[f32]| x.iter().sum::<f32>() / x.len() as f32;
    let (first, last) = (mean(&run.losses[..12]), mean(&run.losses[28..40]));
    assert!(last < 0.8 * first, "loss {first} -> {last}");
    assert!(run.changed > 0, "density control did nothing");
}

#[test]
fn deterministic_runs_are_bit_equal() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(5, 64, 48, 300);
    let a = run(&gpu, input.clone(), &settings(60), Pacing::default());
    let b = run(&gpu, input, &settings(60), Pacing { events_in_flight: 7, ..Pacing::default() });
    assert_same(&a.state, &b.state, "second run");
    assert_eq!(a.losses, b.losses);
    assert!(a.changed > 0);
}

/// The separate steps, for devices that bind fewer buffers to a pass, train to the bits of the fused step.
#[test]
fn fused_and_separate_optimiser_steps_are_bit_equal() {
    let Some(gpu) = common::gpu() else { return };
    let Some(lesser) = common::gpu_with(|o| o.max_storage_buffers = Some(24)) else { return };
    if gpu.caps().kind != DeviceKind::Cpu {
        common::left_out("a GPU's compiler may round the gradients of the two forms differently");
        return;
    }
    let input = plane_scene::input(5, 64, 48, 300);
    let mut penalised = settings(60);
    penalised.optimiser.lambda_sh = 0.3;
    penalised.optimiser.lambda_opacity = 0.1;
    penalised.optimiser.lambda_scale = 0.1;
    penalised.optimiser.lambda_binary = 0.1;
    let fused = run(&gpu, input.clone(), &penalised, Pacing::default());
    let separate = run(&lesser, input.clone(), &penalised, Pacing::default());
    assert_same(&fused.state, &separate.state, "separate steps");
    assert_eq!(fused.losses, separate.losses);
    // Steps 20, 40 and 60 add a degree of harmonics. Before, higher degrees have no moments.
    let early = run(&gpu, input, &settings(19), Pacing::default()).state;
    assert!(early.moments[0][4].iter().any(|m| *m != 0.0) && early.moments[0][5..].iter().flatten().all(|m| *m == 0.0));
    assert!(fused.state.moments[0][5].iter().chain(&fused.state.moments[0][6]).any(|m| *m != 0.0));
}

#[test]
fn overflow_is_replayed_bit_equal_with_any_events_in_flight() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(5, 64, 48, 300);
    let large = Pacing { splat_capacity: 20_000, pair_capacity: 400_000, ..Pacing::default() };
    let truth = run(&gpu, input.clone(), &settings(60), large);
    assert_eq!(truth.grown, 0, "the large buffers were meant to suffice");
    for events_in_flight in [1, 2, 8] {
        let tight = Pacing { events_in_flight, splat_capacity: 301, pair_capacity: 64, ..Pacing::default() };
        let forced = run(&gpu, input.clone(), &settings(60), tight);
        assert!(forced.grown >= 2, "{events_in_flight} in flight: buffers grew {} times", forced.grown);
        assert_same(&truth.state, &forced.state, &format!("{events_in_flight} in flight"));
        assert_eq!(truth.losses, forced.losses);
    }
}

/// Rows of a state in the order of birth.
fn by_birth(state: &State) -> State {
    let mut order: Vec<usize> = (0..state.ids.len()).collect();
    order.sort_by_key(|i| state.ids[*i]);
    let rows = |plane: &[f32]| -> Vec<f32> {
        let width = plane.len() / order.len().max(1);
        order.iter().flat_map(|i| &plane[width * i..width * (i + 1)]).copied().collect()
    };
    let planes = |planes: &[Vec<f32>; 8]| std::array::from_fn(|k| rows(&planes[k]));
    State {
        params: planes(&state.params),
        ids: order.iter().map(|i| state.ids[*i]).collect(),
        moments: state.moments.iter().map(planes).collect(),
        stats: rows(&state.stats),
        ..state.clone()
    }
}

/// With sums in slots, the order in memory only matters for splats of equal depth: training continues alike from a
/// state and from the same state in the order of birth. A clone and its source stay in the order of birth.
#[test]
fn order_in_memory_changes_no_bit() {
    let Some(gpu) = common::gpu() else { return };
    // Few splats, so that no two overlapping splats have equal depths in any step: of such a pair the lower row is in
    // front. Of 300 splats in 60 steps, some have equal depths on one driver and none on another.
    let input = plane_scene::input(5, 64, 48, 70);
    for (max_splats, stop) in [(None, 6), (None, 18), (Some(92), 6)] {
        let mut s = settings(60);
        s.density.grad_threshold = 5e-5;
        s.density.max_splats = max_splats;
        let start = |pacing: Pacing, restart: Option<Restart>| {
            Trainer::new(&gpu, input.clone(), &s, pacing, restart).expect("trainer")
        };
        // Changes of density are after steps 15, 30 and 45.
        let mut first = start(Pacing { events_in_flight: 1, ..Pacing::default() }, None);
        while !matches!(first.next_message().expect("message"), Some(Message::Step { step, .. }) if step == stop) {}
        let restart = first.snapshot().expect("snapshot");
        let from = |state: State| {
            let mut trainer = start(Pacing::default(), Some(Restart { state, ..restart.clone() }));
            let (mut losses, mut changed) = (BTreeMap::new(), 0);
            while let Some(message) = trainer.next_message().expect("message") {
                match message {
                    Message::Step { step, loss, .. } => drop(losses.insert(step, loss.to_bits())),
                    Message::Density { cloned, split, pruned, .. } => changed += cloned + split + pruned,
                    _ => {}
                }
            }
            (trainer.snapshot().expect("snapshot").state, losses, changed)
        };
        let born = by_birth(&restart.state);
        assert!(born.ids.is_sorted() && !restart.state.ids.is_sorted());
        let (birth, losses, changed) = from(born);
        let (morton, want, _) = from(restart.state.clone());
        assert!(changed >= 20, "{changed} rows changed");
        assert_same(&birth, &morton, "order of birth");
        assert_eq!(losses, want);
        assert_eq!(birth.counters, morton.counters);
    }
}

#[test]
fn stopped_and_resumed_is_bit_equal() {
    let Some(gpu) = common::gpu() else { return };
    stops_and_resumes(&gpu, &settings(60));
}

/// Random rounding is keyed by step and splat: a resumed run rounds as an undisturbed run.
#[test]
fn stopped_and_resumed_is_bit_equal_with_shortcuts() {
    let Some(gpu) = common::gpu() else { return };
    stops_and_resumes(&gpu, &fast_settings(60));
}

fn fast_settings(iterations: u32) -> Settings {
    Settings { shortcuts: Shortcuts { moment_bits: 16, ..Shortcuts::default() }, ..settings(iterations) }
}

#[test]
fn shortcuts_learn_nearly_the_same() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(6, 64, 48, 300);
    let fixed = |s: Settings| {
        let mut s = s;
        s.density.no_densify = true;
        run(&gpu, input.clone(), &s, Pacing::default())
    };
    let (exact, fast) = (fixed(settings(120)), fixed(fast_settings(120)));
    let last = |run: &Run| run.losses[108..].iter().sum::<f32>() / 12.0;
    assert!(last(&exact) < 0.6 * exact.losses[0], "it learns");
    assert!((last(&fast) / last(&exact) - 1.0).abs() < 0.05, "{} and {}", last(&fast), last(&exact));
    let most = |run: &Run| run.state.params[5].iter().fold(0.0f32, |m, v| m.max(v.abs()));
    assert!((0.5..1.5).contains(&(most(&fast) / most(&exact))), "{} and {}", most(&fast), most(&exact));
    assert_eq!((exact.state.moments.len(), fast.state.moments.len()), (2, 1));
}

#[test]
fn a_device_without_room_for_the_shortcuts_says_so() {
    let Some(gpu) = common::gpu_with(|o| o.max_storage_buffers = Some(24)) else { return };
    let input = plane_scene::input(3, 64, 48, 300);
    let mut sparse = settings(5);
    sparse.model.sh_share = 0.5;
    let Err(error) = Trainer::new(&gpu, input.clone(), &sparse, Pacing::default(), None) else {
        panic!("30 buffers of the optimiser were bound")
    };
    assert!(error.to_string().contains("`sh-share`") && error.to_string().contains("30"), "{error}");
    // With both moments in a word, the optimiser has 22 buffers.
    assert_eq!(run(&gpu, input, &fast_settings(5), Pacing::default()).losses.len(), 5);
}

#[test]
fn a_state_with_other_moments_is_refused() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(3, 64, 48, 300);
    let mut trainer = Trainer::new(&gpu, input.clone(), &fast_settings(5), Pacing::default(), None).expect("trainer");
    while trainer.next_message().expect("message").is_some() {}
    let restart = trainer.snapshot().expect("snapshot");
    let Err(error) = Trainer::new(&gpu, input, &settings(10), Pacing::default(), Some(restart)) else {
        panic!("packed moments were taken for others")
    };
    assert!(error.to_string().contains("planes of moments"), "{error}");
}

fn stops_and_resumes(gpu: &Gpu, settings: &Settings) {
    // 15, 30, 45: density changes; 40: opacity reset; the others lie between.
    stops_and_resumes_on(gpu, settings, &plane_scene::input(5, 64, 48, 300), &[1, 14, 15, 29, 40, 44, 59]);
}

fn stops_and_resumes_on(gpu: &Gpu, settings: &Settings, input: &Input, stops: &[u32]) {
    let truth = run(gpu, input.clone(), settings, Pacing::default());
    for &stop in stops {
        let mut first = Trainer::new(gpu, input.clone(), settings, Pacing::default(), None).expect("trainer");
        loop {
            match first.next_message().expect("message") {
                Some(Message::Step { step, .. }) if step == stop => break,
                Some(_) => {}
                None => panic!("ended before step {stop}"),
            }
        }
        let restart = first.snapshot().expect("snapshot");
        assert!(restart.step >= stop);
        let kept = Checkpointed::new(restart, settings).expect("settings");
        let sections = kept.to_checkpoint().expect("sections");
        drop(first);
        let restart = Checkpointed::from_checkpoint(&sections).expect("checkpoint").restart;
        let mut second = Trainer::new(gpu, input.clone(), settings, Pacing::default(), Some(restart)).expect("trainer");
        while second.next_message().expect("message").is_some() {}
        assert_same(&truth.state, &second.snapshot().expect("snapshot").state, &format!("resumed near {stop}"));
    }
}

#[test]
fn a_stop_near_a_scoring_leaves_no_gap_in_the_curve() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(5, 64, 48, 300);
    let mut s = settings(30);
    s.run.eval_every = 10;
    let scored = |trainer: &Trainer| trainer.history().quality.clone();
    let start = |restart| Trainer::new(&gpu, input.clone(), &s, Pacing::default(), restart).expect("trainer");
    let to_the_end = |trainer: &mut Trainer| while trainer.next_message().expect("message").is_some() {};
    let mut whole = start(None);
    to_the_end(&mut whole);
    assert_eq!(scored(&whole).iter().map(|q| q.0).collect::<Vec<_>>(), [10, 20, 30]);
    for stop in 7..=12 {
        let mut first = start(None);
        while !matches!(first.next_message().expect("message"), Some(Message::Step { step, .. }) if step == stop) {}
        let mut second = start(Some(first.snapshot().expect("snapshot")));
        to_the_end(&mut second);
        let same = scored(&whole).iter().zip(scored(&second)).filter(|(a, b)| (a.0, a.1) == (b.0, b.1)).count();
        assert_eq!(same, 3, "stopped at {stop}: {:?}", scored(&second));
    }
}

#[test]
fn test_photographs_do_not_reach_the_model() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(5, 64, 48, 300);
    let mut noisy = input.clone();
    for view in &mut noisy.held_out {
        let noise = |k: u32| if k % 4 == 3 { 255 } else { k.wrapping_mul(2_654_435_761) as u8 };
        let bytes = 4 * view.camera.width * view.camera.height;
        *view = View::new(&view.name, view.camera, Pixels::Rgba8((0..bytes).map(noise).collect()));
    }
    let mut s = settings(50);
    s.run.eval_every = 20;
    let a = run(&gpu, input, &s, Pacing::default());
    let b = run(&gpu, noisy, &s, Pacing::default());
    assert_same(&a.state, &b.state, "noise in the held-out photographs");
}

#[test]
fn empty_culled_and_pruned_models_train_on() {
    let Some(gpu) = common::gpu() else { return };
    let mut behind = plane_scene::splats(50);
    behind.means.chunks_exact_mut(3).for_each(|p| p[2] = 100.0);
    let mut faint = plane_scene::splats(50);
    faint.opacities.fill(-9.0);
    for (what, initial) in [("none", Gaussians::zeros(0)), ("all culled", behind), ("all pruned", faint)] {
        let input = Input { initial, ..plane_scene::input(3, 40, 30, 0) };
        let run = run(&gpu, input, &settings(40), Pacing::default());
        assert_eq!(run.losses.len(), 40, "{what}");
        assert!(run.losses.iter().all(|l| l.is_finite()), "{what}");
        if what == "all pruned" {
            assert_eq!(run.state.splats(), 0);
        }
    }
}

#[test]
fn two_engines_in_one_process_do_not_disturb_each_other() {
    let (Some(one), Some(two)) = (common::gpu(), common::gpu()) else { return };
    let input = plane_scene::input(4, 48, 40, 200);
    let alone = run(&one, input.clone(), &settings(30), Pacing::default());
    let mut a = Trainer::new(&one, input.clone(), &settings(30), Pacing::default(), None).expect("trainer");
    let mut b = Trainer::new(&two, input, &settings(30), Pacing::default(), None).expect("trainer");
    loop {
        let (x, y) = (a.next_message().expect("a"), b.next_message().expect("b"));
        if x.is_none() && y.is_none() {
            break;
        }
    }
    assert_same(&alone.state, &a.snapshot().expect("a").state, "first engine");
    assert_same(&alone.state, &b.snapshot().expect("b").state, "second engine");
}

#[test]
fn a_step_is_scored_before_its_density_change_and_opacity_reset() {
    let Some(gpu) = common::gpu() else { return };
    let mut settings = settings(60);
    settings.run.eval_every = 5;
    let mut trainer =
        Trainer::new(&gpu, plane_scene::input(6, 64, 48, 300), &settings, Pacing::default(), None).expect("trainer");
    let (mut scores, mut done) = (Vec::new(), Vec::new());
    while let Some(message) = trainer.next_message().expect("message") {
        match message {
            Message::Evaluated { step, quality, .. } => {
                assert!(!done.contains(&step), "step {step} was scored after what follows it");
                scores.push((step, quality.psnr));
            }
            Message::Density { step, .. } | Message::OpacityReset { step } => done.push(step),
            _ => {}
        }
    }
    // Every fifth step once, among them 15, 30, 45 (density changes) and 40 (a reset).
    assert_eq!(scores.iter().map(|(step, _)| *step).collect::<Vec<_>>(), (1..=12).map(|k| 5 * k).collect::<Vec<_>>());
    assert!(done.contains(&30) && done.contains(&40), "{done:?}");
}

/// A stop request gives up a scoring. The resumed training scores the saved state, and its curves equal those of an
/// undisturbed run.
#[test]
fn scoring_that_is_given_up_is_done_when_the_training_goes_on() {
    let Some(gpu) = common::gpu() else { return };
    let mut settings = settings(20);
    settings.run.eval_every = 5;
    let trainer = |restart| {
        let input = plane_scene::input(6, 64, 48, 300);
        Trainer::new(&gpu, input, &settings, Pacing::default(), restart).expect("trainer")
    };
    let to_the_end = |mut trainer: Trainer| {
        while trainer.next_message().expect("message").is_some() {}
        (trainer.history().quality.clone(), trainer.snapshot().expect("snapshot").state)
    };
    let (scores, end) = to_the_end(trainer(None));
    // In the middle of the training, and after the last step.
    for stop in [10, 20] {
        let asked = Arc::new(AtomicBool::new(false));
        let mut first = trainer(None);
        let heard = asked.clone();
        first.give_up_scoring_when(move || heard.load(Ordering::SeqCst));
        loop {
            match first.next_message().expect("message").expect("no end yet") {
                Message::Step { step, .. } if step == stop => asked.store(true, Ordering::SeqCst),
                Message::ScoringGivenUp { step } => break assert_eq!(step, stop),
                Message::Evaluated { step, .. } => assert!(step < stop, "scored after all"),
                _ => {}
            }
        }
        let restart = first.snapshot().expect("snapshot");
        assert_eq!(restart.step, stop);
        let (again, state) = to_the_end(trainer(Some(restart)));
        let points = |all: &[(u32, f64, f64, f64)]| all.iter().map(|q| (q.0, q.1, q.2)).collect::<Vec<_>>();
        assert_eq!(points(&again), points(&scores), "stopped at {stop}");
        assert_same(&end, &state, "given up");
    }
}
