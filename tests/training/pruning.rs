//! Dropping splats with little weight in every photograph.

use psrgs_vk::raster::{PLANES, Viewer};
use psrgs_vk::train::settings::Method;
use psrgs_vk::train::{Message, Pacing, Settings, Trainer};
use psrgs_vk::vk::{Gpu, Memory};

use super::common::{self, plane_scene};
use super::{assert_same, run, settings, stops_and_resumes_on};

const LEAST: f64 = 0.1;

/// Growth ends at step 40, so splats are dropped before that and before step 49.
fn pruned() -> Settings {
    let mut settings = settings(60);
    settings.density.densify_until = 40;
    settings.density.opacity_reset_interval = 0;
    settings.density.prune_weight = LEAST;
    settings.density.prune_weight_from = 0;
    settings
}

/// Number of splats with a weight below `LEAST` in every view.
fn faint(gpu: &Gpu, trainer: &mut Trainer, views: usize) -> usize {
    let model = trainer.model().expect("a model");
    let splats = model.len() as u32;
    let mut viewer = Viewer::new(gpu);
    let planes = viewer.upload(&model).expect("room");
    let weights = gpu.buffer("weights", 4 * u64::from(splats), Memory::Device).expect("room");
    gpu.write(&weights, &vec![0.0_f32; splats as usize]).expect("written");
    for view in &plane_scene::input(views, 64, 48, 300).train {
        let shot = trainer.shot(&view.camera);
        viewer.weigh(&planes, splats, &shot, &weights).expect("weights");
    }
    let weights: Vec<f32> = gpu.read(&weights).expect("weights");
    assert!(weights.iter().all(|w| (0.0..=0.99).contains(w)) && weights.iter().any(|w| *w > 0.3));
    weights.iter().filter(|w| f64::from(**w) < LEAST).count()
}

#[test]
fn splats_of_little_weight_are_dropped_when_growth_has_ended() {
    let Some(gpu) = common::gpu() else { return };
    let one = Pacing { events_in_flight: 1, ..Pacing::default() };
    let mut trainer = Trainer::new(&gpu, plane_scene::input(5, 64, 48, 300), &pruned(), one, None).expect("a trainer");
    let (mut due, mut count, mut steps) = (0, 0, Vec::new());
    while let Some(message) = trainer.next_message().expect("a message") {
        match message {
            Message::Step { step, splats, .. } => {
                assert!(steps.is_empty() || splats == count, "step {step}: {splats} splats, {count} were left");
                count = splats;
                if step == 39 {
                    due = faint(&gpu, &mut trainer, 5);
                }
            }
            Message::Density { step, splats, .. } => {
                assert!(step < 40);
                count = splats;
            }
            Message::Pruned { step, dropped, splats } => {
                if steps.is_empty() {
                    assert_eq!(dropped as usize, due, "dropped of {count}");
                }
                assert_eq!(splats + dropped, count, "step {step}");
                steps.push((step, dropped));
                count = splats;
            }
            _ => {}
        }
    }
    println!("dropped {steps:?}, left {count}");
    assert!(matches!(steps[..], [(40, first), (49, _)] if first > 10), "{steps:?}");
    assert!(due > 10 && (due as u32) < count, "{due} dropped, {count} left");
    let state = trainer.snapshot().expect("a snapshot").state;
    assert!(state.ids.len() == count as usize && state.params[0].len() == 3 * state.ids.len());
    for (plane, (_, row)) in state.moments[0].iter().zip(PLANES) {
        assert_eq!(plane.len(), row as usize * state.ids.len());
    }
    common::assert_no_messages(&gpu);
}

#[test]
fn dropping_splats_keeps_replays_and_resumed_runs_bit_equal() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(5, 64, 48, 300);
    let truth = run(&gpu, input.clone(), &pruned(), Pacing::default());
    let tight = Pacing { events_in_flight: 7, splat_capacity: 301, pair_capacity: 64, ..Pacing::default() };
    let forced = run(&gpu, input.clone(), &pruned(), tight);
    assert!(forced.grown >= 2);
    assert_same(&truth.state, &forced.state, "with little room");
    assert_eq!(truth.losses, forced.losses);
    stops_and_resumes_on(&gpu, &pruned(), &input, &[38, 39, 40, 48]);
    let without = run(&gpu, input.clone(), &Settings { density: settings(60).density, ..pruned() }, Pacing::default());
    assert!(without.state.ids.len() > truth.state.ids.len());
    let mut late = pruned();
    late.density.prune_weight_from = 50;
    let kept = run(&gpu, input, &late, Pacing::default());
    assert!(kept.state.ids.len() > truth.state.ids.len(), "splats were dropped after the last step");
}

/// Density changes at steps 10, 15, .. 40. Three passes over 5 views take 15 steps, so the lightest splats are dropped
/// before steps 16 and 31.
fn recycled(limit: u32) -> Settings {
    let mut settings = settings(60);
    (settings.density.densify_from, settings.density.densify_interval, settings.density.densify_until) = (9, 5, 45);
    settings.density.opacity_reset_interval = 0;
    settings.density.grad_threshold = 1e-7;
    settings.density.max_splats = Some(limit);
    settings.density.recycle_share = 0.25;
    settings
}

