//! Sampled growth, masks, coarse photographs, depth priors, gradient maps and the perceptual distance in whole
//! trainings.

use psrgs_vk::scene::init::SH_C0;
use psrgs_vk::stereo::Prior;
use psrgs_vk::train::settings::{
    ConstrainedAgainst, DepthPrior, Gate, Growth, LidarCloud, Method, SigmaLearning, Start,
};
use psrgs_vk::train::{Input, Pacing, Settings, View, prepare};

use super::common::{gpu, plane_scene};
use super::{run, settings, stops_and_resumes_on};

/// Everything on, at a pace for few steps. The perceptual distance is that of filters, which need no weights.
fn everything(iterations: u32) -> Settings {
    let mut s = settings(iterations);
    s.density.opacity_reset_interval = 0;
    s.density.growth = Growth::Sampled;
    s.density.absgrad = true;
    s.density.low_grad_threshold = 4e-4;
    s.density.sample_mask_share = 0.5;
    s.density.sample_error_share = 0.5;
    s.density.prune_unseen = true;
    s.density.keep_opacity = 0.95;
    s.frequencies.low_stage = 0.4;
    s.frequencies.low_texture_weight = 0.5;
    s.frequencies.coarse_steps = 0.3;
    s.geometry.depth_prior = DepthPrior::Stereo;
    s.geometry.stereo_side = 32;
    s.geometry.lambda_flatten = 0.01;
    s.optimiser.lambda_sh = 0.2;
    s.texture.lambda_gradients = 0.05;
    s.texture.lambda_variation = 0.01;
    s.texture.lambda_constrained = 0.05;
    s.frequencies.sigma_learning = SigmaLearning::Errors;
    s.frequencies.sigma_every = 2;
    s.texture.lambda_perceptual = 0.02;
    s.texture.perceptual_every = 5;
    s.texture.perceptual_views = 3;
    s
}

/// Depth and normal of the ground as a view sees it.
fn ground(view: &View, settings: &Settings) -> Prior {
    let (width, height) = settings.geometry.prior_size(view.camera.width, view.camera.height);
    let camera = view.camera.resized(width, height);
    let (eye, r) = (camera.center(), camera.rotation);
    let mut prior = Prior { width, height, ..Prior::default() };
    for k in 0..width * height {
        let (u, v) = (f64::from(k % width) + 0.5, f64::from(k / width) + 0.5);
        let ray = [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0];
        let down: f64 = (0..3).map(|i| r[i][2] * ray[i]).sum();
        let depth = -eye[2] / down;
        let [x, y] = [0, 1].map(|k: usize| eye[k] + depth * (0..3).map(|i| r[i][k] * ray[i]).sum::<f64>());
        let there = depth > 0.0 && x.abs() < 3.0 && y.abs() < 3.0;
        prior.depth.push(if there { depth as f32 } else { 0.0 });
        prior.normals.push(if there { [r[0][2] as f32, r[1][2] as f32, r[2][2] as f32] } else { [0.0; 3] });
        prior.confidence.push(if there { 1.0 } else { 0.0 });
    }
    prior
}

/// The loss of two renders is at work, is another one than that against the photograph, and depends on no timing.
#[test]
fn two_renders_are_compared_after_the_low_stage() {
    let Some(gpu) = gpu() else { return };
    let input = plane_scene::input(4, 64, 48, 200);
    let trained = |weight: f64, against, events_in_flight| {
        let mut s = settings(50);
        s.frequencies.low_stage = 0.4;
        s.texture.lambda_constrained = weight;
        s.texture.constrained_against = against;
        s.texture.gradients_every = 2;
        run(&gpu, input.clone(), &s, Pacing { events_in_flight, ..Pacing::default() })
    };
    let both = trained(0.5, ConstrainedAgainst::Render, 1);
    super::assert_same(&both.state, &trained(0.5, ConstrainedAgainst::Render, 5).state, "two renders");
    assert!(both.losses.iter().all(|loss| loss.is_finite()) && both.changed > 0);
    let photograph = trained(0.5, ConstrainedAgainst::Photograph, 1);
    let off = trained(0.0, ConstrainedAgainst::Photograph, 1);
    // The stage ends after step 20.
    assert_eq!((&both.losses[..20], &both.losses[..20]), (&off.losses[..20], &photograph.losses[..20]));
    for other in [&photograph, &off] {
        assert!(both.losses[49] != other.losses[49], "the loss of two renders does nothing of its own");
    }
}

