//! Growth by relocation (`mcmc`): dead splats move, the set grows up to its limit, and renders stay the same.

use psrgs_vk::raster::Viewer;
use psrgs_vk::scene::Gaussians;
use psrgs_vk::train::settings::{Growth, Method};
use psrgs_vk::train::{Message, Pacing, Settings, Trainer};

use super::common::{gpu, plane_scene};
use super::{run, settings, stops_and_resumes_on};

const LIMIT: u32 = 380;

/// Relocations before steps 16, 31, 46 and 61, which grow the set by a tenth.
fn relocating(iterations: u32) -> Settings {
    let mut s = settings(iterations);
    Method::Mcmc.apply(&mut s, |key| ["densify-until", "lr-opacities"].contains(&key));
    s.density.relocate_growth = 0.1;
    s.density.max_splats = Some(LIMIT);
    s
}

/// The relocations of a training: steps, dead splats, added splats, and splats afterwards; and the trainer at its end.
fn relocations(s: &Settings, initial: Option<Gaussians>) -> Option<(Vec<[u32; 4]>, Trainer)> {
    let gpu = gpu()?;
    let mut input = plane_scene::input(5, 64, 48, 300);
    input.initial = initial.unwrap_or(input.initial);
    let mut trainer = Trainer::new(&gpu, input, s, Pacing::default(), None).expect("a trainer");
    let mut found = Vec::new();
    while let Some(message) = trainer.next_message().expect("a message") {
        match message {
            Message::Relocated { step, relocated, added, splats } => found.push([step, relocated, added, splats]),
            Message::Density { step, .. } => panic!("a density change at step {step}"),
            Message::OpacityReset { step } => panic!("a reset at step {step}"),
            _ => {}
        }
    }
    Some((found, trainer))
}

#[test]
fn the_set_grows_to_its_limit_and_never_past_it() {
    let Some((found, mut trainer)) = relocations(&relocating(80), None) else { return };
    assert_eq!(
        found.iter().map(|r| [r[0], r[2], r[3]]).collect::<Vec<_>>(),
        [[16, 30, 330], [31, 33, 363], [46, 17, 380], [61, 0, 380], [76, 0, 380]]
    );
    let model = trainer.model().expect("a model");
    assert_eq!(model.len() as u32, LIMIT);
    let mut ids = model.ids;
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len() as u32, LIMIT, "identities are unique");
}

/// A third of the splats with an opacity below the limit.
fn with_dead() -> Gaussians {
    let mut initial = plane_scene::splats(300);
    initial.opacities.iter_mut().step_by(3).for_each(|logit| *logit = -8.0);
    initial
}

/// Without learning, a training does nothing but relocate.
fn still(iterations: u32) -> Settings {
    let mut s = relocating(iterations);
    s.density.noise_means = 0.0;
    s.density.relocate_growth = 0.0;
    (s.optimiser.lr_means, s.optimiser.lr_means_final) = (1e-30, 1e-30);
    (s.optimiser.lr_sh_base, s.optimiser.lr_sh_rest, s.optimiser.lr_opacities) = (0.0, 0.0, 0.0);
    (s.optimiser.lr_scales, s.optimiser.lr_rotations) = (0.0, 0.0);
    s
}

#[test]
fn dead_splats_vanish_and_the_render_stays_the_same() {
    let Some((found, mut trainer)) = relocations(&still(20), Some(with_dead())) else { return };
    assert_eq!(found, [[16, 100, 0, 300]]);
    let (before, after) = (with_dead(), trainer.model().expect("a model"));
    assert!(after.opacities.iter().all(|logit| 1.0 / (1.0 + (-f64::from(*logit)).exp()) > 0.005));
    let gpu = gpu().expect("a device");
    let mut viewer = Viewer::new(&gpu);
    let mut sum = 0.0;
    for view in &plane_scene::input(5, 64, 48, 300).train {
        let shot = trainer.shot(&view.camera);
        let [old, new] = [&before, &after].map(|model| {
            let planes = viewer.upload(model).expect("room");
            viewer.render(&planes, model.len() as u32, &shot, false).expect("a render").rgbt
        });
        let off = old.iter().zip(&new).map(|(a, b)| f64::from((a - b).abs()));
        let largest = off.clone().fold(0.0, f64::max);
        assert!(largest < 0.05, "{largest}");
        sum += off.sum::<f64>() / old.len() as f64;
    }
    assert!(sum / 5.0 < 0.005, "mean difference {}", sum / 5.0);
}

