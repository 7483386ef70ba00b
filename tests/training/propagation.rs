//! Depths that are propagated during training, and the splats that they add.

use std::sync::Arc;

use psrgs_vk::dataset::HostShare;
use psrgs_vk::scene::Gaussians;
use psrgs_vk::stereo::{Observations, PendingPhotograph, Scene};
use psrgs_vk::train::settings::Method;
use psrgs_vk::train::{Input, Message, Pacing, Settings, Trainer};

use super::common::{gpu, plane_scene};
use super::{assert_same, run, settings, stops_and_resumes_on};

const VIEWS: usize = 12;
/// Steps with a propagation: 5 to 11, all of the first pass over the views.
const PROPAGATED: usize = 7;
const SIZE: (u32, u32) = (160, 120);

fn gspro(iterations: u32) -> Settings {
    let mut s = settings(iterations);
    s.geometry.stereo_side = 64;
    s.geometry.propagate_from = 4;
    s.geometry.propagate_until = 12;
    s.geometry.propagate_every = 1;
    Method::GsPro.apply(&mut s, |_| false);
    s
}

/// The ground from twelve sides, with the input of stereo.
fn input(settings: &Settings) -> Input {
    let mut input = plane_scene::input(VIEWS, SIZE.0, SIZE.1, 1200);
    let at = |k: u32| f64::from(k) * 0.25 - 2.9;
    let points: Vec<[f64; 3]> = (0..24 * 24).map(|k| [at(k % 24), at(k / 24), 0.0]).collect();
    let sees = |v: usize, p: &[f64; 3]| {
        let camera = &input.train[v].camera;
        let [x, y, z] =
            [0, 1, 2].map(|i| camera.translation[i] + (0..3).map(|k| camera.rotation[i][k] * p[k]).sum::<f64>());
        let (u, v) = (camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy);
        z > 0.0 && (0.0..f64::from(SIZE.0)).contains(&u) && (0.0..f64::from(SIZE.1)).contains(&v)
    };
    let views = points.iter().map(|p| (0..VIEWS as u32).filter(|v| sees(*v as usize, p)).collect()).collect();
    let seen = Observations { points, views, ..Observations::default() };
    let pending: Vec<PendingPhotograph<'_>> =
        input.train.iter().map(|view| PendingPhotograph { name: &view.name, camera: view.camera, bytes: 0 }).collect();
    let share = HostShare::unlimited();
    let pixels = |k: usize| input.train[k].photograph.pixels();
    let scene = Scene::new(&pending, &seen, &settings.geometry.stereo(), &share, pixels).expect("pixels");
    assert!(scene.skipped.is_empty());
    input.optional.scene = Some(Arc::new(scene));
    input.initial.opacities.fill(2.0);
    input
}

/// The input without splats at positive x.
fn half(mut input: Input) -> Input {
    let all = input.initial;
    let kept: Vec<usize> = (0..all.len()).filter(|i| all.means[3 * i] < 0.0).collect();
    let rows = |plane: &[f32]| -> Vec<f32> {
        let width = plane.len() / all.len();
        kept.iter().flat_map(|i| plane[width * i..width * (i + 1)].to_vec()).collect()
    };
    input.initial = Gaussians {
        means: rows(&all.means),
        quats: rows(&all.quats),
        scales: rows(&all.scales),
        opacities: rows(&all.opacities),
        sh: std::array::from_fn(|g| rows(&all.sh[g])),
        ids: (0..kept.len() as u32).collect(),
    };
    input
}

#[test]
fn splats_are_added_where_propagated_and_rendered_depths_differ() {
    let Some(gpu) = gpu() else { return };
    let mut settings = gspro(30);
    settings.density.no_densify = true;
    let whole = input(&settings);
    let half = half(whole.clone());
    let begun = half.initial.len();
    let [with, without] = [&half, &whole].map(|i| run(&gpu, i.clone(), &settings, Pacing::default()).state);
    let new: Vec<&[f32]> =
        with.params[0].chunks_exact(3).zip(&with.ids).filter(|(_, id)| **id >= begun as u32).map(|(m, _)| m).collect();
    assert!(new.len() > 30, "{} splats added", new.len());
    let share = |good: &dyn Fn(&&&[f32]) -> bool| new.iter().filter(good).count() as f64 / new.len() as f64;
    let (empty, ground) = (share(&|m| m[0] > -0.3), share(&|m| m[2].abs() < 0.15));
    assert!(empty > 0.8, "{empty} of {} on ground without splats", new.len());
    assert!(ground > 0.8, "{ground} of {} on the ground", new.len());
    // Few splats are added where rendered depths are right.
    let added = without.ids.len() - whole.initial.len();
    assert!(4 * added < new.len(), "added: {added} to the whole ground, {} to half of the ground", new.len());
    // Every view that was propagated has a prior.
    let row = 1 + 2 * 64 * 48;
    assert_eq!(with.priors.len(), VIEWS * row);
    let depths = |view: &[u32]| view[1..].chunks_exact(2).filter(|words| f32::from_bits(words[0]) > 0.0).count();
    let known: Vec<usize> = with.priors.chunks(row).filter(|view| f32::from_bits(view[0]) > 0.0).map(depths).collect();
    assert!(known.len() == PROPAGATED && known.iter().all(|n| *n > 300), "{known:?} pixels");
    let limited = Settings {
        density: psrgs_vk::train::settings::Density { max_splats: Some(begun as u32 + 7), ..settings.density.clone() },
        ..settings
    };
    assert_eq!(run(&gpu, half, &limited, Pacing::default()).state.ids.len(), begun + 7);
}

#[test]
fn propagation_repeats_itself_whatever_is_on_its_way() {
    let Some(gpu) = gpu() else { return };
    let settings = gspro(36);
    let input = half(input(&settings));
    let first = run(&gpu, input.clone(), &settings, Pacing::default());
    assert!(first.changed > 0);
    let splats = input.initial.len() as u32;
    let tight = Pacing { events_in_flight: 7, splat_capacity: splats + 1, pair_capacity: 64, ..Pacing::default() };
    let mut trainer = Trainer::new(&gpu, input, &settings, tight, None).expect("trainer");
    let (mut count, mut views, mut grown) = (splats, 0, 0);
    while let Some(message) = trainer.next_message().expect("message") {
        match message {
            Message::Propagated { added, splats, share, step } => {
                count += added;
                views += 1;
                assert!(splats == count && (0.05..=1.0).contains(&share), "step {step}: {splats}, {count}, {share}");
            }
            Message::Density { splats, .. } => count = splats,
            Message::Step { step, splats, .. } => assert_eq!(splats, count, "step {step}"),
            Message::Grown { .. } => grown += 1,
            _ => {}
        }
    }
    assert!(views == PROPAGATED && grown >= 2, "{views} views, {grown} times more room");
    let second = trainer.snapshot().expect("snapshot").state;
    assert_same(&first.state, &second, "a repetition");
    assert_eq!(first.state.priors, second.priors);
}

#[test]
fn propagation_stops_and_resumes_bit_equal() {
    let Some(gpu) = gpu() else { return };
    let settings = gspro(24);
    let input = half(input(&settings));
    stops_and_resumes_on(&gpu, &settings, &input, &[5, 15]);
}
