//! The gradient-map loss of the constrained set beside the full set, against the photograph and against the full render. The gradients that the device adds to those of the
//! model are compared with f64 renderer, loss and backward pass, and the f64 gradients with differences of the loss.

use psrgs_vk::loss::{GradientMapLoss, GradientMapWeights, MapImages, Photograph};
use psrgs_vk::pass::constrain::{ADD, KEEP};
use psrgs_vk::pass::gradient_map::{Push, windows};
use psrgs_vk::pass::{counters, loss};
use psrgs_vk::raster::{GradientSum, Part, Planes, Renderer, Size, Subset, Target, TileShape, Variants};
use psrgs_vk::twin::gradient_map::Scene;
use psrgs_vk::twin::loss::{counting, unpack};
use psrgs_vk::twin::reference::{self, Image, ImageGradient};
use psrgs_vk::twin::splat::Splat;
use psrgs_vk::vk::{Gpu, Memory, slices};

use super::common::guards::Guards;
use super::common::splats::seeded;
use super::{Case, FLOOR, NAMES, case, common};

/// Identities below this are constrained: every third splat.
const BOUND: u32 = 1000;
const WEIGHT: f32 = 0.7;

fn constrained(i: usize) -> bool {
    i.is_multiple_of(3)
}

/// A photograph of noise over a slope, masked where a render is near a decision.
fn photograph(images: &[&Image], width: u32) -> Vec<u32> {
    let mut random = seeded(5);
    let pixel = |k: usize| {
        let slope = 90.0 * (k as u32 % width) as f64 / f64::from(width);
        let [r, g, b] = std::array::from_fn(|_| (slope + 60.0 * (1.0 + random.symmetric())) as u32);
        r | g << 8 | b << 16 | u32::from(images.iter().all(|image| image.margin[k] > super::BAND)) << 24
    };
    (0..images[0].margin.len()).map(pixel).collect()
}

/// The loss of an image in f64, against the photograph or another image.
fn scene(case: &Case, target: &[u32], image: &Image, other: Option<&Image>) -> Scene<'static, f64> {
    let (width, height) = (case.shot.camera.width, case.shot.camera.height);
    let masked = target.iter().filter(|t| **t >> 24 == 0).count() as u32;
    let push = Push {
        width,
        height,
        mask_width: 0,
        mask_height: 0,
        weight: WEIGHT,
        tv_weight: 0.0,
        values: loss::values(width, height, masked),
    };
    let rows = |image: &Image| -> Vec<[f64; 4]> {
        let row = |(c, t): (&[f64; 3], &f64)| [c[0], c[1], c[2], *t];
        image.colour.iter().zip(&image.transmittance).map(row).collect()
    };
    Scene {
        push,
        variation: false,
        image: rows(image),
        photo: unpack(target, 8),
        other: other.map(rows),
        counts: counting(target, 8),
        mask: None,
    }
}

/// Gradient of the loss with respect to the splats of a render, against the photograph or another image.
fn wanted(case: &Case, splats: &[Splat<f64>], target: &[u32], other: Option<&Image>) -> [Vec<f64>; 8] {
    let image = reference::render(splats, &case.shot.camera, &case.settings);
    let scene = scene(case, target, &image, other);
    let pixels = image.colour.len();
    let maps: Vec<_> = (0..pixels).map(|k| scene.sobel(k)).collect();
    let windows: Vec<_> =
        (0..windows(scene.push.width, scene.push.height) as usize).map(|w| scene.window(&maps, w)).collect();
    let flows = Scene::flows(&maps, &windows);
    let [r, m] = windows.iter().fold([0.0; 2], |[r, m], w| [r + w.row[0], m + w.row[1]]);
    let mut upstream = ImageGradient::zeros(pixels);
    for k in 0..pixels {
        upstream.colour[k] = scene.grad_row(&flows, &[r, m, 0.0, 0.0], k).1;
    }
    reference::backward(splats, &case.shot.camera, &case.settings, &upstream).planes()
}