#[test]
fn moments_of_relocated_splats_begin_at_zero() {
    let Some((_, mut trainer)) = relocations(&still(16), Some(with_dead())) else { return };
    // Before the last step, which takes no optimiser step, a hundred splats moved to others.
    let state = trainer.snapshot().expect("a snapshot").state;
    let zero = (0..300).filter(|i| state.moments[1][4][12 * i..12 * i + 3].iter().all(|v| *v == 0.0));
    let new = state.ids.iter().filter(|id| **id >= 300).count();
    assert_eq!(new, 100, "new identities");
    assert!(zero.count() >= 150, "moments of the dead, and of those whose places they take");
}

#[test]
fn a_training_that_relocates_resumes_bit_equal() {
    let Some(gpu) = gpu() else { return };
    let input = plane_scene::input(5, 64, 48, 300);
    stops_and_resumes_on(&gpu, &relocating(60), &input, &[1, 14, 15, 16, 30, 44, 59]);
    let mut packed = relocating(40);
    packed.shortcuts.moment_bits = 16;
    packed.shortcuts.visible_adam = true;
    stops_and_resumes_on(&gpu, &packed, &input, &[15, 16]);
}

#[test]
fn mcmc_improves_its_first_model() {
    let Some(gpu) = gpu() else { return };
    let mut s = relocating(80);
    s.run.eval_every = 1;
    let mut trainer =
        Trainer::new(&gpu, plane_scene::input(5, 64, 48, 300), &s, Pacing::default(), None).expect("a trainer");
    let mut scores = Vec::new();
    while let Some(message) = trainer.next_message().expect("a message") {
        if let Message::Evaluated { quality, .. } = message {
            scores.push(quality.psnr);
        }
    }
    let (first, last) = (scores[0], scores[scores.len() - 1]);
    assert!(last > first + 2.0, "{first} dB at first, {last} dB at last");
}

#[test]
fn noise_moves_faint_splats_and_otherwise_by_another_seed() {
    let Some(gpu) = gpu() else { return };
    let of = |change: fn(&mut Settings)| {
        let mut s = still(10);
        (s.optimiser.lr_means, s.optimiser.lr_means_final) = (1e-6, 1e-6);
        change(&mut s);
        let mut input = plane_scene::input(5, 64, 48, 300);
        input.initial = with_dead();
        run(&gpu, input, &s, Pacing::default()).state.params[0].clone()
    };
    let quiet = of(|_| {});
    let noisy = of(|s| s.density.noise_means = 5e5);
    let moved = quiet.iter().zip(&noisy).filter(|(a, b)| (*a - *b).abs() > 1e-4).count();
    assert!((200..=310).contains(&moved), "{moved} of 300 coordinates of faint splats moved");
    assert_ne!(noisy, of(|s| (s.density.noise_means, s.run.seed) = (5e5, 1)));
}

#[test]
fn relocation_is_refused_where_it_makes_no_sense() {
    let mut s = Settings::of_method(Method::Mcmc);
    assert!(s.check().is_ok());
    assert_eq!((s.density.growth, s.density.max_splats), (Growth::Relocated, Some(1_000_000)));
    s.model.sh_share = 0.5;
    assert!(s.check().expect_err("plain splats").to_string().contains("growth"));
    let mut near = Settings::of_method(Method::Rsgs);
    near.density.lidar = Some(psrgs_vk::train::settings::LidarCloud::Mvs);
    assert!(near.check().is_ok());
    near.density.growth = Growth::Relocated;
    assert!(near.check().expect_err("a cloud").to_string().contains("growth"));
}
