//! `--visible-adam`: optimiser steps of visible splats alone.

use psrgs_vk::pass::counters;
use psrgs_vk::train::settings::Settings;
use psrgs_vk::train::{Input, Pacing};

use super::common::{self, plane_scene};
use super::{Run, assert_same, run, settings, stops_and_resumes_on};

/// Splats from this index on are below the ground, where no camera looks.
const SEEN: usize = 200;

/// The plane scene with 300 splats, a third of which is out of sight.
fn input() -> Input {
    let mut input = plane_scene::input(5, 64, 48, 300);
    for mean in input.initial.means.chunks_exact_mut(3).skip(SEEN) {
        mean[2] -= 500.0;
    }
    input
}

fn visible(iterations: u32) -> Settings {
    let mut settings = settings(iterations);
    settings.shortcuts.visible_adam = true;
    settings
}

fn fixed(mut settings: Settings) -> Settings {
    settings.density.no_densify = true;
    settings
}

#[test]
fn splats_out_of_sight_rest_and_the_others_learn() {
    let Some(gpu) = common::gpu() else { return };
    let input = input();
    let run = run(&gpu, input.clone(), &fixed(visible(60)), Pacing::default());
    let row = |plane: &[f32], i: u32, width: usize| plane[i as usize * width..][..width].to_vec();
    let mut moved = 0;
    for (at, id) in run.state.ids.iter().enumerate() {
        let (before, after) = (row(&input.initial.means, *id, 3), row(&run.state.params[0], at as u32, 3));
        let first = row(&run.state.moments[0][0], at as u32, 3);
        if *id as usize >= SEEN {
            assert_eq!((before, first), (after, vec![0.0; 3]), "splat {id} was never seen");
        } else {
            moved += usize::from(before != after);
        }
    }
    assert!(moved > SEEN / 2, "{moved} moved");
    let mean = |losses: &[f32]| losses.iter().sum::<f32>() / losses.len() as f32;
    let (first, last) = (mean(&run.losses[..10]), mean(&run.losses[50..]));
    assert!(last < 0.8 * first, "loss {first} -> {last}");
}

/// Where every photograph shows every splat, no step is left out, and none is made up for.
#[test]
fn with_everything_in_sight_it_is_the_same_bits() {
    let Some(gpu) = common::gpu() else { return };
    let mut input = plane_scene::input(4, 96, 72, 40);
    for mean in input.initial.means.chunks_exact_mut(3) {
        mean.iter_mut().for_each(|x| *x *= 0.2);
    }
    let of = |settings: Settings| -> Run { run(&gpu, input.clone(), &fixed(settings), Pacing::default()) };
    let (mut all, mut listed) = (of(settings(25)), of(visible(25)));
    assert_eq!(all.state.counters[counters::VISIBLE], 40, "the last photograph shows them all");
    // The fourth column has the last step of a splat.
    for run in [&mut all, &mut listed] {
        run.state.stats.iter_mut().skip(3).step_by(4).for_each(|last| *last = 0.0);
    }
    assert_same(&all.state, &listed.state, "all in sight");
    assert_eq!(all.losses, listed.losses);
}

/// Distance of two runs' final means, relative to the distance of means from their start.
fn apart(one: &Run, other: &Run, input: &Input) -> f64 {
    let means = |run: &Run| {
        let mut rows: Vec<(u32, &[f32])> = run.state.ids.iter().copied().zip(run.state.params[0].chunks(3)).collect();
        rows.sort_by_key(|(id, _)| *id);
        rows.iter().flat_map(|(_, mean)| mean.to_vec()).collect::<Vec<f32>>()
    };
    let distance = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(x, y)| f64::from((x - y).abs())).sum::<f64>();
    let (one, other) = (means(one), means(other));
    distance(&one, &other) / distance(&one, &input.initial.means)
}

/// Left out steps are made up for: the model ends near the model of steps of all splats. The rest are moves that are
/// expected in advance.
#[test]
fn splats_out_of_view_end_where_steps_of_all_splats_lead() {
    let Some(gpu) = common::gpu() else { return };
    // Narrow photographs, each of which shows a part of the ground.
    let mut input = plane_scene::input(5, 64, 48, 300);
    for view in &mut input.train {
        (view.camera.fx, view.camera.fy) = (2.0 * view.camera.fx, 2.0 * view.camera.fy);
    }
    let of = |settings: Settings| run(&gpu, input.clone(), &fixed(settings), Pacing::default());
    let (all, listed) = (of(settings(120)), of(visible(120)));
    let seen = all.state.counters[counters::VISIBLE];
    assert!(seen < 200, "{seen} of 300 splats seen");
    let off = apart(&all, &listed, &input);
    println!("{seen} of 300 splats seen; apart by {off:.4} of the way");
    assert!(off > 0.0 && off < 0.15, "apart by {off} of the way");
}

/// A step of several views moves all splats.
#[test]
fn all_are_caught_up_with_before_a_step_of_several_views() {
    let Some(gpu) = common::gpu() else { return };
    let mut settings = visible(60);
    settings.texture.lambda_perceptual = 0.1;
    (settings.texture.perceptual_every, settings.texture.perceptual_views) = (10, 3);
    settings.check().unwrap();
    stops_and_resumes_on(&gpu, &settings, &input(), &[14, 29, 44]);
}

#[test]
fn stops_resumes_and_replays_are_bit_equal() {
    let Some(gpu) = common::gpu() else { return };
    let input = input();
    stops_and_resumes_on(&gpu, &visible(60), &input, &[14, 29, 44]);
    let mut packed = visible(60);
    packed.shortcuts.moment_bits = 16;
    stops_and_resumes_on(&gpu, &packed, &input, &[15, 40]);
    // With too little room, so that lost events are replayed.
    let truth = run(&gpu, input.clone(), &visible(60), Pacing::default());
    let tight = Pacing { events_in_flight: 7, splat_capacity: 301, pair_capacity: 64, ..Pacing::default() };
    let forced = run(&gpu, input, &visible(60), tight);
    assert!(forced.grown >= 2 && truth.changed > 0);
    assert_same(&truth.state, &forced.state, "with little room");
    assert_eq!(truth.losses, forced.losses);
}
