//! Depth and normals of planes.

use glam::DVec3;
use psrgs_vk::stereo::{FusedPoint, InitialPlanes, Matcher, Prior, Settings, fuse};

use super::common;
use super::site::{Sheet, Truth, cross, views};

/// Settings for the small photographs of these tests.
fn settings() -> Settings {
    Settings { max_side: 1000, ..Settings::default() }
}

#[derive(Debug, Default)]
struct Score {
    /// Mean relative error of known depths.
    error: f64,
    /// Share of pixels with a depth.
    valid: f64,
    /// Mean angle between normals, degrees.
    degrees: f64,
}

/// Compares in the pixels that `counts`.
fn score(prior: &Prior, truth: &Truth, counts: impl Fn(usize) -> bool) -> Score {
    let pixels: Vec<usize> = (0..prior.depth.len()).filter(|p| counts(*p)).collect();
    let known: Vec<usize> = pixels.iter().copied().filter(|p| prior.depth[*p] > 0.0).collect();
    let mean = |of: &dyn Fn(usize) -> f64| known.iter().map(|p| of(*p)).sum::<f64>() / known.len().max(1) as f64;
    let normal = |p: usize| DVec3::from_array(prior.normals[p].map(f64::from));
    Score {
        error: mean(&|p| (f64::from(prior.depth[p]) / truth.depth[p] - 1.0).abs()),
        valid: known.len() as f64 / pixels.len().max(1) as f64,
        degrees: mean(&|p| normal(p).angle_between(truth.normals[p]).to_degrees()),
    }
}

fn not_at_the_edge(width: u32, height: u32, margin: u32) -> impl Fn(usize) -> bool {
    move |p| {
        let (x, y) = (p as u32 % width, p as u32 / width);
        x >= margin && y >= margin && x + margin < width && y + margin < height
    }
}

#[test]
fn a_plane_that_faces_the_cameras_has_its_depth() {
    let Some(gpu) = common::gpu() else { return };
    let sheets = [Sheet::plane(DVec3::NEG_Z, DVec3::new(0.0, 0.0, 3.0))];
    let (views, truths) = views(&sheets, &cross(0.35, 96, 72), [1.5, 6.0]);
    let priors = Matcher::new(&gpu, &settings()).unwrap().run(&views, |_| ()).unwrap();
    for (prior, truth) in priors.iter().zip(&truths) {
        let score = score(prior, truth, not_at_the_edge(96, 72, 3));
        println!("{score:?}");
        assert!(score.error < 0.005 && score.valid > 0.8 && score.degrees < 5.0, "{score:?}");
    }
}

#[test]
fn slanted_planes_have_their_depth_and_their_normals() {
    let Some(gpu) = common::gpu() else { return };
    for normal in [DVec3::new(0.5, 0.0, -1.0), DVec3::new(0.0, -0.9, -1.0), DVec3::new(-0.3, 0.4, -1.0)] {
        let sheets = [Sheet::plane(normal, DVec3::new(0.0, 0.0, 3.0))];
        let (views, truths) = views(&sheets, &cross(0.35, 96, 72), [1.0, 9.0]);
        let priors = Matcher::new(&gpu, &settings()).unwrap().run(&views, |_| ()).unwrap();
        let score = score(&priors[0], &truths[0], not_at_the_edge(96, 72, 3));
        println!("{normal}: {score:?}");
        assert!(score.error < 0.005 && score.valid > 0.8 && score.degrees < 5.0, "{normal}: {score:?}");
    }
}

/// Beside the edge of a nearer object, the background is hidden from some views: remaining depths must be right, and
/// depths that only the reference sees must be removed.
#[test]
fn what_others_do_not_see_is_removed() {
    let Some(gpu) = common::gpu() else { return };
    let sheets = [
        Sheet::plane(DVec3::NEG_Z, DVec3::new(0.0, 0.0, 3.0)),
        Sheet::plane(DVec3::NEG_Z, DVec3::new(0.0, 0.0, 1.5)).within([-1e9, 0.05, -1e9, 1e9]),
    ];
    // Cameras along x: the band beside the edge is hidden from every camera on the left.
    let cameras: Vec<_> =
        [0.0, -0.24, -0.3, -0.36, -0.42].map(|x| super::site::camera([x, 0.02 * x, 0.0], [0.0, 0.0], 128, 60)).to_vec();
    let (views, truths) = views(&sheets, &cameras, [1.0, 6.0]);
    let priors = Matcher::new(&gpu, &settings()).unwrap().run(&views, |_| ()).unwrap();
    let (prior, truth, camera) = (&priors[0], &truths[0], &views[0].camera);
    // The column of the reference at which the background beside the edge begins for a camera.
    let edge_of = |c: &psrgs_vk::scene::Camera| {
        let from = c.center()[0];
        let at_background = from + (0.05 - from) * 3.0 / 1.5;
        camera.fx * at_background / 3.0 + camera.cx
    };
    let (own, first, last) = (edge_of(camera), edge_of(&cameras[1]), edge_of(&cameras[4]));
    let column = |p: usize| (p % 128) as f64 + 0.5;
    let inside = not_at_the_edge(128, 60, 3);
    // Windows reach a few pixels over an edge.
    let hidden = |p: usize| inside(p) && column(p) > own + 2.0 && column(p) < first - 3.0;
    // On the right, the sources' photographs end.
    let seen_by_all = |p: usize| inside(p) && column(p) > last + 2.0 && column(p) < 110.0;
    assert!((0..prior.depth.len()).filter(|p| hidden(*p)).count() > 150, "{own} {first}");
    let (hidden, seen) = (score(prior, truth, hidden), score(prior, truth, seen_by_all));
    println!("hidden {hidden:?}, seen {seen:?}");
    assert!(hidden.valid < 0.1, "{hidden:?}");
    assert!(seen.valid > 0.8 && seen.error < 0.005, "{seen:?}");
}

