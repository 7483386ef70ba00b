//! Stacks of splats at one pixel.

use psrgs_vk::raster::Variants;
use psrgs_vk::vk::DeviceKind;

use super::common;
use super::common::splats::{camera, seeded};
use super::device::{
    MEANS, OPACITIES, SCALES, SH0, Scene, assert_finite, check, check_sums, decided, relative, round, upstream, worst,
};

/// 50 splats of opacity 0.9999 at one pixel: 1 / (1 - alpha) is 100 at the clamp, and most splats are never reached.
#[test]
fn saturated_alpha_stacks() {
    let Some(gpu) = common::gpu() else { return };
    let camera = camera(13, 11);
    let mut random = seeded(1);
    let splats: Vec<_> =
        (0..50).map(|i| round(&mut random, &camera, [6.3, 4.8], 2.0 + 0.01 * f64::from(i), 2.5, 0.9999)).collect();
    let scene = Scene::new(&splats, camera, false);
    let image = scene.wanted();
    // Two alphas of 0.99 give exactly the transmittance of the threshold.
    let decided = decided("stack", &image, 0.05);
    let g = upstream(&mut random, &decided);
    let want = scene.wanted_gradients(&g).planes();
    let everywhere = vec![1.0f32; g.len()];
    for variants in Variants::possible(&gpu) {
        let what = format!("50 opaque splats, {variants}");
        let error = worst(&image, &decided, &scene.picture(&gpu, variants));
        assert!(error < 2e-5, "{what}: off by {error:e}");
        let got = scene.gradients(&gpu, variants, &g);
        println!(
            "{what}: image {error:.1e}, gradients of logits {:.1e}",
            relative(&got.planes[OPACITIES], &want[OPACITIES])
        );
        check(&what, &[MEANS, OPACITIES, SCALES, SH0], &got.planes, &want, 1e-3);
        assert_finite(&what, &scene.gradients(&gpu, variants, &everywhere).planes);
    }
    common::assert_no_messages(&gpu);
}

/// Alpha is clamped at 0.99 and does not depend on opacity, mean and shape, so their gradients are exactly zero. The
/// 3DGS reference passes the gradient through. Training does likewise, and other callers choose.
#[test]
fn clamp_gradients() {
    let Some(gpu) = common::gpu() else { return };
    let camera = camera(5, 5);
    let mut splat = round(&mut seeded(2), &camera, [2.9, 2.3], 2.0, 8.0, 0.9999);
    splat.log_scale[1] += 0.3;
    // Without view-dependent colours, the mean has no gradient through the viewing direction.
    splat.sh[1..].fill([0.0; 3]);
    let mut g = vec![0.0f32; 100];
    g[48..52].copy_from_slice(&[1.0, -0.5, 0.25, 0.5]);
    let mut fainter = splat.clone();
    fainter.logit -= 0.1;
    let fainter = Scene::new(&[fainter], camera, false).wanted().colour[12];
    let mut scene = Scene::new(&[splat], camera, false);
    assert_eq!(scene.wanted().colour[12], fainter, "the colour depends on a clamped opacity");
    for passes in [false, true] {
        scene.clamp_gradient_passes = passes;
        for variants in Variants::possible(&gpu) {
            let got = scene.gradients(&gpu, variants, &g).planes;
            assert!(got[SH0][..3].iter().all(|v| *v != 0.0 && v.is_finite()), "{variants}: {:?}", &got[SH0][..3]);
            for p in [MEANS, SCALES, OPACITIES] {
                let still = got[p].iter().all(|v| *v == 0.0);
                assert_eq!(still, !passes, "{variants}, plane {p}: {:?}", got[p]);
            }
        }
    }
}

/// Bound of a gradient's f32 error behind 2,000 layers, relative to its contributions, where quotients are not
/// correctly rounded. Per layer, the forward pass rounds 1 - alpha and a product, half an ulp each. The backward pass
/// rounds a quotient, within 2.5 ulp by Vulkan, and the colour behind: half an ulp of the sum, less of the product.
/// The error of exp2, 3.3 ulp of an alpha of 1/255, is a hundredth of an ulp of 1 - alpha.
const FOG: f64 = 2000.0 * (0.5 + 0.5 + 2.5 + 1.0) * f32::EPSILON as f64;

