//! Gradients in f64 against finite differences: the whole brute-force renderer, and the projection's twin by columns.

mod common;

use common::guards::Guards;
use common::splats::{self, camera, in_view, seeded, vector};
use psrgs_vk::pass::camera::Projection;
use psrgs_vk::scene::Camera;
use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::project::{Projected, project};
use psrgs_vk::twin::project_backward::{Grad2d, decide, flatten, price, project_backward, shrink};
use psrgs_vk::twin::reference::{self, Image, ImageGradient, Settings};
use psrgs_vk::twin::splat::{PARAMETERS, Splat, TwinCamera};

/// Families of parameters, whose units differ.
const FAMILIES: [(&str, std::ops::Range<usize>); 5] =
    [("mean", 0..3), ("quat", 3..7), ("log scale", 7..10), ("logit", 10..11), ("sh", 11..PARAMETERS)];

/// Five-point derivative of a vector-valued function of parameter `k`.
fn difference(splat: &Splat<f64>, k: usize, h: f64, f: &mut dyn FnMut(&Splat<f64>) -> Vec<f64>) -> Vec<f64> {
    let mut at = |step: f64| {
        let mut values = splat.to_array();
        values[k] += step;
        f(&Splat::from_array(&values))
    };
    let (a, b, c, d) = (at(-2.0 * h), at(-h), at(h), at(2.0 * h));
    (0..a.len()).map(|i| (a[i] - 8.0 * b[i] + 8.0 * c[i] - d[i]) / (12.0 * h)).collect()
}

/// Weighted sum over all channels of an image.
fn loss(image: &Image, g: &ImageGradient) -> f64 {
    let dot = |a: &[[f64; 3]], b: &[[f64; 3]]| -> f64 {
        a.as_flattened().iter().zip(b.as_flattened()).map(|(x, y)| x * y).sum()
    };
    let scalar = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(x, y)| x * y).sum() };
    dot(&image.colour, &g.colour)
        + scalar(&image.transmittance, &g.transmittance)
        + scalar(&image.depth, &g.depth)
        + dot(&image.normal, &g.normal)
}

/// Which parts of the image the loss sees.
#[derive(Clone, Copy)]
enum Seen {
    Color,
    DepthAndNormal,
    Transmittance,
}

fn random_gradient(random: &mut Random, pixels: usize, what: Seen) -> ImageGradient {
    let mut g = ImageGradient::zeros(pixels);
    for i in 0..pixels {
        match what {
            Seen::Color => g.colour[i] = vector(random),
            Seen::DepthAndNormal => {
                g.depth[i] = random.symmetric();
                g.normal[i] = vector(random);
            }
            Seen::Transmittance => g.transmittance[i] = random.symmetric(),
        }
    }
    g
}

/// A scene in which no pixel is near a threshold: finite differences do not cross one.
fn calm_scene(first_seed: u64, camera: &Camera, settings: &Settings) -> (Vec<Splat<f64>>, Random) {
    for seed in first_seed..first_seed + 400 {
        let mut random = seeded(seed);
        let splats: Vec<_> = (0..4).map(|_| in_view(&mut random, camera)).collect();
        let image = reference::render(&splats, camera, settings);
        // The steps below move ln(alpha) by at most some 1e-5; conditions are some tens and more.
        let calm = image.margin.iter().all(|m| *m > 2e-6);
        let used = image.blended.iter().sum::<u32>() > 200;
        if calm && used {
            return (splats, random);
        }
    }
    panic!("no scene away from thresholds from seed {first_seed}")
}