#[test]
fn growth_is_limited_by_the_first_splats() {
    let input = plane_scene::input(4, 64, 48, 30);
    let limited = |change: &dyn Fn(&mut Settings)| {
        let mut settings = Settings::default();
        Method::Psrgs.apply(&mut settings, |_| false);
        change(&mut settings);
        (prepare::limit_growth(&input, &mut settings), settings.density.max_splats)
    };
    let of_room = |room: f64| limited(&|settings| settings.density.growth_room = room);
    assert_eq!(of_room(2.5), (Some(75), Some(75)), "a resumed run has the limit in its settings");
    assert_eq!(of_room(0.1), (Some(24), Some(24)), "4 photographs of 64 x 48 pixels, 512 for a splat");
    assert_eq!(of_room(0.0), (None, None));
    let mut without_surfaces = Settings::default();
    without_surfaces.geometry.start = Start::Sfm;
    Method::Psrgs.apply(&mut without_surfaces, |key| key == "start");
    assert_eq!(prepare::limit_growth(&input, &mut without_surfaces), None, "sparse points have to grow");
    assert_eq!(limited(&|settings| settings.density.max_splats = Some(7)), (None, Some(7)), "the user's own");
    assert_eq!(limited(&|settings| settings.density.no_densify = true), (None, None));
}

fn input(views: usize, (width, height): (u32, u32), splats: usize, settings: &Settings) -> Input {
    let mut input = plane_scene::input(views, width, height, splats);
    input.optional.priors = input.train.iter().map(|view| Some(ground(view, settings))).collect();
    input
}

#[test]
fn everything_at_once_learns_and_repeats_itself() {
    let Some(gpu) = gpu() else { return };
    let settings = everything(90);
    let input = input(5, (64, 48), 300, &settings);
    let first = run(&gpu, input.clone(), &settings, Pacing::default());
    let mean = |losses: &[f32]| losses.iter().sum::<f32>() / losses.len() as f32;
    assert!(mean(&first.losses[80..]) < 0.6 * mean(&first.losses[27..37]), "{:?}", first.losses);
    assert!(first.changed > 50, "{} changes", first.changed);
    assert_eq!(first.state.scores.len(), 2 * first.state.ids.len());
    let second = run(&gpu, input, &settings, Pacing::default());
    super::assert_same(&first.state, &second.state, "a repetition");
}

#[test]
fn everything_at_once_stops_and_resumes_bit_equal() {
    let Some(gpu) = gpu() else { return };
    let mut settings = everything(60);
    settings.texture.constrained_against = ConstrainedAgainst::Render;
    stops_and_resumes_on(&gpu, &settings, &input(5, (64, 48), 300, &settings), &[14, 15, 24, 45]);
}

#[test]
fn what_nothing_looks_at_changes_no_bit() {
    let Some(gpu) = gpu() else { return };
    let plain = settings(40);
    let mut other = plain.clone();
    other.density.sample_rate = 0.9;
    other.density.sample_mask_share = 1.0;
    other.density.sample_error_share = 0.5;
    other.density.sample_error = 0.3;
    other.density.low_grad_threshold = 1.0;
    other.frequencies.gate = Gate::Random;
    other.frequencies.sigma = 7.0;
    other.frequencies.sigma_every = 2;
    other.frequencies.low_texture_weight = 0.1;
    other.geometry.stereo_width = 0.5;
    other.geometry.stereo_thickness = 0.1;
    other.geometry.stereo_opacity = 0.7;
    other.geometry.lambda_depth = 50.0;
    other.geometry.lambda_smooth = 3.0;
    other.geometry.lambda_normal = 3.0;
    other.geometry.depth_steps = 1.0;
    other.geometry.depth_every = 1;
    other.geometry.depth_left = 1.0;
    other.geometry.depth_huber = 0.5;
    other.geometry.depth_edges = 9.0;
    other.geometry.smooth_edge_stop = 1.0;
    other.texture.perceptual_every = 2;
    other.texture.perceptual_views = 3;
    assert_ne!(other, plain);
    assert_eq!(other.in_use(), plain.in_use());
    let of = |s: &Settings| run(&gpu, input(3, (48, 40), 200, &plain), s, Pacing::default());
    let (plain, other) = (of(&plain), of(&other));
    assert!(plain.changed > 0, "no density change");
    super::assert_same(&plain.state, &other.state, "settings without effect");
}

