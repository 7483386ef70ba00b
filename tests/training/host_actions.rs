//! What the host does to the splats once: the skirt, splats where no photograph looks, which are added late; and the
//! early split of splats that are wider than the local wavelength.

use std::sync::Arc;

use psrgs_vk::scene::Gaussians;
use psrgs_vk::train::settings::DepthPrior;
use psrgs_vk::train::{Input, Message, Pacing, Settings, Trainer};
use psrgs_vk::vk::Gpu;

use super::common::{gpu, plane_scene};
use super::{assert_same, settings, stops_and_resumes_on};

/// The skirt comes before this step of 60: after growth, which ends at step 40, and after four fifths of the steps.
const BEFORE: u32 = 49;
const SPLATS: usize = 40;

fn with_skirt() -> (Settings, Input) {
    let mut s = settings(60);
    s.density.densify_until = 40;
    s.density.prune_weight = 0.02;
    s.density.prune_weight_from = 1;
    s.geometry.depth_prior = DepthPrior::Stereo;
    s.geometry.stereo_skirt = 0.25;
    let mut input = plane_scene::input(5, 64, 48, 300);
    // Far outside the photographs, where splats would be dropped for their weight.
    let mut skirt: Gaussians = plane_scene::splats(SPLATS);
    skirt.means.chunks_exact_mut(3).for_each(|mean| mean[0] += 100.0);
    input.optional.skirt = Some(Arc::new(skirt));
    (s, input)
}

fn far(state: &psrgs_vk::train::State) -> usize {
    state.params[0].chunks_exact(3).filter(|mean| mean[0] > 50.0).count()
}

#[test]
fn a_skirt_comes_once_after_what_would_drop_it_and_stays() {
    let Some(gpu) = gpu() else { return };
    let (settings, input) = with_skirt();
    let splats = input.initial.len() as u32;
    // Small capacities and many events in flight.
    let tight = Pacing { events_in_flight: 7, splat_capacity: splats + 1, pair_capacity: 64, ..Pacing::default() };
    let mut states = Vec::new();
    for pacing in [Pacing::default(), tight] {
        let mut trainer = Trainer::new(&gpu, input.clone(), &settings, pacing, None).expect("trainer");
        let (mut added_at, mut last) = (Vec::new(), splats);
        while let Some(message) = trainer.next_message().expect("message") {
            match message {
                Message::Skirted { step, added, splats } => {
                    assert_eq!(splats, last + added);
                    added_at.push((step, added));
                    last = splats;
                }
                Message::Density { splats, .. } | Message::Pruned { splats, .. } => last = splats,
                Message::Step { step, splats, .. } => assert_eq!(splats, last, "step {step}"),
                _ => {}
            }
        }
        assert_eq!(added_at, [(BEFORE, SPLATS as u32)]);
        states.push(trainer.snapshot().expect("snapshot").state);
    }
    assert_eq!(far(&states[0]), SPLATS);
    assert_same(&states[0], &states[1], "with little room");
    // No more splats than the limit.
    let mut limited = settings;
    limited.density.max_splats = Some(splats);
    let mut trainer = Trainer::new(&gpu, input, &limited, Pacing::default(), None).expect("trainer");
    while trainer.next_message().expect("message").is_some() {}
    assert!(trainer.snapshot().expect("snapshot").state.ids.len() <= splats as usize);
}

#[test]
fn a_run_with_a_skirt_stops_and_resumes_bit_equal() {
    let Some(gpu) = gpu() else { return };
    let (settings, input) = with_skirt();
    stops_and_resumes_on(&gpu, &settings, &input, &[BEFORE - 2, BEFORE - 1, BEFORE, BEFORE + 3]);
}

#[test]
fn settings_without_one_have_none() {
    let Some(gpu) = gpu() else { return };
    let (mut settings, input) = with_skirt();
    settings.geometry.stereo_skirt = 0.0;
    let mut trainer = Trainer::new(&gpu, input, &settings, Pacing::default(), None).expect("trainer");
    while trainer.next_message().expect("message").is_some() {}
    assert_eq!(far(&trainer.snapshot().expect("snapshot").state), 0);
}

/// The split comes before this step of 40: after the first density change, at step 15.
const SPLIT_BEFORE: u32 = 16;

fn with_split(factor: f64) -> (Settings, Input) {
    let mut s = settings(40);
    s.density.split_wavelength = factor;
    s.density.split_wavelength_at = 0.3;
    (s, plane_scene::input(5, 64, 48, 300))
}

/// The steps before which splats were split, with the splats split and the splats before and after; and the last state.
fn splits(gpu: &Gpu, s: &Settings, input: Input, pacing: Pacing) -> (Vec<(u32, [u32; 3])>, psrgs_vk::train::State) {
    let mut last = input.initial.len() as u32;
    let mut trainer = Trainer::new(gpu, input, s, pacing, None).expect("trainer");
    let mut found = Vec::new();
    while let Some(message) = trainer.next_message().expect("message") {
        match message {
            Message::SplitWide { step, split, splats } => {
                found.push((step, [split, last, splats]));
                last = splats;
            }
            Message::Density { splats, .. } => last = splats,
            Message::Step { step, splats, .. } => assert_eq!(splats, last, "step {step}"),
            _ => {}
        }
    }
    (found, trainer.snapshot().expect("snapshot").state)
}

#[test]
fn wide_splats_are_split_once_within_the_limits() {
    let Some(gpu) = gpu() else { return };
    let (s, input) = with_split(1.0);
    let (found, state) = splits(&gpu, &s, input.clone(), Pacing::default());
    let [(SPLIT_BEFORE, [split, before, after])] = found[..] else { panic!("{found:?}") };
    assert!(split > 50 && after >= before + split && after <= before + 3 * split, "{found:?}");
    let splats = input.initial.len() as u32;
    let tight = Pacing { events_in_flight: 7, splat_capacity: splats + 1, pair_capacity: 64, ..Pacing::default() };
    let (again, with_little_room) = splits(&gpu, &s, input.clone(), tight);
    assert_eq!(again, found);
    assert_same(&state, &with_little_room, "with little room");
    // As many as the limit has room for, where nothing else grows; with no room, none.
    for room in [10, 0] {
        let mut limited = s.clone();
        limited.density.densify_from = 100;
        limited.density.max_splats = Some(splats + room);
        let (found, state) = splits(&gpu, &limited, input.clone(), Pacing::default());
        let [(13, [split, _, after])] = found[..] else { panic!("{found:?}") };
        assert!(after <= splats + room && after + 3 > splats + room && (split > 0) == (room > 0), "{found:?}");
        assert_eq!(state.ids.len() as u32, after);
    }
}

#[test]
fn a_run_with_a_split_stops_and_resumes_bit_equal() {
    let Some(gpu) = gpu() else { return };
    let (settings, input) = with_split(1.0);
    let around = [SPLIT_BEFORE - 2, SPLIT_BEFORE - 1, SPLIT_BEFORE, SPLIT_BEFORE + 3];
    stops_and_resumes_on(&gpu, &settings, &input, &around);
}

#[test]
fn a_width_that_no_splat_has_splits_none() {
    let Some(gpu) = gpu() else { return };
    let ((without, input), (s, _)) = (with_split(0.0), with_split(1e3));
    let (none, plain) = splits(&gpu, &without, input.clone(), Pacing::default());
    let (found, state) = splits(&gpu, &s, input, Pacing::default());
    assert!(none.is_empty() && matches!(found[..], [(SPLIT_BEFORE, [0, before, after])] if before == after));
    assert_same(&plain, &state, "with a width that no splat has");
}
