//! Splats whose projection is ill-conditioned, at the edge of its domain, or undefined.

use psrgs_vk::pass::camera::{CameraPush, NEAR};
use psrgs_vk::pass::counters;
use psrgs_vk::raster::Variants;
use psrgs_vk::scene::random::Random;
use psrgs_vk::scene::tile::TileGrid;
use psrgs_vk::train::density::logit;
use psrgs_vk::twin::project::project;
use psrgs_vk::twin::projection::sigmoid;
use psrgs_vk::twin::splat::{Splat, TwinCamera};

use super::common;
use super::common::splats::{camera, seeded};
use super::device::{
    MEANS, OPACITIES, QUATS, SCALES, SH0, Scene, assert_finite, check, decided, relative, round, straight, upstream,
    worst,
};

/// Ratio of the axes of a projected ellipse.
fn aspect(splat: &Splat<f64>, view: &TwinCamera<f64>) -> f64 {
    let Ok(p) = project(splat, view, None) else { return 1.0 };
    let [a, b, c] = p.conic;
    let (middle, reach) = ((a + c) / 2.0, (((a - c) / 2.0).powi(2) + b * b).sqrt());
    ((middle + reach) / (middle - reach)).sqrt()
}

/// Needles of about this aspect in any direction, in a render of 64x48.
pub(crate) fn needles(random: &mut Random, ratio: f64) -> Scene {
    let camera = camera(64, 48);
    let splats: Vec<_> = (0..40)
        .map(|_| {
            let at = [random.range(0.0, 64.0), random.range(0.0, 48.0)];
            let (z, opacity) = (random.range(1.5, 4.0), random.range(0.3, 0.9));
            // The dilation leaves a needle at least sqrt(0.3) pixels of deviation across.
            let mut splat = round(random, &camera, at, z, 0.05, opacity);
            splat.log_scale[0] = (0.55 * ratio * z / camera.fx).ln();
            // Turned about the viewing axis, and slightly out of the image plane.
            let angle = random.range(0.0, 3.0);
            splat.quat = [angle.cos(), 0.02 * random.symmetric(), 0.02 * random.symmetric(), angle.sin()];
            splat
        })
        .collect();
    Scene::new(&splats, camera, false)
}

/// Bounds are a few times the measured errors. Renders and gradients lose few digits with the aspect, because the
/// exponent is a sum of two squares, and gradients of scales avoid products that cancel. At an aspect of 1,000,
/// gradients of scales lose digits: across a needle they are a small difference of gradients of the conic's three
/// entries.
#[test]
fn needles_of_aspect_10_100_and_1000() {
    let Some(gpu) = common::gpu() else { return };
    for (ratio, image_bound, gradient_bound, left_out) in
        [(10.0, 1e-5, 2e-5, 0.005), (100.0, 3e-5, 4e-5, 0.005), (1000.0, 3e-5, 8e-4, 0.05)]
    {
        let mut random = seeded(ratio as u64);
        let scene = needles(&mut random, ratio);
        let view = TwinCamera::<f64>::exact(&scene.shot.camera, &scene.shot.projection);
        let mut aspects: Vec<f64> = scene.splats.iter().map(|s| aspect(s, &view)).collect();
        aspects.sort_by(f64::total_cmp);
        assert!((0.5..2.0).contains(&(aspects[20] / ratio)), "aspect {ratio}: the middle one is {}", aspects[20]);
        let what = format!("needles of aspect {ratio}");
        let image = scene.wanted();
        let decided = decided(&what, &image, left_out);
        let g = upstream(&mut random, &decided);
        let want = scene.wanted_gradients(&g).planes();
        let used = decided.iter().filter(|d| **d).count();
        for variants in Variants::possible(&gpu) {
            let error = worst(&image, &decided, &scene.picture(&gpu, variants));
            let got = scene.gradients(&gpu, variants, &g);
            let of: Vec<String> = (0..5).map(|p| format!("{:.1e}", relative(&got.planes[p], &want[p]))).collect();
            println!("{what}, {variants}: {used} pixels, image {error:.1e}, gradients {}", of.join(" "));
            assert!(error < image_bound, "{what}, {variants}: off by {error:e}");
            assert_finite(&what, &got.planes);
            for p in [MEANS, QUATS, SCALES, OPACITIES, SH0] {
                let error = relative(&got.planes[p], &want[p]);
                assert!(error < gradient_bound, "{what}, {variants}, plane {p}: relative error {error:e}");
            }
        }
    }
}