fn brute_force_against_differences(settings: Settings, what: Seen, seed: u64) {
    let camera = camera(22, 17);
    let (splats, mut random) = calm_scene(seed, &camera, &settings);
    let pixels = (camera.width * camera.height) as usize;
    let g = random_gradient(&mut random, pixels, what);
    let analytic = reference::backward(&splats, &camera, &settings, &g);
    for i in 0..splats.len() {
        let got = analytic.splats[i].to_array();
        let mut scene = splats.clone();
        let want: Vec<f64> = (0..PARAMETERS)
            .map(|k| {
                difference(&splats[i], k, 1e-6, &mut |moved| {
                    scene[i] = moved.clone();
                    vec![loss(&reference::render_with_slopes_of(&splats, &scene, &camera, &settings), &g)]
                })[0]
            })
            .collect();
        for (name, family) in FAMILIES {
            let scale = want[family.clone()].iter().fold(1e-3f64, |m, v| m.max(v.abs()));
            for k in family {
                let error = (got[k] - want[k]).abs();
                // The second term is the rounding of the loss over the step.
                assert!(error < 2e-6 * scale + 5e-8, "splat {i}, {name} {k}: {} against {}", got[k], want[k]);
            }
        }
    }
    // Degrees in use have gradients, higher degrees have none.
    let used = ((settings.sh_degree + 1) * (settings.sh_degree + 1)) as usize;
    if let Seen::Color = what {
        for splat in &analytic.splats {
            assert!(splat.sh[..used].iter().any(|rgb| rgb.iter().any(|v| *v != 0.0)));
            assert!(splat.sh[used..].iter().all(|rgb| rgb.iter().all(|v| *v == 0.0)));
        }
    }
}

fn settings(sh_degree: u32, antialias: bool) -> Settings {
    Settings { sh_degree, near: 0.2, antialias, background: [0.3, 0.7, 0.1], ..Settings::default() }
}

#[test]
fn brute_force_colour_gradients_of_every_sh_degree() {
    for degree in 0..=3 {
        brute_force_against_differences(settings(degree, false), Seen::Color, 1000 * u64::from(degree));
    }
}

#[test]
fn brute_force_colour_gradients_with_antialiasing() {
    brute_force_against_differences(settings(3, true), Seen::Color, 5000);
}

#[test]
fn brute_force_depth_normal_and_transmittance_gradients() {
    for antialias in [false, true] {
        brute_force_against_differences(settings(1, antialias), Seen::DepthAndNormal, 6000);
        brute_force_against_differences(settings(1, antialias), Seen::Transmittance, 7000);
    }
}

/// Everything the projection outputs that has a gradient, in the order of `grad2d` and then the normal; of the depth the
/// plane's value at the image's corner, with a given slope.
fn outputs(p: &Projected<f64>, slope: [f64; 2]) -> Vec<f64> {
    let ([x, y], [a, b, c], [red, green, blue]) = (p.mean, p.conic, p.colour);
    let mut out = vec![x, y, a, b, c, p.opacity, red, green, blue, p.depth - slope[0] * x - slope[1] * y];
    out.extend(p.normal);
    out
}

/// The discrete state of a splat's projection; finite differences must not cross a change of it.
fn state(splat: &Splat<f64>, view: &TwinCamera<f64>) -> (bool, [bool; 2], bool, [bool; 3]) {
    let (_, e) = psrgs_vk::twin::project::geometry(splat, view);
    match project(splat, view, None) {
        Ok(p) => (true, e.clamped, e.floored, p.colour.map(|c| c > 0.0)),
        Err(_) => (false, e.clamped, e.floored, [false; 3]),
    }
}

