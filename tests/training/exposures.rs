//! Exposures: recovered from photographs with known exposures, without a drift of the model's colours, and reproducible
//! bit for bit.

use psrgs_vk::dataset::Pixels;
use psrgs_vk::eval::Exposures;
use psrgs_vk::format::{EXPOSURE_FILE, ExposureFile};
use psrgs_vk::pass::camera::Projection;
use psrgs_vk::raster::{RenderView, Viewer};
use psrgs_vk::scene::{Gaussians, SH_GROUP_FLOATS};
use psrgs_vk::train::settings::Exposure;
use psrgs_vk::train::{self, Checkpointed, ExposureMatrix, Input, Message, Pacing, Settings, Trainer, View};
use psrgs_vk::vk::Gpu;

use super::common::{self, plane_scene};
use super::{assert_same, run, settings};

const VIEWS: usize = 4;

/// An exposure for each photograph: gains within a tenth, some mixing of channels, and an offset. The mean over
/// photographs is the identity.
fn truth(view: usize) -> ExposureMatrix {
    let wave =
        |k: usize| (std::f64::consts::TAU * ((view * (1 + k % 2)) as f64 / VIEWS as f64 + 0.13 * k as f64)).sin();
    std::array::from_fn(|row| {
        std::array::from_fn(|column| {
            let k = 4 * row + column;
            match column {
                3 => 0.02 * wave(k),
                _ if column == row => 1.0 + 0.09 * wave(k),
                _ => 0.03 * wave(k),
            }
        })
    })
}

/// Opaque splats of many colours over the ground.
fn model() -> Gaussians {
    let mut model = plane_scene::splats(150);
    for i in 0..model.len() {
        model.opacities[i] = 3.0;
        model.scales[3 * i..3 * i + 3].fill(0.25_f32.ln());
        for c in 0..3 {
            let wave = ((i * (3 + 2 * c) + 5 * c) as f32 * 0.7).sin();
            model.sh[0][SH_GROUP_FLOATS * i + c] = 0.9 * wave;
        }
    }
    model
}

/// Photographs of the model under the exposures above, masked where the model does not cover them. Training begins with
/// the model in other colours.
fn exposed_input(gpu: &Gpu) -> Input {
    let mut input = plane_scene::input(VIEWS, 48, 36, 10);
    let model = model();
    let mut viewer = Viewer::new(gpu);
    let planes = viewer.upload(&model).unwrap();
    let projection = Projection { sh_degree: 0, ..Projection::default() };
    for (v, view) in input.train.iter_mut().enumerate() {
        let shot = RenderView { camera: view.camera, projection, background: [0.0; 3] };
        let picture = viewer.render(&planes, model.len() as u32, &shot, false).unwrap();
        let e = truth(v);
        let mut rgba = vec![0_u8; picture.rgbt.len()];
        for (pixel, c) in rgba.chunks_exact_mut(4).zip(picture.rgbt.chunks_exact(4)) {
            for k in 0..3 {
                let shown = (0..3).map(|j| e[k][j] * f64::from(c[j])).sum::<f64>() + e[k][3];
                pixel[k] = (shown.clamp(0.0, 1.0) * 255.0).round() as u8;
            }
            pixel[3] = if c[3] < 0.2 { 255 } else { 0 };
        }
        *view = View::new(&view.name, view.camera, Pixels::Rgba8(rgba));
        assert!(view.masked() < 48 * 36 / 2, "the model covers half of the picture");
    }
    input.initial = model;
    for i in 0..input.initial.len() {
        for c in 0..3 {
            input.initial.sh[0][SH_GROUP_FLOATS * i + c] += 0.3 * ((i * 11 + 7 * c) as f32).cos();
        }
    }
    input
}

/// Only colours and exposures learn.
fn colours_only(iterations: u32, exposure: Exposure) -> Settings {
    let mut s = Settings::default();
    s.run.iterations = iterations;
    s.run.eval_every = 0;
    s.density.no_densify = true;
    s.model.sh_degree = 0;
    s.optimiser.exposure = exposure;
    s.optimiser.lr_sh_base = 5e-3;
    (s.optimiser.lr_means, s.optimiser.lr_means_final) = (1e-12, 1e-12);
    (s.optimiser.lr_opacities, s.optimiser.lr_scales, s.optimiser.lr_rotations) = (0.0, 0.0, 0.0);
    s
}

fn trained(gpu: &Gpu, input: &Input, settings: &Settings) -> (Trainer, f32) {
    let mut trainer = Trainer::new(gpu, input.clone(), settings, Pacing::default(), None).unwrap();
    let mut losses = Vec::new();
    while let Some(message) = trainer.next_message().unwrap() {
        if let Message::Step { loss, .. } = message {
            losses.push(loss);
        }
    }
    let last = losses[losses.len() - VIEWS..].iter().sum::<f32>() / VIEWS as f32;
    (trainer, last)
}