/// The passes of a training step with both sets. Their renders are compared with each other if `both`, else the full set
/// has no loss here.
fn on_device(gpu: &Gpu, tile: TileShape, case: &Case, target: &[u32], both: bool) -> [Vec<f32>; 8] {
    let variants = Variants::new(tile, GradientSum::Slots);
    let n = case.model.len() as u32;
    let (width, height) = (case.shot.camera.width, case.shot.camera.height);
    let side = variants.tile.size();
    let tiles = width.div_ceil(side) * height.div_ceil(side);
    let size = Size { clamp_gradient_passes: false, ..Size::training(n, 40_000, tiles) };
    let renderer = Renderer::new(gpu, variants, size).unwrap();
    let (model, grads) = (Planes::new(gpu, "", n).unwrap(), Planes::new(gpu, "g_", n).unwrap());
    model.write(gpu, &case.model).unwrap();
    let shown = Target::new(gpu, "", width * height, false).unwrap();
    let upload = |name: &str, bytes: &[u8]| {
        let buffer = gpu.buffer(name, bytes.len() as u64, Memory::Device).unwrap();
        gpu.write(&buffer, bytes).unwrap();
        buffer
    };
    let ids: Vec<u32> = (0..n).map(|i| if constrained(i as usize) { i } else { BOUND + i }).collect();
    let ids = upload("ids", bytemuck::cast_slice(&ids));
    let buffer = upload("photograph", bytemuck::cast_slice(target));
    let grad_image = upload("grad_image", &vec![0; 16 * (width * height) as usize]);
    let kept = upload("kept", &vec![0; 48 * n as usize]);
    let other = both.then(|| upload("other", &vec![0; 16 * (width * height) as usize]));
    let bytes = 16 * u64::from(width * height);
    let mut words = [0u32; counters::COUNT];
    (words[counters::SPLATS], words[counters::CONSTRAINED]) = (n, BOUND);
    let masked = target.iter().filter(|t| **t >> 24 == 0).count() as u32;
    let values = loss::values(width, height, masked);
    let compared =
        Photograph { buffer: &buffer, bits: 8, size: (width, height), values, part_values: values, mask: None };
    let maps = GradientMapLoss::new(gpu, &[(width, height)]).unwrap();

    let mut rec = gpu.recorder("both sets").unwrap();
    rec.upload(&renderer.counters, 0, bytemuck::cast_slice(&words)).unwrap();
    if let Some(other) = &other {
        renderer.record_forward(&mut rec, &model, &case.shot, &shown, false).unwrap();
        rec.copy(&shown.image, 0, other, 0, bytes).unwrap();
    }
    let subset = Subset { ids: &ids, part: Part::Low };
    let lists = renderer.record_forward_of(&mut rec, &model, &case.shot, &shown, false, Some(subset)).unwrap();
    let weights = GradientMapWeights { correlation: WEIGHT, variation: 0.0 };
    let images = MapImages { image: &shown.image, other: other.as_ref() };
    maps.record(&mut rec, images, &compared, &weights, &grad_image).unwrap();
    renderer.record_blend_backward(&mut rec, &lists, &grad_image, &case.shot, &shown).unwrap();
    if let Some(other) = &other {
        rec.copy(&shown.image, 0, other, 0, bytes).unwrap();
    }
    let grad2d = renderer.grad2d().unwrap();
    let [counts, tile_counts, held] = slices([&renderer.counters, &renderer.tile_counts, &kept]);
    let keep = gpu.pipeline(&KEEP.kernel, &[]).unwrap();
    rec.dispatch(&keep, &[counts, tile_counts, grad2d, held], &(), renderer.per_splat()).unwrap();
    let lists = renderer.record_forward(&mut rec, &model, &case.shot, &shown, false).unwrap();
    rec.fill(&grad_image, 0).unwrap();
    if both {
        maps.record(&mut rec, images, &compared, &weights, &grad_image).unwrap();
    }
    renderer.record_blend_backward(&mut rec, &lists, &grad_image, &case.shot, &shown).unwrap();
    let add = gpu.pipeline(&ADD.kernel, &[]).unwrap();
    rec.dispatch(&add, &[counts, tile_counts, held, grad2d], &(), renderer.per_splat()).unwrap();
    renderer.record_project_backward(&mut rec, &model, &grads, &case.shot).unwrap();
    rec.submit().unwrap();
    grads.read(gpu, n).unwrap()
}

/// A splat's row of a plane among those of the model.
fn spread(rows: &[f64], of: usize, chosen: &[usize], splats: usize) -> Vec<f64> {
    let mut out = vec![0.0; of * splats];
    for (from, to) in chosen.iter().enumerate() {
        out[of * to..of * (to + 1)].copy_from_slice(&rows[of * from..of * (from + 1)]);
    }
    out
}

/// Splats whose constrained set has a part in every pixel.
fn dense() -> (Case, Vec<usize>) {
    let mut case = case((61, 45), 1, false, 300, 77);
    case.model.opacities.iter_mut().for_each(|o| *o = o.abs() + 0.3);
    case.splats = Splat::all(&case.model);
    let chosen = (0..case.splats.len()).filter(|i| constrained(*i)).collect();
    (case, chosen)
}