fn projection_against_differences(projection: Projection, spread: f64, seed: u64) -> usize {
    let camera = camera(64, 48);
    let view = TwinCamera::<f64>::exact(&camera, &projection);
    let mut random = seeded(seed);
    let (mut compared, mut clamped) = (0, 0);
    for case in 0..60 {
        let splat = splats::spread(&mut random, &camera, spread);
        let Ok(here) = project(&splat, &view, None) else { continue };
        let ([.., z0], e) = psrgs_vk::twin::project::geometry(&splat, &view);
        // The reference holds the clamped x and y of the Jacobian fixed, not their ratios to the depth: a clamped ratio
        // falls with the depth. For a moved splat, the limits here are scaled likewise.
        let seen = |moved: &Splat<f64>| {
            let mut view = view.clone();
            let ([.., z], _) = psrgs_vk::twin::project::geometry(moved, &view);
            for k in (0..2).filter(|k| projection.reference_clamp && e.clamped[*k]) {
                view.limits[2 * k..2 * k + 2].iter_mut().for_each(|limit| *limit *= z0 / z);
            }
            view
        };
        let calm = (0..PARAMETERS).all(|k| {
            [-4e-4, 4e-4].iter().all(|h| {
                let mut values = splat.to_array();
                values[k] += h;
                let moved = Splat::from_array(&values);
                // The normal must not flip to its other side.
                let faces = |p: Projected<f64>| (0..3).map(|i| p.normal[i] * here.normal[i]).sum::<f64>() > 0.0;
                state(&moved, &seen(&moved)) == state(&splat, &view) && project(&moved, &view, None).is_ok_and(faces)
            })
        });
        if !calm {
            continue;
        }
        compared += 1;
        clamped += usize::from(state(&splat, &view).1 != [false; 2]);
        let slopes: Vec<Vec<f64>> = (0..PARAMETERS)
            .map(|k| {
                difference(&splat, k, 1e-4, &mut |moved| {
                    project(moved, &seen(moved), None).map_or(vec![], |p| outputs(&p, here.slope))
                })
            })
            .collect();
        for (column, value) in outputs(&here, here.slope).into_iter().enumerate() {
            let mut g = Grad2d { row: [0.0; 12], normal: [0.0; 3] };
            if column < 10 {
                g.row[column] = 1.0
            } else {
                g.normal[column - 10] = 1.0
            }
            let got = project_backward(&splat, &view, here.colour, &g).to_array();
            let want: Vec<f64> = slopes.iter().map(|outputs| outputs[column]).collect();
            for (name, family) in FAMILIES {
                let scale = want[family.clone()].iter().fold(0.0f64, |m, v| m.max(v.abs()));
                let noise = 1e-11 * (1.0 + value.abs());
                for k in family {
                    let (got, want) = (got[k], want[k]);
                    let error = (got - want).abs();
                    assert!(
                        error < 1e-6 * scale + noise,
                        "case {case}, column {column}, {name} {k}: {got} against {want}"
                    );
                }
            }
        }
    }
    assert!(compared > 30, "{compared} of 60 splats compared");
    clamped
}

#[test]
fn flatness_pulls_at_the_shortest_axis_alone() {
    let camera = camera(64, 48);
    let mut random = seeded(9);
    for _ in 0..20 {
        let splat = splats::spread(&mut random, &camera, 1.0);
        let mut got = Splat::from_array(&[0.0; PARAMETERS]);
        flatten(&mut got, splat.log_scale, 2.5);
        for k in 0..PARAMETERS {
            let shortest = |s: &Splat<f64>| 2.5 * s.log_scale.iter().fold(f64::INFINITY, |m, v| m.min(*v)).exp();
            let want = difference(&splat, k, 1e-5, &mut |moved| vec![shortest(moved)])[0];
            assert!((got.to_array()[k] - want).abs() < 1e-9, "{k}: {} against {want}", got.to_array()[k]);
        }
    }
}

#[test]
fn smallness_pulls_only_at_view_dependent_coefficients_in_use() {
    let camera = camera(64, 48);
    let mut random = seeded(12);
    for degree in 0..=3 {
        let splat = splats::spread(&mut random, &camera, 1.0);
        let mut got = Splat::from_array(&[0.0; PARAMETERS]);
        shrink(&mut got, &splat.sh, degree, 2.5);
        let in_use = 1..(degree as usize + 1).pow(2);
        let mut pulled = 0;
        for k in 0..PARAMETERS {
            let squares =
                |s: &Splat<f64>| 1.25 * s.sh[in_use.clone()].as_flattened().iter().map(|x| x * x).sum::<f64>();
            let want = difference(&splat, k, 1e-5, &mut |moved| vec![squares(moved)])[0];
            assert!((got.to_array()[k] - want).abs() < 1e-9, "{k}: {} against {want}", got.to_array()[k]);
            pulled += usize::from(got.to_array()[k] != 0.0);
        }
        assert_eq!(pulled, 3 * in_use.len());
    }
}

/// The slopes of `loss` at random splats are the gradients that `add` adds.
fn slopes_are_added(add: impl Fn(&mut Splat<f64>, &Splat<f64>), loss: impl Fn(&Splat<f64>) -> f64, pulled: usize) {
    let camera = camera(64, 48);
    let mut random = seeded(15);
    for _ in 0..20 {
        let splat = splats::spread(&mut random, &camera, 1.0);
        let mut got = Splat::from_array(&[0.0; PARAMETERS]);
        add(&mut got, &splat);
        for k in 0..PARAMETERS {
            let want = difference(&splat, k, 1e-5, &mut |moved| vec![loss(moved)])[0];
            assert!((got.to_array()[k] - want).abs() < 1e-9, "{k}: {} against {want}", got.to_array()[k]);
        }
        assert_eq!(got.to_array().iter().filter(|g| **g != 0.0).count(), pulled);
    }
}