/// Bare ground under sensor noise: windows correlate little even at the right depth, and views still agree.
#[test]
fn what_views_agree_on_is_kept_where_windows_correlate_little() {
    let Some(gpu) = common::gpu() else { return };
    // No search: only the filter of given depths is tested.
    let settings = Settings { iterations: 0, first_draws: 0, draws: 0, rounds: 0, ..settings() };
    let valid = |contrast: f64, least_ncc: f32| {
        let sheets = [Sheet { contrast, ..Sheet::plane(DVec3::new(0.2, 0.1, -1.0), DVec3::new(0.0, 0.0, 3.0)) }];
        let (mut views, truths) = views(&sheets, &cross(0.35, 96, 72), [1.5, 6.0]);
        for (v, (view, truth)) in views.iter_mut().zip(&truths).enumerate() {
            let noise = |p: usize| ((p + 96 * 72 * v) as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
            view.luma.iter_mut().enumerate().for_each(|(p, l)| *l += (noise(p) as f32 / 16_777_216.0 - 0.5) * 0.012);
            let depth: Vec<f32> = truth.depth.iter().map(|z| *z as f32).collect();
            let normals: Vec<[f32; 3]> = truth.normals.iter().map(|n| n.as_vec3().to_array()).collect();
            view.start = InitialPlanes::from_maps(&view.camera, &depth, &normals);
        }
        let priors = Matcher::new(&gpu, &Settings { least_ncc, ..settings.clone() }).unwrap().run(&views, |_| ());
        let score = score(&priors.unwrap()[0], &truths[0], not_at_the_edge(96, 72, 3));
        println!("contrast {contrast}, least NCC {least_ncc}: {score:?}");
        assert!(score.error < 0.001, "{score:?}");
        score.valid
    };
    let default = Settings::default().least_ncc;
    let (kept, strict, noise) = (valid(0.04, default), valid(0.04, 0.5), valid(0.0, default));
    assert!(kept > 0.75 && strict < 0.65 && noise < 0.25, "{kept} kept, {strict} with NCC 0.5, {noise} of noise");
}

#[test]
fn equal_inputs_give_equal_bits() {
    let Some(gpu) = common::gpu() else { return };
    let sheets = [Sheet::plane(DVec3::new(0.2, 0.1, -1.0), DVec3::new(0.0, 0.0, 3.0))];
    let (views, _) = views(&sheets, &cross(0.3, 40, 30)[..3], [1.5, 6.0]);
    let run = || Matcher::new(&gpu, &settings()).unwrap().run(&views, |_| ()).unwrap();
    assert_eq!(run(), run());
}

/// A search that starts from rendered depths.
#[test]
fn a_rendered_start_needs_no_random_draws() {
    let Some(gpu) = common::gpu() else { return };
    let sheets = [Sheet::plane(DVec3::new(0.4, 0.0, -1.0), DVec3::new(0.0, 0.0, 3.0))];
    let (mut views, truths) = views(&sheets, &cross(0.35, 64, 48), [1.0, 9.0]);
    for (view, truth) in views.iter_mut().zip(&truths) {
        // Half a pixel of parallax off, and turned.
        let depth: Vec<f32> = truth.depth.iter().map(|z| 1.03 * *z as f32).collect();
        let normals: Vec<[f32; 3]> =
            truth.normals.iter().map(|n| (*n + 0.1 * DVec3::Y).normalize().as_vec3().to_array()).collect();
        view.start = InitialPlanes::from_maps(&view.camera, &depth, &normals);
    }
    let settings = Settings { first_draws: 0, ..settings() };
    let priors = Matcher::new(&gpu, &settings).unwrap().run(&views, |_| ()).unwrap();
    let score = score(&priors[0], &truths[0], not_at_the_edge(64, 48, 3));
    println!("{score:?}");
    assert!(score.error < 0.005 && score.valid > 0.8 && score.degrees < 5.0, "{score:?}");
}

#[test]
fn the_fused_cloud_lies_on_the_plane_and_has_no_point_twice() {
    let Some(gpu) = common::gpu() else { return };
    let normal = DVec3::new(0.2, 0.1, -1.0).normalize();
    let sheets = [Sheet::plane(normal, DVec3::new(0.0, 0.0, 3.0))];
    let (views, _) = views(&sheets, &cross(0.35, 64, 48), [1.5, 6.0]);
    let priors = Matcher::new(&gpu, &settings()).unwrap().run(&views, |_| ()).unwrap();
    let points = fuse(&views, &priors, &settings());
    let depths: usize = priors.iter().map(|p| p.depth.iter().filter(|d| **d > 0.0).count()).sum();
    assert_eq!(points.iter().map(|p| p.pixels as usize).sum::<usize>(), depths, "each pixel is in one point");
    assert!(2 * points.len() < depths, "{} points of {depths} pixels", points.len());
    let mean = |of: &dyn Fn(&FusedPoint) -> f64| points.iter().map(of).sum::<f64>() / points.len() as f64;
    let distance = mean(&|p| (DVec3::from_array(p.position) - DVec3::new(0.0, 0.0, 3.0)).dot(normal).abs());
    let degrees = mean(&|p| DVec3::from_array(p.normal.map(f64::from)).angle_between(normal).to_degrees());
    assert!(distance < 0.01 && degrees < 5.0, "{distance} units, {degrees} degrees");
    assert!(points.iter().all(|p| p.colour == [128; 3]));
}