/// A splat of a hundred times the scene's extent among ordinary ones lies in every tile once, and the render is right.
#[test]
fn giants() {
    let Some(gpu) = common::gpu() else { return };
    let camera = camera(61, 45);
    let mut random = seeded(7);
    for sigma in [500.0f64, 1e6] {
        let mut splats: Vec<_> = (0..20)
            .map(|i| {
                let at = [random.range(5.0, 55.0), random.range(5.0, 40.0)];
                round(&mut random, &camera, at, 2.0 + 0.1 * f64::from(i), 4.0, 0.6)
            })
            .collect();
        let mut giant = round(&mut random, &camera, [20.0, 30.0], 3.05, 1.0, 0.5);
        giant.log_scale = [sigma.ln(), sigma.ln() - 0.5, sigma.ln() - 1.0];
        splats.push(giant);
        let scene = Scene::new(&splats, camera, false);
        let image = scene.wanted();
        let decided = decided("giants", &image, 0.005);
        let g = upstream(&mut random, &decided);
        for variants in Variants::possible(&gpu) {
            let error = worst(&image, &decided, &scene.picture(&gpu, variants));
            println!("giants of {sigma:e}, {variants}: image {error:.1e}");
            assert!(error < 2e-5, "sigma {sigma}, {variants}: off by {error:e}");
            let got = scene.gradients(&gpu, variants, &g);
            let tiles = 61u32.div_ceil(variants.tile.size()) * 45u32.div_ceil(variants.tile.size());
            assert!(got.counters[counters::PAIRS] <= 21 * tiles);
            assert_finite("giants", &got.planes);
        }
    }
}

/// Depths in front of, on and behind the near plane, at the camera and behind it. A splat on the near plane is culled.
#[test]
fn near_plane_sweep() {
    let Some(gpu) = common::gpu() else { return };
    let camera = straight(40, 30);
    let near = NEAR as f32;
    let mut depths: Vec<f32> = (-100..=300).map(|i| near * (1.0 + 1e-6 * i as f32 * (i as f32).abs())).collect();
    depths.extend([near, near.next_up(), near.next_down(), 0.0, -0.0, 1e-38, -1e-38, 1e-42, -1.0, -1e30, 1e30]);
    let mut random = seeded(8);
    let splats: Vec<_> = depths
        .iter()
        .map(|z| {
            let mut splat = round(&mut random, &camera, [20.0, 15.0], 1.0, 3.0, 0.05);
            splat.mean = [0.0, 0.0, f64::from(*z)];
            splat
        })
        .collect();
    let scene = Scene::new(&splats, camera, false);
    let mut g = vec![0.0f32; 4 * scene.pixels()];
    g.iter_mut().for_each(|v| *v = random.symmetric() as f32);
    for variants in Variants::possible(&gpu) {
        assert!(scene.picture(&gpu, variants).iter().all(|v| v.is_finite()), "{variants}");
        let got = scene.gradients(&gpu, variants, &g);
        assert_finite("near plane", &got.planes);
        let mut seen = 0;
        for (i, z) in depths.iter().enumerate() {
            let moves = (0..8).any(|p| {
                let row = super::device::ROWS[p];
                got.planes[p][row * i..row * (i + 1)].iter().any(|v| *v != 0.0)
            });
            assert!(!moves || *z > near, "{variants}: a gradient at depth {z:e}");
            seen += u32::from(moves);
        }
        let on_device = got.counters[counters::VISIBLE];
        assert!(seen > 100 && seen <= on_device, "{variants}: {seen} of {on_device} have gradients");
        let in_front = depths.iter().filter(|z| **z > near).count() as u32;
        assert_eq!(on_device, in_front, "{variants}: on the near plane is not in front of it");
    }
}