fn opacity(splat: &Splat<f64>) -> f64 {
    1.0 / (1.0 + (-splat.logit).exp())
}

#[test]
fn prices_pull_at_opacity_and_scales_alone() {
    let scales = |s: &Splat<f64>| s.log_scale.iter().map(|scale| scale.exp()).sum::<f64>() / 3.0;
    slopes_are_added(|g, s| price(g, s.log_scale, s.logit, [0.7, 0.0]), |s| 0.7 * opacity(s), 1);
    slopes_are_added(|g, s| price(g, s.log_scale, s.logit, [0.0, 2.5]), |s| 2.5 * scales(s), 3);
}

#[test]
fn decision_pulls_at_opacity_alone_towards_0_or_1() {
    slopes_are_added(|g, s| decide(g, s.logit, 2.5), |s| 2.5 * opacity(s) * (1.0 - opacity(s)), 1);
    for (logit, rises) in [(-1.5, false), (1.5, true)] {
        let mut gradient = Splat::from_array(&[0.0; PARAMETERS]);
        decide(&mut gradient, logit, 1.0);
        assert_eq!(gradient.logit < 0.0, rises, "a step goes against the gradient");
    }
}

#[test]
fn projection_twin_columns_for_every_sh_degree_and_antialiasing() {
    for sh_degree in 0..=3 {
        for antialias in [false, true] {
            let projection = Projection { sh_degree, antialias, ..Projection::default() };
            projection_against_differences(projection, 0.9, 10 + u64::from(sh_degree));
        }
    }
}

#[test]
fn projection_twin_beyond_the_field_of_view_clamp() {
    let clamped = projection_against_differences(Projection { antialias: true, ..Projection::default() }, 2.2, 77);
    assert!(clamped > 10, "only {clamped} splats were clamped");
}

#[test]
fn projection_twin_beyond_the_clamp_of_the_reference() {
    let projection = Projection { antialias: true, reference_clamp: true, ..Projection::default() };
    let clamped = projection_against_differences(projection, 2.2, 78);
    assert!(clamped > 10, "only {clamped} splats were clamped");
}

/// Below its bound, a colour is clamped. Where the gradient raises the colour, the gradient must equal finite
/// differences of a brighter splat, whose colour is not clamped.
#[test]
fn a_colour_at_its_lower_bound_has_only_gradients_that_raise_it() {
    let camera = camera(64, 48);
    let mut random = seeded(23);
    let lift = 10.0;
    let mut clamped = 0;
    for case in 0..24 {
        let black_learns = case % 3 != 0;
        let projection = Projection { sh_degree: case % 4, black_learns, ..Projection::default() };
        let view = TwinCamera::<f64>::exact(&camera, &projection);
        let mut splat = splats::spread(&mut random, &camera, 0.7);
        splat.sh[0].iter_mut().for_each(|dc| *dc -= 2.0);
        let Ok(here) = project(&splat, &view, None) else { continue };
        let lifted = |moved: &Splat<f64>| {
            let mut moved = moved.clone();
            moved.sh[0].iter_mut().for_each(|dc| *dc += lift);
            project(&moved, &view, None).map_or(vec![], |p| p.colour.to_vec())
        };
        for (channel, sign) in (0..3).flat_map(|channel| [(channel, 1.0), (channel, -1.0)]) {
            let lit = here.colour[channel] > 0.0;
            clamped += usize::from(!lit);
            let mut g = Grad2d { row: [0.0; 12], normal: [0.0; 3] };
            g.row[6 + channel] = sign;
            let got = project_backward(&splat, &view, here.colour, &g).to_array();
            let passes = lit || black_learns && sign < 0.0;
            for (k, got) in got.into_iter().enumerate() {
                let slope = difference(&splat, k, 1e-4, &mut |moved| lifted(moved))[channel];
                let want = if passes { sign * slope } else { 0.0 };
                assert!((got - want).abs() < 1e-6 * (1.0 + want.abs()), "{case}, {channel}, {k}: {} for {want}", got);
            }
        }
    }
    assert!(clamped > 40, "{clamped} colours at the bound");
}