#[test]
fn the_lightest_splats_make_room_where_a_limit_holds_growth_up() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(5, 64, 48, 300);
    let one = Pacing { events_in_flight: 1, ..Pacing::default() };
    let mut trainer = Trainer::new(&gpu, input.clone(), &recycled(400), one, None).expect("a trainer");
    let (mut count, mut recycled_at, mut most) = (300, Vec::new(), 0);
    while let Some(message) = trainer.next_message().expect("a message") {
        match message {
            Message::Density { splats, .. } => (count, most) = (splats, most.max(splats)),
            Message::Pruned { step, dropped, splats } => {
                assert_eq!((dropped, splats), (count / 4, count - count / 4), "step {step}");
                recycled_at.push(step);
                count = splats;
            }
            _ => {}
        }
    }
    assert_eq!((recycled_at, most), (vec![16, 31], 400));
    assert!(count > 300, "dropped splats were not replaced: {count}");
    // A limit that is not reached drops nothing.
    let free = run(&gpu, input.clone(), &recycled(100_000), Pacing::default());
    let mut never = recycled(100_000);
    never.density.recycle_share = 0.0;
    assert_same(&free.state, &run(&gpu, input.clone(), &never, Pacing::default()).state, "below the limit");
    // Replays and resumed runs have the same bits.
    let truth = run(&gpu, input.clone(), &recycled(400), Pacing::default());
    let tight = Pacing { events_in_flight: 7, splat_capacity: 301, pair_capacity: 64, ..Pacing::default() };
    let forced = run(&gpu, input.clone(), &recycled(400), tight);
    assert!(forced.grown >= 1);
    assert_same(&truth.state, &forced.state, "with little room");
    stops_and_resumes_on(&gpu, &recycled(400), &input, &[14, 15, 16, 30]);
}

/// The limit is reached by the density change right before the step that may drop the lightest splats. With events in
/// flight, the host must not decide by the count before that change.
#[test]
fn a_limit_just_reached_is_seen_with_any_events_in_flight() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(5, 64, 48, 300);
    let mut settings = recycled(400);
    settings.density.densify_from = 14;
    let with = |events_in_flight| run(&gpu, input.clone(), &settings, Pacing { events_in_flight, ..Pacing::default() });
    let one = with(1);
    let mut never = settings.clone();
    never.density.recycle_share = 0.0;
    assert!(one.state != run(&gpu, input.clone(), &never, Pacing::default()).state, "nothing was dropped");
    for events in [2, 4, 7] {
        assert_same(&one.state, &with(events).state, &format!("{events} events in flight"));
    }
    stops_and_resumes_on(&gpu, &settings, &input, &[15, 16]);
}

#[test]
fn nothing_is_dropped_where_density_stays_as_it_is() {
    let Some(gpu) = common::gpu() else { return };
    let mut settings = pruned();
    settings.density.no_densify = true;
    let run = run(&gpu, plane_scene::input(3, 64, 48, 300), &settings, Pacing::default());
    assert_eq!(run.state.ids.len(), 300);
}

#[test]
fn without_room_to_weigh_them_splats_are_kept() {
    let Some(gpu) = common::gpu_with(|options| options.max_device_memory = Some(1 << 30)) else { return };
    // No other buffer may grow.
    let one = Pacing { events_in_flight: 1, splat_capacity: 20_000, pair_capacity: 400_000, ..Pacing::default() };
    let mut trainer = Trainer::new(&gpu, plane_scene::input(5, 64, 48, 300), &pruned(), one, None).expect("a trainer");
    let (mut filled, mut warned, mut last) = (Vec::new(), 0, 0);
    while let Some(message) = trainer.next_message().expect("a message") {
        match message {
            Message::Step { step: 39, .. } => {
                // The memory that steps and counters take for a moment stays free.
                for _ in 0..30 {
                    let tally = gpu.memory_use();
                    let half = ((tally.limit - tally.current) / 2) & !255;
                    if half > 16 << 10
                        && let Ok(buffer) = gpu.buffer("in the way", half, Memory::Device)
                    {
                        filled.push(buffer);
                    }
                }
            }
            // Free memory for scoring the last step.
            Message::Step { step: 55, .. } => filled.clear(),
            Message::Step { step, .. } => last = step,
            Message::Pruned { dropped, .. } => panic!("{dropped} dropped"),
            Message::Warning(text) => {
                assert!(text.contains("splats of little weight are kept") && text.contains("memory"), "{text}");
                warned += 1;
            }
            _ => {}
        }
    }
    assert!(warned == 2 && last == 60, "{warned} warnings, {last} steps");
}

/// A room around cameras that look at its middle. The splats of its walls are larger than a tenth of the cameras'
/// extent.
#[test]
fn what_lies_far_beyond_the_cameras_is_not_dropped_for_its_size() {
    let Some(gpu) = common::gpu() else { return };
    let left = |method: Method, share: Option<f64>| {
        let mut settings = Settings::default();
        method.apply(&mut settings, |_| false);
        settings.run.iterations = 60;
        settings.run.scale_schedule = true;
        settings.run.deterministic = true;
        settings.run.eval_every = 0;
        settings.density.prune_weight = 0.0;
        // So that splats are dropped for their size alone.
        settings.density.prune_unseen = false;
        settings.density.prune_opacity = 0.0;
        settings.density.prune_extent = share.unwrap_or(settings.density.prune_extent);
        let mut input = plane_scene::input(5, 64, 48, 300);
        input.extent = 1.0;
        run(&gpu, input, &settings, Pacing::default()).state.ids.len()
    };
    for method in [Method::Lean, Method::Psrgs, Method::PsrgsPaper] {
        assert!(left(method, None) >= 300, "{method}");
    }
    let (kept, dropped) = (left(Method::Lean, None), left(Method::Lean, Some(0.1)));
    assert!(dropped < kept / 2, "{dropped} of {kept} are left where size counts");
}