#[test]
fn a_prior_without_weights_is_no_loss() {
    let Some(gpu) = gpu() else { return };
    let none = settings(30);
    let mut idle = none.clone();
    idle.geometry.depth_prior = DepthPrior::Stereo;
    idle.geometry.stereo_side = 48;
    (idle.geometry.lambda_depth, idle.geometry.lambda_normal) = (0.0, 0.0);
    let mut other = idle.clone();
    (other.geometry.depth_steps, other.geometry.depth_every, other.geometry.depth_huber) = (1.0, 1, 0.5);
    assert_eq!(other.in_use(), idle.in_use());
    let mut with = idle.clone();
    with.geometry.lambda_normal = 0.1;
    with.geometry.depth_steps = 1.0;
    let of = |s: &Settings| run(&gpu, input(3, (48, 40), 200, s), s, Pacing::default()).state;
    let (none, idle, with) = (of(&none), of(&idle), of(&with));
    super::assert_same(&none, &idle, "a prior without weights");
    assert_ne!(none.params, with.params, "a weight makes a difference");
}

#[test]
fn a_weight_on_harmonics_lowers_the_view_dependence_of_colours() {
    let Some(gpu) = gpu() else { return };
    let mut s = settings(40);
    s.density.no_densify = true;
    s.model.sh_interval = 5;
    let rest = |weight: f64| {
        s.optimiser.lambda_sh = weight;
        let state = run(&gpu, input(4, (48, 40), 200, &s), &s, Pacing::default()).state;
        let squares = |row: &[f32], from: usize| row[from..].iter().map(|v| f64::from(*v).powi(2)).sum::<f64>();
        let groups =
            |k: usize, from: usize| state.params[k].chunks_exact(12).map(|row| squares(row, from)).sum::<f64>();
        groups(4, 3) + groups(5, 0) + groups(6, 0) + groups(7, 0)
    };
    let [free, some, much] = [0.0, 1.0, 1e3].map(rest);
    assert!(some < 0.98 * free && much < 0.2 * free && free > 0.0, "{free} without, {some} and {much} with it");
}

#[test]
fn prices_and_decision_lower_what_they_weigh_when_they_count() {
    let Some(gpu) = gpu() else { return };
    let of = |change: fn(&mut Settings)| {
        let mut s = settings(40);
        s.density.no_densify = true;
        change(&mut s);
        run(&gpu, input(4, (48, 40), 200, &s), &s, Pacing::default()).state
    };
    let free = of(|_| {});
    let mean = |values: &[f32], f: fn(f64) -> f64| values.iter().map(|v| f(f64::from(*v))).sum::<f64>();
    let opacity = |logit: f64| 1.0 / (1.0 + (-logit).exp());
    let priced = of(|s| s.optimiser.lambda_opacity = 1.0);
    assert!(mean(&priced.params[3], opacity) < 0.9 * mean(&free.params[3], opacity));
    let small = of(|s| s.optimiser.lambda_scale = 5.0);
    assert!(mean(&small.params[2], f64::exp) < 0.9 * mean(&free.params[2], f64::exp));
    let undecided = |x: f64| {
        let o = 1.0 / (1.0 + (-x).exp());
        o * (1.0 - o)
    };
    let decided = of(|s| s.optimiser.lambda_binary = 50.0);
    assert!(mean(&decided.params[3], undecided) < 0.9 * mean(&free.params[3], undecided));
    let never = of(|s| (s.optimiser.lambda_binary, s.optimiser.binary_from) = (1.0, 1.0));
    super::assert_same(&free, &never, "no step is left for it");
}

/// Mean distance of splats from the ground, weighted by opacity and area.
fn off_the_ground(settings: &Settings, input: Input, gpu: &psrgs_vk::vk::Gpu) -> f64 {
    let state = run(gpu, input, settings, Pacing::default()).state;
    let [means, _, scales, opacities, ..] = &state.params;
    let (mut sum, mut weights) = (0.0, 0.0);
    for i in 0..state.ids.len() {
        let opacity = 1.0 / (1.0 + (-f64::from(opacities[i])).exp());
        let area: f64 = (0..3).map(|k| f64::from(scales[3 * i + k]).exp()).sum::<f64>().powi(2);
        sum += opacity * area * f64::from(means[3 * i + 2]).abs();
        weights += opacity * area;
    }
    sum / weights
}