/// Centres at 1.3 to 1.8 times the field of view, whose flanks reach into the image: the Jacobian is taken at the
/// clamped position. The gradient is that of the render. The 3DGS reference counts a term of the depth twice, which is
/// an option of training.
#[test]
fn off_frustum_clamp() {
    let Some(gpu) = common::gpu() else { return };
    let camera = camera(48, 40);
    let mut random = seeded(9);
    let splats: Vec<_> = (0..60)
        .map(|i| {
            let reach = random.range(1.2, 1.8);
            let (sin, cos) = (f64::from(i) * 0.7).sin_cos();
            let longest = sin.abs().max(cos.abs());
            let at = [24.0 * (1.0 + reach * cos / longest), 20.0 * (1.0 + reach * sin / longest)];
            let (z, opacity) = (random.range(1.5, 4.0), random.range(0.2, 0.8));
            let mut splat = round(&mut random, &camera, at, z, 14.0, opacity);
            splat.quat = std::array::from_fn(|_| random.symmetric());
            splat.log_scale = splat.log_scale.map(|s| s + 0.5 * random.symmetric());
            splat
        })
        .collect();
    let scene = Scene::new(&splats, camera, false);
    let view = TwinCamera::<f64>::exact(&scene.shot.camera, &scene.shot.projection);
    let clamped = scene.splats.iter().filter(|s| psrgs_vk::twin::project::geometry(s, &view).1.clamped != [false; 2]);
    assert!(clamped.count() > 30);
    let image = scene.wanted();
    assert!(image.blended.iter().sum::<u32>() > 5000);
    let decided = decided("beyond the frustum", &image, 0.01);
    let g = upstream(&mut random, &decided);
    let want = scene.wanted_gradients(&g).planes();
    for variants in Variants::possible(&gpu) {
        let error = worst(&image, &decided, &scene.picture(&gpu, variants));
        assert!(error < 2e-5, "{variants}: off by {error:e}");
        let got = scene.gradients(&gpu, variants, &g);
        let what = format!("beyond the frustum, {variants}");
        let of = [MEANS, QUATS, SCALES, OPACITIES].map(|p| format!("{:.1e}", relative(&got.planes[p], &want[p])));
        println!("{what}: image {error:.1e}, gradients {}", of.join(" "));
        check(&what, &[MEANS, QUATS, SCALES, OPACITIES, SH0], &got.planes, &want, 1e-3);
    }
}

/// Zero quaternions, vanishing scales, and a mean at the camera's centre: normalising zero gives NaN in other programs.
#[test]
fn zero_quaternions_scales_and_distance() {
    let Some(gpu) = common::gpu() else { return };
    let camera = camera(40, 30);
    let mut random = seeded(10);
    let mut splats = Vec::new();
    for (i, quat) in [[0.0; 4], [1e-30; 4], [1e-13, 0.0, 0.0, 0.0], [-0.0; 4]].into_iter().enumerate() {
        let mut splat = round(&mut random, &camera, [10.0 + 5.0 * i as f64, 9.0], 2.0 + 0.01 * i as f64, 2.0, 0.6);
        splat.log_scale[1] += 0.4;
        splat.quat = quat;
        splats.push(splat);
    }
    let vanishing = splats.len();
    for (i, log_scale) in [-20.0, -50.0, -88.0, -100.0, -1000.0, f64::from(f32::MIN)].into_iter().enumerate() {
        let mut all = round(&mut random, &camera, [5.0 + 5.0 * i as f64, 20.0], 2.5 + 0.01 * i as f64, 2.0, 0.7);
        let mut one = round(&mut random, &camera, [5.0 + 5.0 * i as f64, 15.0], 2.2 + 0.01 * i as f64, 2.0, 0.7);
        all.log_scale = [log_scale; 3];
        one.log_scale[i % 3] = log_scale;
        splats.extend([all, one]);
    }
    let mut inside = splats[0].clone();
    inside.mean = camera.center();
    splats.push(inside);
    let scene = Scene::new(&splats, camera, false);
    let image = scene.wanted();
    let decided = decided("vanishing", &image, 0.01);
    let g = upstream(&mut random, &decided);
    let want = scene.wanted_gradients(&g).planes();
    for variants in Variants::possible(&gpu) {
        let what = format!("vanishing, {variants}");
        let error = worst(&image, &decided, &scene.picture(&gpu, variants));
        assert!(error < 2e-5, "{what}: off by {error:e}");
        let got = scene.gradients(&gpu, variants, &g).planes;
        assert_finite(&what, &got);
        check(&what, &[MEANS, SCALES, OPACITIES, SH0], &got, &want, 1e-3);
        assert!(got[QUATS][..4 * vanishing].iter().all(|v| *v == 0.0), "{what}: a direction of no rotation");
    }
}

