//! Spherical harmonics above degree 1 for a share of the splats.

use psrgs_vk::pass::counters;
use psrgs_vk::raster::{GradientSum, PLANES, SH_HIGHER, Variants, Viewer};
use psrgs_vk::train::{Engine, Message, Pacing, Settings, State, Trainer};

use super::common::{self, plane_scene};
use super::{assert_same, run, settings, stops_and_resumes_on};

const SHARE: f64 = 0.3;

/// Growth ends at step 40, which settles the splats with all harmonics. Splats of little weight are dropped then and
/// before step 49.
fn limited() -> Settings {
    let mut settings = settings(60);
    settings.density.densify_until = 40;
    settings.density.opacity_reset_interval = 0;
    settings.density.prune_weight = 0.1;
    settings.density.prune_weight_from = 0;
    settings.model.sh_interval = 10;
    settings.model.sh_share = SHARE;
    settings
}

/// Rows of the upper planes, of parameters and moments, that hold more than zeros.
fn used(state: &State) -> Vec<bool> {
    let planes = std::iter::once(&state.params).chain(&state.moments).flat_map(|planes| &planes[SH_HIGHER..]);
    let mut used = vec![false; state.ids.len()];
    for plane in planes {
        assert_eq!(plane.len(), 12 * state.ids.len());
        for (row, used) in plane.chunks_exact(12).zip(&mut used) {
            *used |= row.iter().any(|v| v.to_bits() != 0);
        }
    }
    used
}

#[test]
fn the_asked_share_of_splats_has_harmonics_after_growth() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(5, 64, 48, 300);
    let one = Pacing { events_in_flight: 1, ..Pacing::default() };
    let mut trainer = Trainer::new(&gpu, input, &limited(), one, None).expect("a trainer");
    let (mut settled, mut dropped_after, mut before) = (None, 0, Vec::new());
    while let Some(message) = trainer.next_message().expect("a message") {
        match message {
            Message::Step { step: 38, .. } => {
                let state = trainer.snapshot().expect("a snapshot").state;
                assert!(!used(&state).contains(&true), "a splat has higher harmonics during growth");
                assert_eq!(state.counters[counters::PLAIN], u32::MAX);
            }
            Message::HarmonicsSettled { step, full, splats } => {
                assert_eq!((step, full), (40, (SHARE * f64::from(splats)) as u32));
                assert!(settled.replace((full, splats)).is_none(), "settled twice");
                before = trainer.snapshot().expect("a snapshot").state.ids;
            }
            Message::Pruned { step, dropped, .. } if step > 40 => dropped_after += dropped,
            _ => {}
        }
    }
    let (full, splats) = settled.expect("it was settled");
    assert!(dropped_after > 0, "splats were dropped afterwards too");
    let state = trainer.snapshot().expect("a snapshot").state;
    let left = counters::full_rows(&state.counters);
    assert!(
        left as u32 <= full && left as u32 >= full - dropped_after && state.ids.len() as u32 == splats - dropped_after
    );
    let used = used(&state);
    let with: usize = used.iter().filter(|used| **used).count();
    assert!(used[left..].iter().all(|used| !used) && 10 * with > 9 * left, "{with} of {left} rows are used");
    // Identities tell which rows were dropped; the others keep their order.
    let kept: Vec<u32> = before.iter().copied().filter(|id| state.ids.contains(id)).collect();
    assert_eq!(kept, state.ids);
    // Missing coefficients are rendered as zeros: the model that was read back gives the same render.
    let model = trainer.model().expect("a model");
    let camera = plane_scene::input(5, 64, 48, 300).train[0].camera;
    let mut viewer = Viewer::new(&gpu);
    let planes = viewer.upload(&model).expect("room");
    let shot = trainer.shot(&camera);
    assert_eq!(shot.projection.sh_degree, 3);
    let want = viewer.render(&planes, model.len() as u32, &shot, false).expect("a picture");
    assert_eq!(trainer.picture(&camera).expect("a picture").rgbt, want.rgbt);
    common::assert_no_messages(&gpu);
}