/// At the bound the loss has two slopes. A gradient that leads back inside is the slope on the right of the bound.
#[test]
fn brute_force_gradients_at_the_colour_bound_lead_back_inside() {
    let camera = camera(22, 17);
    let settings = Settings { black_learns: true, ..settings(0, false) };
    let (mut splats, mut random) = calm_scene(40, &camera, &settings);
    for splat in &mut splats {
        // Below the bound by less than the tolerance, so that rounding leaves no light.
        splat.sh[0] = [-0.5 * (4.0 * std::f64::consts::PI).sqrt() - 1e-12; 3];
    }
    let pixels = (camera.width * camera.height) as usize;
    let g = random_gradient(&mut random, pixels, Seen::Color);
    let got = reference::backward(&splats, &camera, &settings, &g);
    let none = reference::backward(&splats, &camera, &Settings { black_learns: false, ..settings }, &g);
    let at = |scene: &[Splat<f64>]| loss(&reference::render(scene, &camera, &settings), &g);
    let (here, mut raised) = (at(&splats), [0, 0]);
    for i in 0..splats.len() {
        for c in 0..3 {
            let mut scene = splats.clone();
            // The loss is linear in the colour.
            scene[i].sh[0][c] += 0.5;
            let slope = (at(&scene) - here) / 0.5;
            assert!((got.splats[i].sh[0][c] - slope.min(0.0)).abs() < 1e-9, "{i} {c}: {slope}");
            assert_eq!(none.splats[i].sh[0][c], 0.0);
            raised[usize::from(slope < 0.0)] += 1;
        }
    }
    assert!(raised.iter().all(|n| *n > 1), "{raised:?} slopes of either sign");
}

#[test]
fn reference_clamp_changes_only_gradients_of_clamped_means() {
    let camera = camera(64, 48);
    let honest = TwinCamera::<f64>::exact(&camera, &Projection::default());
    let quirk = TwinCamera::<f64>::exact(&camera, &Projection { reference_clamp: true, ..Projection::default() });
    let mut random = seeded(5);
    let g = Grad2d { row: [0.1, -0.2, 3.0, -2.0, 1.0, 0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], normal: [0.0; 3] };
    let mut differed = 0;
    for _ in 0..60 {
        let splat = splats::spread(&mut random, &camera, 2.2);
        let Ok(p) = project(&splat, &honest, None) else { continue };
        let (_, e) = psrgs_vk::twin::project::geometry(&splat, &honest);
        let a = project_backward(&splat, &honest, p.colour, &g);
        let b = project_backward(&splat, &quirk, p.colour, &g);
        assert_eq!((a.quat, a.log_scale, a.logit), (b.quat, b.log_scale, b.logit));
        assert_eq!(a.mean != b.mean, e.clamped != [false; 2]);
        differed += usize::from(a.mean != b.mean);
    }
    assert!(differed > 10);
}

/// The twin's chain rule, applied to the brute-force renderer's 2D gradients, must give that renderer's own gradients.
/// Renderer and twin share no arithmetic.
#[test]
fn projection_twin_agrees_with_the_brute_force_renderer() {
    let camera = camera(40, 30);
    for (antialias, sh_degree, black_learns) in [(false, 3, false), (true, 2, true)] {
        let settings = Settings { black_learns, ..settings(sh_degree, antialias) };
        let mut random = seeded(31);
        let splats: Vec<_> = (0..60).map(|_| splats::spread(&mut random, &camera, 1.4)).collect();
        let mut g = random_gradient(&mut random, 1200, Seen::Color);
        let other = random_gradient(&mut random, 1200, Seen::DepthAndNormal);
        (g.depth, g.normal) = (other.depth, other.normal);
        let want = reference::backward(&splats, &camera, &settings, &g);
        let projection = Projection { sh_degree, antialias, black_learns, ..Projection::default() };
        let view = TwinCamera::<f64>::exact(&camera, &projection);
        let mut touched = 0;
        for (i, splat) in splats.iter().enumerate() {
            let Ok(p) = project(splat, &view, None) else { continue };
            let grad = Grad2d { row: want.grad2d[i], normal: want.normals[i] };
            let got = project_backward(splat, &view, p.colour, &grad).to_array();
            let want = want.splats[i].to_array();
            touched += usize::from(want.iter().any(|v| *v != 0.0));
            for (name, family) in FAMILIES {
                let scale = want[family.clone()].iter().fold(1e-12f64, |m, v| m.max(v.abs()));
                for k in family {
                    assert!((got[k] - want[k]).abs() < 1e-9 * scale, "{i} {name} {k}: {} against {}", got[k], want[k]);
                }
            }
        }
        assert!(touched > 30);
    }
}