fn of_set(splats: &[Splat<f64>], chosen: &[usize]) -> Vec<Splat<f64>> {
    chosen.iter().map(|i| splats[*i].clone()).collect()
}

/// Differences of the loss through renders and maps, for parameters of splats with large gradients.
fn agree_with_differences(want: &[Vec<f64>; 8], splats: &[Splat<f64>], value: impl Fn(&[Splat<f64>]) -> f64) {
    let mut checked = 0;
    for (plane, row, at) in [(0, 3, 0), (2, 3, 7), (3, 1, 10), (4, 12, 11)] {
        let mut largest: Vec<usize> = (0..want[plane].len()).collect();
        largest.sort_by(|a, b| want[plane][*b].abs().total_cmp(&want[plane][*a].abs()));
        for k in largest.into_iter().take(4) {
            let h = 1e-6;
            let moved = |by: f64| {
                let mut splats = splats.to_vec();
                let mut values = splats[k / row].to_array();
                values[at + k % row] += by;
                splats[k / row] = Splat::from_array(&values);
                value(&splats)
            };
            let slope = (moved(h) - moved(-h)) / (2.0 * h);
            let close = (slope - want[plane][k]).abs() <= 1e-3 * want[plane][k].abs();
            assert!(want[plane][k] != 0.0, "{}: no gradient", NAMES[plane]);
            // A pixel that crosses a decision between both evaluations has another slope; few pixels do.
            checked += usize::from(close);
        }
    }
    assert!(checked >= 14, "only {checked} of 16 derivatives agree with the loss");
}

/// The gradients of the device's passes against those of all splats in f64.
fn agree_with_device(gpu: &Gpu, case: &Case, target: &[u32], both: bool, want: &[Vec<f64>; 8]) {
    for tile in [TileShape::Column, TileShape::Pixel] {
        let got = on_device(gpu, tile, case, target, both);
        for p in 0..5 {
            let name = format!("{tile:?}, {}", NAMES[p]);
            Guards { floor: FLOOR, ..Guards::of(1e-3) }.check(&name, got[p].len(), &got[p], &want[p]);
        }
    }
    gpu.check_canaries().unwrap();
    common::assert_no_messages(gpu);
}

/// Gradients of the constrained splats among those of all.
fn among_all(of_set: &[Vec<f64>; 8], chosen: &[usize], splats: usize) -> [Vec<f64>; 8] {
    std::array::from_fn(|p| spread(&of_set[p], of_set[p].len() / chosen.len(), chosen, splats))
}

#[test]
fn gradients_of_constrained_splats_agree_with_brute_force() {
    let Some(gpu) = common::gpu() else { return };
    let (case, chosen) = dense();
    let alone = of_set(&case.splats, &chosen);
    let render = |splats: &[Splat<f64>]| reference::render(splats, &case.shot.camera, &case.settings);
    let target = photograph(&[&render(&alone)], case.shot.camera.width);
    let want = wanted(&case, &alone, &target, None);
    agree_with_differences(&want, &alone, |splats| scene(&case, &target, &render(splats), None).value()[0]);
    agree_with_device(&gpu, &case, &target, false, &among_all(&want, &chosen, case.splats.len()));
}

#[test]
fn gradients_of_two_renders_agree_with_brute_force() {
    let Some(gpu) = common::gpu() else { return };
    let (case, chosen) = dense();
    let render = |splats: &[Splat<f64>]| reference::render(splats, &case.shot.camera, &case.settings);
    let alone = of_set(&case.splats, &chosen);
    let (full, low) = (render(&case.splats), render(&alone));
    let target = photograph(&[&full, &low], case.shot.camera.width);
    // Splats of the constrained set are in both renders.
    let mut want = wanted(&case, &case.splats, &target, Some(&low));
    let of_low = among_all(&wanted(&case, &alone, &target, Some(&full)), &chosen, case.splats.len());
    for (sum, more) in want.iter_mut().flatten().zip(of_low.iter().flatten()) {
        *sum += more;
    }
    let value = |splats: &[Splat<f64>]| {
        let low = render(&of_set(splats, &chosen));
        scene(&case, &target, &render(splats), Some(&low)).value()[0]
    };
    assert!(value(&case.splats) > 0.05, "both renders are alike");
    agree_with_differences(&want, &case.splats, value);
    agree_with_device(&gpu, &case, &target, true, &want);
}
