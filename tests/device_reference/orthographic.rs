//! Renders under parallel rays, as those of a map: against the brute-force renderer, and windows against the whole.

use psrgs_vk::pass::camera::Projection;
use psrgs_vk::raster::{DepthProbe, GradientSum, Picture, RenderView, Variants, Viewer};
use psrgs_vk::scene::{Camera, Gaussians};
use psrgs_vk::twin::reference::{self, Settings};
use psrgs_vk::twin::splat::Splat;
use psrgs_vk::vk::Gpu;

use super::common::splats::{seeded, vector};
use super::{Case, SHAPES, common};

/// Looks down along z, with y as north. Focal lengths are pixels per scene unit.
fn from_above(width: u32, height: u32, focal: f64) -> Camera {
    Camera {
        rotation: [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
        translation: [0.0, 0.0, 4.0],
        fx: focal,
        fy: focal,
        cx: f64::from(width / 2),
        cy: f64::from(height / 2),
        width,
        height,
    }
}

/// Splats about the middle of a picture `reach` pixels wide and high, at steps of a pixel, so that double precision
/// rounds their positions to the same steps.
fn scattered(splats: usize, reach: f64, focal: f64, seed: u64) -> Gaussians {
    let mut random = seeded(seed);
    let mut model = Gaussians::zeros(splats);
    for i in 0..splats {
        let [x, y, z] = vector(&mut random);
        let on_step = |v: f64| (v * reach / 2.0 * 1024.0).round() / 1024.0 / focal;
        let size = random.range(-3.2, -1.2);
        let splat = Splat {
            mean: [on_step(x), on_step(y), 2.0 * z],
            quat: std::array::from_fn(|_| 1.5 * random.symmetric()),
            log_scale: std::array::from_fn(|_| size + 0.6 * random.symmetric()),
            logit: random.range(-1.5, 2.0),
            sh: std::array::from_fn(|k| vector(&mut random).map(|v| v * if k == 0 { 1.5 } else { 0.25 })),
        };
        splat.store(&mut model, i);
    }
    model
}

fn surface(gpu: &Gpu, case: (&Gaussians, &RenderView), variants: Variants) -> (Picture, DepthProbe) {
    let mut viewer = Viewer::with_variants(gpu, variants);
    let planes = viewer.upload(case.0).unwrap();
    viewer.surface(&planes, case.0.len() as u32, case.1).unwrap()
}

#[test]
fn maps_agree_with_the_brute_force_renderer() {
    let Some(gpu) = common::gpu() else { return };
    for (k, antialias) in [false, true].into_iter().enumerate() {
        let camera = from_above(61, 45, 16.0);
        let model = scattered(200, 70.0, 16.0, 400 + k as u64);
        let (sh_degree, background) = (3 - k as u32, [0.25f32, 0.5, 0.75]);
        let projection = Projection { sh_degree, antialias, orthographic: true, ..Projection::default() };
        let settings = Settings {
            sh_degree,
            antialias,
            orthographic: true,
            near: f64::from(projection.near as f32),
            background: background.map(f64::from),
            ..Settings::default()
        };
        let splats = Splat::all(&model);
        let image = reference::render(&splats, &camera, &settings);
        assert!(image.blended.iter().sum::<u32>() > 10_000, "little is seen");
        let shot = RenderView { camera, projection, background };
        let case = Case { name: format!("a map, antialias {antialias}"), model, shot, settings, splats, image };
        for tile in SHAPES {
            case.check_picture(&gpu, tile, 6.0);
        }
    }
    gpu.check_canaries().unwrap();
    common::assert_no_messages(&gpu);
}

/// A turned view of a model with splats at no step, near the origin and thousands of pixels off.
#[test]
fn windows_of_a_map_have_the_bits_of_the_whole() {
    let Some(gpu) = common::gpu() else { return };
    let (a, b) = (0.4f64, 0.3f64);
    let (sa, ca, sb, cb) = (a.sin(), a.cos(), b.sin(), b.cos());
    for (focal, far) in [(23.7, 0.0), (23.7, -8191.0)] {
        let mut model = scattered(1200, 230.0, focal, 500);
        let (cx, cy) = (96.0 + far, 64.0 - far);
        let camera = Camera {
            rotation: [[ca, sa, 0.0], [sa * cb, -ca * cb, -sb], [-sa * sb, ca * sb, -cb]],
            translation: [0.013 - far / focal, 0.007 + far / focal, 5.0],
            ..Camera { cx, cy, ..from_above(192, 128, focal) }
        };
        model.means.iter_mut().for_each(|v| *v *= 1.000_37);
        let projection = Projection { orthographic: true, antialias: far == 0.0, ..Projection::default() };
        let view = RenderView { camera, projection, background: [0.1, 0.2, 0.3] };
        for tile in SHAPES {
            let variants = Variants::new(tile, GradientSum::Slots);
            let (whole, depths) = surface(&gpu, (&model, &view), variants);
            assert!(depths.median.iter().filter(|z| **z > 0.0).count() > 5000, "little is seen");
            for (w, h) in [(64u32, 32u32), (96, 128), (16, 16)] {
                for (left, top) in (0..192 / w).flat_map(|x| (0..128 / h).map(move |y| (x * w, y * h))) {
                    let window = view.window((left, top), (w, h));
                    let (picture, probe) = surface(&gpu, (&model, &window), variants);
                    for k in 0..w * h {
                        let at = ((top + k / w) * 192 + left + k % w) as usize;
                        let (k, bits) = (k as usize, |v: &[f32]| v.iter().map(|v| v.to_bits()).collect::<Vec<_>>());
                        let (got, want) = (&picture.rgbt[4 * k..4 * k + 4], &whole.rgbt[4 * at..4 * at + 4]);
                        assert_eq!(bits(got), bits(want), "{tile:?}, {w}x{h} at {left} {top}: pixel {k}");
                        assert_eq!(probe.median[k].to_bits(), depths.median[at].to_bits(), "depth of pixel {k}");
                    }
                }
            }
        }
    }
}