#[test]
fn exposures_are_found_again_to_a_hundredth() {
    let Some(gpu) = common::gpu() else { return };
    let input = exposed_input(&gpu);
    let (mut with, loss) = trained(&gpu, &input, &colours_only(640, Exposure::Affine));
    let found = with.exposures().unwrap().expect("exposures are on");
    assert_eq!(found.len(), VIEWS);
    for (v, (name, matrix)) in found.iter().enumerate() {
        assert_eq!(*name, input.train[v].name);
        for (row, want) in matrix.iter().zip(truth(v)) {
            for (got, want) in row.iter().zip(want) {
                assert!((got - want).abs() < 0.01, "{name}: {matrix:?} instead of {:?}", truth(v));
            }
        }
    }
    // The mean over photographs is the identity, so that the model's colours do not drift.
    for k in 0..12 {
        let mean = found.iter().map(|(_, m)| m[k / 4][k % 4]).sum::<f64>() / VIEWS as f64;
        let identity = if k / 4 == k % 4 { 1.0 } else { 0.0 };
        assert!((mean - identity).abs() < 1e-6, "number {k} is {mean} in the mean");
    }
    // Without exposures the photographs contradict each other.
    let (mut without, loss_without) = trained(&gpu, &input, &colours_only(160, Exposure::Off));
    assert!(loss < 0.4 * loss_without, "{loss} with, {loss_without} without");
    assert!(without.exposures().unwrap().is_none());
    assert!(without.snapshot().unwrap().state.exposures.is_empty());

    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join(EXPOSURE_FILE);
    let written = ExposureFile { photographs: found.into_iter().collect() };
    written.write(&file).unwrap();
    assert_eq!(ExposureFile::read(&file).unwrap(), written);
}

/// A held-out photograph is scored with its expected exposure, on which its pixels have no effect.
#[test]
fn held_out_photographs_are_scored_by_the_exposures_about_them() {
    let Some(gpu) = common::gpu() else { return };
    let mut input = exposed_input(&gpu);
    // The second photograph under its own name, whose exposure is learned, and under a name between two others.
    let second = input.train[1].clone();
    let pixels = second.photograph.pixels().unwrap().as_ref().clone();
    let between = format!("{}5", second.name);
    let named = |name: &str| View::new(name, second.camera, pixels.clone());
    input.held_out = vec![named(&second.name), named(&between)];
    let (mut trainer, _) = trained(&gpu, &input, &colours_only(320, Exposure::Affine));
    let expected = trainer.expected_exposures().unwrap().expect("exposures are on");
    let found = trainer.exposures().unwrap().unwrap();
    let known = found.iter().zip(&input.train).map(|((name, matrix), v)| (name.clone(), *matrix, v.camera.center()));
    assert_eq!(expected, Exposures::new(known));
    let of = |name: &str| expected.of(name, second.camera.center());
    assert_eq!(of(&second.name), found[1].1);
    let quality = trainer.evaluate().unwrap();
    let rgb = |exposure: &ExposureMatrix, trainer: &mut Trainer| {
        trainer.picture(&second.camera).unwrap().exposed(exposure).rgb8()
    };
    for (view, score) in input.held_out.iter().zip(&quality.images) {
        let by_hand = train::score(view, &pixels, &rgb(&of(&view.name), &mut trainer));
        assert_eq!(*score, by_hand);
    }
    let mut identity = [[0.0; 4]; 3];
    (0..3).for_each(|k| identity[k][k] = 1.0);
    let own_colours = train::score(&input.held_out[0], &pixels, &rgb(&identity, &mut trainer)).psnr;
    let own_exposure = quality.images[0].psnr;
    assert!(own_exposure > own_colours + 3.0, "{own_exposure} dB with its exposure, {own_colours} without");
}

#[test]
fn exposures_are_replayed_and_resumed_bit_equal() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(5, 64, 48, 300);
    let mut settings = settings(60);
    settings.optimiser.exposure = Exposure::Affine;
    let bits = |rows: &[f32]| rows.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    let straight = run(&gpu, input.clone(), &settings, Pacing::default());
    assert!(straight.state.exposures.iter().any(|x| *x != 0.0));
    // Small capacities, so that events are lost and replayed.
    let small = Pacing { splat_capacity: 1, pair_capacity: 64, ..Pacing::default() };
    let replayed = run(&gpu, input.clone(), &settings, small);
    assert!(replayed.grown > 0);
    assert_same(&replayed.state, &straight.state, "replayed");
    assert_eq!(bits(&replayed.state.exposures), bits(&straight.state.exposures));
    // Stopped, written to a checkpoint, and resumed.
    let mut trainer = Trainer::new(&gpu, input.clone(), &settings, Pacing::default(), None).unwrap();
    while !matches!(trainer.next_message().unwrap(), Some(Message::Step { step: 23, .. })) {}
    let saved = Checkpointed::new(trainer.snapshot().unwrap(), &settings).unwrap().to_checkpoint().unwrap();
    let restart = Checkpointed::from_checkpoint(&saved).unwrap().restart;
    assert!((23..60).contains(&restart.step));
    let mut resumed = Trainer::new(&gpu, input.clone(), &settings, Pacing::default(), Some(restart)).unwrap();
    while resumed.next_message().unwrap().is_some() {}
    let state = resumed.snapshot().unwrap().state;
    assert_same(&state, &straight.state, "resumed");
    assert_eq!(bits(&state.exposures), bits(&straight.state.exposures));
    // A checkpoint of a run without exposures does not resume with exposures.
    let mut restart = Checkpointed::from_checkpoint(&saved).unwrap().restart;
    restart.state.exposures.clear();
    let error = Trainer::new(&gpu, input, &settings, Pacing::default(), Some(restart)).err().unwrap();
    assert!(error.to_string().contains("exposures"), "{error}");
}