#[test]
fn a_live_view_of_such_a_model_is_what_it_is() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(5, 64, 48, 300);
    let camera = input.train[1].camera;
    let one = Pacing { events_in_flight: 1, ..Pacing::default() };
    let mut trainer = Trainer::new(&gpu, input, &limited(), one, None).expect("a trainer");
    let mut viewer = Viewer::new(&gpu);
    let mut seen = 0;
    while let Some(message) = trainer.next_message().expect("a message") {
        if let Message::Step { step: step @ (30 | 45 | 60), .. } = message {
            trainer.drain_to_step().expect("settled");
            let shot = trainer.shot(&camera);
            let live = trainer.live_model();
            let picture = loop {
                let ticket = viewer.submit_live(&live, &shot, false, Default::default()).expect("submitted");
                gpu.wait(ticket).expect("done");
                if let Some(picture) = viewer.collect().expect("a picture") {
                    break picture;
                }
            };
            assert_eq!(picture.rgbt, trainer.picture(&camera).expect("a picture").rgbt, "step {step}");
            seen += 1;
        }
    }
    assert_eq!(seen, 3);
}

#[test]
fn settling_changes_no_bit_of_a_replay_or_of_a_resumed_run() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(5, 64, 48, 300);
    let truth = run(&gpu, input.clone(), &limited(), Pacing::default());
    let tight = Pacing { events_in_flight: 7, splat_capacity: 301, pair_capacity: 64, ..Pacing::default() };
    let forced = run(&gpu, input.clone(), &limited(), tight);
    assert!(forced.grown >= 2);
    assert_same(&truth.state, &forced.state, "with little room");
    assert_eq!(truth.losses, forced.losses);
    stops_and_resumes_on(&gpu, &limited(), &input, &[20, 39, 40, 48]);
    // Packed moments move with their rows.
    let mut packed = limited();
    packed.shortcuts.moment_bits = 16;
    let truth = run(&gpu, input.clone(), &packed, Pacing::default());
    assert!(used(&truth.state).contains(&true));
    stops_and_resumes_on(&gpu, &packed, &input, &[39, 45]);
    // A share of 0, and a fixed set of splats.
    let mut none = limited();
    none.model.sh_share = 0.0;
    let state = run(&gpu, input.clone(), &none, Pacing::default()).state;
    assert!(!used(&state).contains(&true) && counters::full_rows(&state.counters) == 0);
    let mut still = limited();
    still.density.no_densify = true;
    let state = run(&gpu, input, &still, Pacing::default()).state;
    assert_eq!((state.ids.len(), counters::full_rows(&state.counters)), (300, 90));
}

/// Splats without higher harmonics may have been dropped later, so that the splats with them exceed the share.
#[test]
fn a_state_with_more_of_them_than_the_share_has_room() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(3, 64, 48, 300);
    let mut whole = limited();
    whole.density.prune_weight = 0.0;
    let mut state = run(&gpu, input.clone(), &whole, Pacing::default()).state;
    let full = counters::full_rows(&state.counters);
    let left = full + 5;
    assert!(left < state.ids.len() / 2);
    for planes in std::iter::once(&mut state.params).chain(&mut state.moments) {
        planes.iter_mut().zip(PLANES).for_each(|(plane, (_, width))| plane.truncate(width as usize * left));
    }
    state.ids.truncate(left);
    state.stats.truncate(4 * left);
    (state.counters[counters::SPLATS], state.counters[counters::PLAIN]) = (left as u32, 5);
    let tight = Pacing { splat_capacity: left as u32, ..Pacing::default() };
    let variants = Variants::choose(&gpu, true);
    let engine = Engine::new(&gpu, &input, &whole, variants, tight, Some(state.clone())).expect("an engine");
    assert_same(&engine.state().expect("a state"), &state, "as it was");
    assert!(used(&state)[..full].iter().filter(|used| **used).count() > full / 2);
}

#[test]
fn memory_is_that_of_the_share() {
    let Some(gpu) = common::gpu_with(|o| o.canaries = false) else { return };
    let input = plane_scene::input(2, 64, 48, 300);
    let pacing = Pacing { splat_capacity: 100_000, ..Pacing::default() };
    let variants = Variants { gradients: GradientSum::CompareAndSwap, ..Variants::choose(&gpu, true) };
    let cost = |share: f64| {
        let settings = Settings {
            model: psrgs_vk::train::settings::Model { sh_share: share, ..Default::default() },
            ..Default::default()
        };
        Engine::new(&gpu, &input, &settings, variants, pacing, None).expect("an engine").memory().per_splat
    };
    let upper = 3.0 * 4.0 * PLANES[SH_HIGHER..].iter().map(|(_, width)| f64::from(*width)).sum::<f64>();
    for share in [0.0, 0.25, 0.5] {
        let saved = cost(1.0) - cost(share);
        assert!((saved - (1.0 - share) * upper).abs() < 0.01, "{share}: {saved} bytes less, of {upper}");
    }
    assert_eq!(upper, 432.0);
}