/// 2,000 layers with alphas a little above 1/255: the forward pass multiplies the transmittance by 2,000 factors, and
/// the backward pass divides by each.
#[test]
fn fog_of_2000_layers() {
    let Some(gpu) = common::gpu() else { return };
    let camera = camera(9, 9);
    let mut random = seeded(3);
    let splats: Vec<_> =
        (0..2000).map(|i| round(&mut random, &camera, [4.4, 4.7], 2.0 + 1e-3 * f64::from(i), 40.0, 0.0043)).collect();
    let scene = Scene::new(&splats, camera, false);
    let image = scene.wanted();
    let decided = decided("fog", &image, 0.0);
    assert!(image.blended.iter().all(|n| *n == 2000));
    let g = upstream(&mut random, &decided);
    let want = scene.wanted_gradients(&g).planes();
    let contributions = (gpu.caps().kind != DeviceKind::Cpu).then(|| scene.contributions(&g));
    for variants in Variants::possible(&gpu) {
        let picture = scene.picture(&gpu, variants);
        let off = (0..81).map(|i| (f64::from(picture[4 * i + 3]) / image.transmittance[i] - 1.0).abs());
        let off = off.fold(0.0, f64::max);
        println!(
            "fog, {variants}: transmittance off by {off:.1e}, colour by {:.1e}",
            worst(&image, &decided, &picture)
        );
        assert!(off < 1e-3, "{variants}: transmittance is off by {off:e} of itself");
        let got = scene.gradients(&gpu, variants, &g);
        assert_eq!([got.pairs[1], got.pairs[3]], [81 * 2000; 2], "{variants}: layers blended forward and backward");
        println!("fog, {variants}: gradients of logits {:.1e}", relative(&got.planes[OPACITIES], &want[OPACITIES]));
        let (what, planes) = (format!("fog, {variants}"), [OPACITIES, SH0]);
        match &contributions {
            Some(sizes) => check_sums(&what, &planes, &got.planes, (&want, sizes), FOG),
            None => check(&what, &planes, &got.planes, &want, 1e-3),
        }
        assert_finite("fog", &got.planes);
    }
}

/// The forward pass ends a pixel before the splat that would cross a transmittance of 1e-4. The backward pass ends
/// every pixel at the same splat.
#[test]
fn early_stop_forward_and_backward() {
    let Some(gpu) = common::gpu() else { return };
    let camera = camera(30, 20);
    for seed in [4, 5, 6] {
        let mut random = seeded(seed);
        let splats: Vec<_> = (0..300)
            .map(|_| {
                let at = [random.range(-3.0, 33.0), random.range(-3.0, 23.0)];
                let (z, sigma) = (random.range(1.5, 5.0), random.range(2.0, 8.0));
                let opacity = random.range(0.2, 0.995);
                round(&mut random, &camera, at, z, sigma, opacity)
            })
            .collect();
        let scene = Scene::new(&splats, camera, false);
        let image = scene.wanted();
        let decided = decided("saturated tiles", &image, 0.02);
        let full = vec![1.0f32; 2400];
        for variants in Variants::possible(&gpu) {
            let got = scene.gradients(&gpu, variants, &full);
            assert_eq!(got.pairs[1], got.pairs[3], "{variants}, seed {seed}: blended forward and backward");
        }
        let stopped = |i: &usize| decided[*i] && image.transmittance[*i] < 3e-3 && image.blended[*i] < 60;
        let pixels: Vec<usize> = (0..600).filter(stopped).step_by(90).collect();
        assert!(pixels.len() >= 2, "{} saturated pixels, seed {seed}", pixels.len());
        for pixel in pixels {
            let mut g = vec![0.0f32; 2400];
            g[4 * pixel..4 * pixel + 3].copy_from_slice(&[1.0; 3]);
            let want = scene.wanted_gradients(&g);
            let got = scene.gradients(&gpu, Variants::choose(&gpu, true), &g).planes;
            for (i, splat) in want.splats.iter().enumerate() {
                let lit = splat.sh[0] != [0.0; 3];
                let reached = got[SH0][12 * i..12 * i + 3].iter().any(|v| *v != 0.0);
                assert_eq!(reached, lit, "pixel {pixel}, splat {i}, seed {seed}");
            }
        }
    }
}