/// A wide splat whose centre is that of the middle pixel of a 5x5 image, with this alpha there.
fn centred(camera: &Camera, alpha: f64, z: f64) -> Splat<f64> {
    let mut splat = in_view(&mut seeded(1), camera);
    splat.mean = splats::to_scene(camera, [(2.5 - camera.cx) / camera.fx * z, (2.5 - camera.cy) / camera.fy * z, z]);
    splat.logit = (alpha / (1.0 - alpha)).ln();
    splat
}

#[test]
fn margins_vanish_at_each_threshold_and_not_beside_it() {
    let camera = camera(5, 5);
    let settings = settings(0, false);
    let margin = |alphas: &[f64]| {
        let scene: Vec<_> = (0..).zip(alphas).map(|(i, a)| centred(&camera, *a, 2.0 + 0.1 * f64::from(i))).collect();
        reference::render(&scene, &camera, &settings).margin[12]
    };
    for (on, beside) in [
        (&[1.0 / 255.0][..], &[1.0 / 250.0][..]),
        (&[0.99], &[0.98]),
        // Transmittances 0.05, 0.0025, 1e-4.
        (&[0.95, 0.95, 0.96], &[0.95, 0.95, 0.9]),
    ] {
        assert!(margin(on) < 1e-12, "{on:?}: {}", margin(on));
        assert!(margin(beside) > 1e-4, "{beside:?}: {}", margin(beside));
    }
}

#[test]
fn clamped_alpha_passes_no_gradient_and_stays_finite_in_a_stack() {
    let camera = camera(5, 5);
    let settings = settings(0, false);
    let mut g = ImageGradient::zeros(25);
    g.colour[12] = [1.0, -0.5, 0.25];
    let one = reference::backward(&[centred(&camera, 0.999, 2.0)], &camera, &settings, &g);
    assert_eq!((one.splats[0].logit, one.splats[0].mean[0]), (0.0, 0.0));
    assert!(one.splats[0].sh[0][0] > 0.0);
    let stack: Vec<_> = (0..50).map(|i| centred(&camera, 0.9999, 2.0 + 0.01 * f64::from(i))).collect();
    let all = reference::backward(&stack, &camera, &settings, &g);
    assert!(all.splats.iter().all(|s| s.to_array().iter().all(|v| v.is_finite())));
    // Alpha is held at 0.99: after two splats the transmittance is 1e-4, and the third does not fit.
    let lit = all.splats.iter().filter(|s| s.sh[0][0] != 0.0).count();
    assert!((1..=2).contains(&lit), "{lit} splats lit");
}

#[test]
fn guards_object_to_each_kind_of_error() {
    let mut random = seeded(3);
    let want: Vec<f64> = (0..400).map(|_| random.symmetric() + 2.0 * random.symmetric().signum()).collect();
    let rounded: Vec<f32> = want.iter().map(|v| *v as f32).collect();
    let guards = Guards::of(1e-4);
    assert_eq!(guards.verdict(4, &rounded, &want), Ok(()));
    let objects = |change: &dyn Fn(&mut [f32]), word: &str| {
        let mut got = rounded.clone();
        change(&mut got);
        let verdict = guards.verdict(4, &got, &want);
        assert!(verdict.as_ref().is_err_and(|why| why.contains(word)), "{verdict:?} lacks {word}");
    };
    objects(&|got| got[17] *= 1.01, "element");
    objects(&|got| got[17] = f32::NAN, "element");
    objects(&|got| got[8..12].fill(0.0), "row 2");
    objects(
        &|got| got.iter_mut().enumerate().for_each(|(i, v)| *v *= if i % 2 == 0 { 1.00005 } else { 0.99995 }),
        "norm",
    );
    objects(&|got| got.iter_mut().for_each(|v| *v *= 1.00002), "bias");
    assert!(guards.verdict(4, &[1.0; 4], &[0.0; 4]).is_err());
}