#[test]
fn depth_priors_bring_splats_to_the_surface() {
    let Some(gpu) = gpu() else { return };
    let mut with = settings(30);
    with.density.no_densify = true;
    with.optimiser.lr_means = 2e-3;
    with.optimiser.lr_means_final = 2e-3;
    with.geometry.depth_prior = DepthPrior::Stereo;
    with.geometry.stereo_side = 64;
    with.geometry.lambda_depth = 50.0;
    with.geometry.depth_left = 1.0;
    with.geometry.depth_steps = 1.0;
    with.geometry.depth_every = 1;
    // Splats begin above the ground in one layer (two layers could mix to the right depth), and opaque, because the
    // loss has no depth where little is seen.
    let mut scene = input(5, (64, 48), 300, &with);
    scene.initial.means.chunks_exact_mut(3).for_each(|mean| mean[2] = 0.25);
    scene.initial.opacities.fill(2.0);
    let without = Settings { geometry: Default::default(), ..with.clone() };
    let (known, unknown) = (off_the_ground(&with, scene.clone(), &gpu), off_the_ground(&without, scene, &gpu));
    assert!(known < 0.7 * unknown, "{known} from the ground with depths, {unknown} without");
}

#[test]
fn methods_are_values_of_options_and_named_ones_win() {
    let plain = Settings::default();
    assert_eq!(Settings::of_method(Method::Reference3dgs), plain);
    let abs = Settings::of_method(Method::AbsGs);
    assert!(
        abs.density.absgrad && abs.density.split_grad_threshold == Some(4e-4) && abs.density.percent_dense == 0.001
    );
    assert_eq!(Settings { density: plain.density.clone(), run: plain.run.clone(), ..abs }, plain);
    for (method, name) in Method::ALL {
        assert_eq!(name.parse(), Ok(method));
        assert_eq!(method.to_string(), name);
        let mut whole = Settings::of_method(method);
        let mut named = plain.clone();
        if method == Method::Rsgs {
            whole.check().expect_err("no cloud");
            (whole.density.lidar, named.density.lidar) = (Some(LidarCloud::Mvs), Some(LidarCloud::Mvs));
        }
        whole.check().expect(name);
        named.density.grad_threshold = 1e-3;
        method.apply(&mut named, |key| key == "grad-threshold");
        assert_eq!(named.density.grad_threshold, 1e-3, "{name}");
        named.density.grad_threshold = whole.density.grad_threshold;
        assert_eq!(named, whole, "{name}");
    }
    let error = "gsplat".parse::<Method>().unwrap_err();
    assert!(error.contains("gsplat") && error.contains("3dgs"), "{error}");
}

#[test]
fn the_coarse_camera_sees_the_same_rays() {
    let Some(gpu) = gpu() else { return };
    // 33 x 21 is not divisible by 2 or 4: rows and columns that do not fill a pixel are left out.
    let mut coarse = settings(24);
    coarse.frequencies.coarse_steps = 1.0;
    let fine = settings(24);
    let [reduced, whole] =
        [&coarse, &fine].map(|s| run(&gpu, plane_scene::input(3, 66, 42, 200), s, Pacing::default()));
    let last = |losses: &[f32]| losses[losses.len() - 6..].iter().sum::<f32>() / 6.0;
    assert!(reduced.losses.iter().all(|l| l.is_finite()));
    // The scene at half the size: the loss falls as at full size.
    assert!(last(&reduced.losses) < 0.9 * reduced.losses[0] && last(&whole.losses) < 0.9 * whole.losses[0]);
    assert!((last(&reduced.losses) / last(&whole.losses) - 1.0).abs() < 0.3, "{:?}", reduced.losses);
}

/// Black splats have no gradient in the reference. In this project's own methods they learn the colours of the
/// photographs.
#[test]
fn black_splats_learn_colours_except_in_published_methods() {
    let Some(gpu) = gpu() else { return };
    let mut input = plane_scene::input(5, 64, 48, 300);
    let black = -0.5 / SH_C0 as f32 - 0.1;
    input.initial.sh[0].chunks_exact_mut(12).for_each(|sh| sh[..3].fill(black));
    for (method, learns) in [
        (Method::Reference3dgs, false),
        (Method::AbsGs, false),
        (Method::Mcmc, false),
        (Method::Lean, true),
        (Method::PsrgsPaper, true),
        (Method::Psrgs, true),
    ] {
        assert_eq!(method.black_learns(), learns, "{method}");
        let mut settings = settings(12);
        settings.run.method = method;
        let trained = run(&gpu, input.clone(), &settings, Pacing::default()).state.params[4].clone();
        let raised = trained.iter().zip(&input.initial.sh[0]).filter(|(after, before)| after > before).count();
        assert_eq!(raised > 300, learns, "{method}: {raised} coefficients were raised");
        assert!(learns || raised == 0, "{method}: {raised} coefficients were raised");
    }
}
