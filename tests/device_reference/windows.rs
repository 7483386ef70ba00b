//! A step on windows of several views. Each window is rendered by a camera of its own, and its gradient is added to the
//! gradients of the views before. Compared with whole images of the views and the distance in the window.

use psrgs_vk::pass::camera::{NEAR, Projection};
use psrgs_vk::pass::counters;
use psrgs_vk::perceptual::{Distance, GradientOf, ImagePair};
use psrgs_vk::raster::{GradientSum, GradientTerms, Planes, RenderView, Renderer, Size, Target, TileShape, Variants};
use psrgs_vk::scene::{Camera, Gaussians};
use psrgs_vk::vk::{Gpu, Memory};

use super::common::plane_scene;
use super::common::splats::seeded;
use super::{NAMES, common};

const SIZE: (u32, u32) = (72, 60);
const SIDE: u32 = 32;
const AT: [(u32, u32); 3] = [(17, 13), (20, 9), (25, 20)];
const WEIGHT: f32 = 3.0;

/// Opaque splats all over the ground: some lie far outside the windows, and large ones reach in.
fn model() -> Gaussians {
    let mut model = plane_scene::splats(900);
    let mut random = seeded(3);
    model.quats.iter_mut().chain(&mut model.scales).for_each(|v| *v += 0.7 * random.symmetric() as f32);
    model.opacities.fill(1.0);
    model
}

struct Views {
    model: Gaussians,
    /// Camera and RGBA.
    seen: Vec<(Camera, Vec<u8>)>,
}

/// Gradients of the model for all views together, from windows or from whole images;
/// and how many pixels show something.
fn gradients(gpu: &Gpu, tile: TileShape, views: &Views, cropped: bool) -> ([Vec<f32>; 8], usize) {
    let variants = Variants::new(tile, GradientSum::Slots);
    let (n, pixels) = (views.model.len() as u32, SIZE.0 * SIZE.1);
    let side = variants.tile.size();
    let tiles = SIZE.0.div_ceil(side) * SIZE.1.div_ceil(side);
    let size = Size::training(n, 40_000, tiles);
    let renderer = Renderer::new(gpu, variants, size).unwrap();
    let (model, grads) = (Planes::new(gpu, "", n).unwrap(), Planes::new(gpu, "g_", n).unwrap());
    model.write(gpu, &views.model).unwrap();
    let target = Target::new(gpu, "", pixels, false).unwrap();
    let windows = Distance::filter_bank(gpu).unwrap().windows(SIDE, SIDE, true).unwrap();
    let grad_image = gpu.buffer("grad_image", 16 * u64::from(pixels), Memory::Device).unwrap();
    let mut words = [0u32; counters::COUNT];
    words[counters::SPLATS] = n;
    let photographs: Vec<_> = views
        .seen
        .iter()
        .map(|(_, rgba)| {
            let buffer = gpu.buffer("photograph", rgba.len() as u64, Memory::Device).unwrap();
            gpu.write(&buffer, rgba).unwrap();
            buffer
        })
        .collect();
    let mut rec = gpu.recorder("windows").unwrap();
    rec.upload(&renderer.counters, 0, bytemuck::cast_slice(&words)).unwrap();
    for (k, ((camera, _), photograph)) in views.seen.iter().zip(&photographs).enumerate() {
        let projection = Projection {
            sh_degree: 1,
            near: NEAR,
            antialias: false,
            reference_clamp: true,
            black_learns: false,
            orthographic: false,
            limits: None,
            alpha_cutoff: None,
        };
        let whole = RenderView { camera: *camera, projection, background: [0.0; 3] };
        let shot = if cropped { whole.window(AT[k], (SIDE, SIDE)) } else { whole };
        let lists = renderer.record_forward(&mut rec, &model, &shot, &target, false).unwrap();
        rec.fill(&grad_image, 0).unwrap();
        let pair = ImagePair { image: &target.image, photograph, size: SIZE, at: AT[k], cropped };
        windows.record(&mut rec, &pair, Some(&GradientOf { image: &grad_image, weight: WEIGHT })).unwrap();
        renderer.record_blend_backward(&mut rec, &lists, &grad_image, &shot, &target).unwrap();
        let terms = GradientTerms { add: k > 0, ..GradientTerms::default() };
        renderer.record_project_backward_of(&mut rec, &model, &grads, &shot, terms).unwrap();
    }
    rec.submit().unwrap();
    let image: Vec<[f32; 4]> = gpu.read(&target.image).unwrap();
    let drawn = if cropped { SIDE * SIDE } else { pixels };
    let shown = image[..drawn as usize].iter().filter(|p| p[3] < 0.5).count();
    (grads.read(gpu, n).unwrap(), shown)
}

#[test]
fn gradients_of_windows_are_those_of_whole_images() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(3, SIZE.0, SIZE.1, 0);
    let rgba = |view: &psrgs_vk::train::View| view.photograph.pixels().expect("in memory").rgba8().to_vec();
    let seen = input.train.iter().map(|view| (view.camera, rgba(view))).collect();
    let views = Views { model: model(), seen };
    for tile in [TileShape::Column, TileShape::Pixel] {
        let (whole, _) = gradients(&gpu, tile, &views, false);
        let (windows, shown) = gradients(&gpu, tile, &views, true);
        assert!(shown > 200, "{shown} pixels of the last window show something");
        // Coefficients of degree 1 lie in the first plane of harmonics; the planes above have no gradient.
        for p in 0..5 {
            let largest = whole[p].iter().fold(0.0f32, |m, v| m.max(v.abs()));
            assert!(largest > 0.0, "{tile:?}: {} have no gradient", NAMES[p]);
            for (k, (got, want)) in windows[p].iter().zip(&whole[p]).enumerate() {
                let wrong = (got - want).abs();
                assert!(wrong <= 1e-4 * largest, "{tile:?}: {} {k}: {got} instead of {want}", NAMES[p]);
            }
        }
    }
    // The test can fail: a single view has other gradients.
    let one = Views { seen: views.seen[..1].to_vec(), model: views.model.clone() };
    let (alone, _) = gradients(&gpu, TileShape::Column, &one, true);
    let (all, _) = gradients(&gpu, TileShape::Column, &views, true);
    assert_ne!(alone[0], all[0]);
    gpu.check_canaries().unwrap();
    common::assert_no_messages(&gpu);
}