/// An opacity of 1 has an infinite logit. Logits that are computed from opacities are finite, and saturated logits
/// neither move nor break.
#[test]
fn logit_of_1() {
    for opacity in [0.0, 1e-300, 1e-6, 0.005, 0.5, 1.0 - 1e-6, 1.0] {
        let there = logit(opacity);
        let back = sigmoid(f64::from(there))[0];
        assert!(there.is_finite() && (back - opacity).abs() < 2e-7, "{opacity}: {there}, {back}");
    }
    let Some(gpu) = common::gpu() else { return };
    let camera = camera(40, 12);
    let mut random = seeded(11);
    let logits = [16.0, 17.0, 40.0, 88.0, 104.0, 1e30, f64::from(f32::MAX)];
    let splats: Vec<_> = logits
        .iter()
        .flat_map(|v| [*v, -*v])
        .enumerate()
        .map(|(i, logit)| {
            let at = [2.0 + 2.7 * i as f64, 6.0];
            let mut splat = round(&mut random, &camera, at, 2.0 + 0.1 * i as f64, 2.0, 0.5);
            splat.logit = logit;
            splat
        })
        .collect();
    let scene = Scene::new(&splats, camera, false);
    let image = scene.wanted();
    let decided = decided("saturated logits", &image, 0.05);
    let g = upstream(&mut random, &decided);
    for variants in Variants::possible(&gpu) {
        let error = worst(&image, &decided, &scene.picture(&gpu, variants));
        assert!(error < 2e-5, "{variants}: off by {error:e}");
        let got = scene.gradients(&gpu, variants, &g).planes;
        assert_finite("saturated logits", &got);
        let largest = got[OPACITIES].iter().fold(0.0f32, |m, v| m.max(v.abs()));
        assert!(largest < 1e-4, "{variants}: a saturated logit is pulled at with {largest:e}");
    }
}

/// Sizes from a ten-millionth of a pixel to a pixel, and needles that are thin in one direction alone. With
/// anti-aliasing: its factor is a ratio of determinants, which cancel in the form `ac - b^2`.
#[test]
fn sub_pixel_splats_with_antialiasing() {
    let Some(gpu) = common::gpu() else { return };
    let camera = camera(64, 40);
    let mut random = seeded(12);
    let mut splats: Vec<_> = (0..140)
        .map(|i| {
            let at = [2.0 + f64::from(i % 20) * 3.1, 3.0 + f64::from(i / 20) * 5.2];
            let sigma = 10f64.powf(-7.0 + 7.0 * f64::from(i) / 139.0);
            let mut splat = round(&mut random, &camera, at, 2.0 + 0.01 * f64::from(i), sigma, 0.97);
            splat.quat = std::array::from_fn(|_| random.symmetric());
            splat.log_scale = splat.log_scale.map(|s| s + 0.3 * random.symmetric());
            splat
        })
        .collect();
    for i in 0..20 {
        let at = [random.range(5.0, 59.0), random.range(5.0, 35.0)];
        let mut splat = round(&mut random, &camera, at, 1.5 + 0.01 * f64::from(i), 12.0, 0.97);
        splat.log_scale[0] += (0.02f64 / 12.0).ln();
        splat.log_scale[2] = splat.log_scale[0];
        let angle = 0.2 + 0.1 * f64::from(i);
        splat.quat = [angle.cos(), 0.0, 0.0, angle.sin()];
        splats.push(splat);
    }
    let scene = Scene::new(&splats, camera, true);
    let image = scene.wanted();
    assert!(image.blended.iter().sum::<u32>() > 140, "{}", image.blended.iter().sum::<u32>());
    let decided = decided("specks", &image, 0.01);
    let g = upstream(&mut random, &decided);
    let want = scene.wanted_gradients(&g).planes();
    let push = CameraPush::new(&scene.shot.camera, &scene.shot.projection);
    for variants in Variants::possible(&gpu) {
        let what = format!("specks, {variants}");
        let error = worst(&image, &decided, &scene.picture(&gpu, variants));
        assert!(error < 2e-5, "{what}: off by {error:e}");
        let got = scene.gradients(&gpu, variants, &g);
        assert_finite(&what, &got.planes);
        let of = [MEANS, QUATS, SCALES, OPACITIES].map(|p| format!("{:.1e}", relative(&got.planes[p], &want[p])));
        println!("{what}: image {error:.1e}, gradients {}", of.join(" "));
        check(&what, &[MEANS, QUATS, SCALES, OPACITIES, SH0], &got.planes, &want, 2e-3);
        let side = variants.tile.size();
        let grid = TileGrid::new([64, 40], [side; 2]);
        let view = TwinCamera::<f32>::of(&push);
        let twin =
            (0..splats.len()).filter(|i| project(&Splat::<f32>::of(&scene.model, *i), &view, Some(&grid)).is_ok());
        assert_eq!(got.counters[counters::VISIBLE] as usize, twin.count(), "{what}: splats seen");
    }
}
