//! Whole images and gradients of the device against the brute-force f64 renderer, which shares no arithmetic with the
//! device.

#[path = "../common/mod.rs"]
mod common;
mod constrained;
mod geometry;
mod orthographic;
mod shortcuts;
mod windows;

use common::guards::Guards;
use common::splats::{camera, rounded, seeded, spread};
use psrgs_vk::pass::camera::{NEAR, Projection};
use psrgs_vk::pass::{adam, counters, project_backward_adam as fused};
use psrgs_vk::raster::{self, GradientSum, Planes, RenderView, Renderer, Size, Target, TileShape, Variants, Viewer};
use psrgs_vk::scene::Gaussians;
use psrgs_vk::twin::project::project;
use psrgs_vk::twin::reference::{self, Image, ImageGradient, Settings};
use psrgs_vk::twin::splat::{Splat, TwinCamera};
use psrgs_vk::vk::{Gpu, Memory};

const SHAPES: [TileShape; 2] = [TileShape::Column, TileShape::Pixel];
/// Pixels nearer than this to a decision are left out: 16 roundings to f32, in units of the decision's condition.
const BAND: f64 = 16.0 / (1u64 << 24) as f64;
/// Largest share of the image that may be left out.
const MOST_LEFT_OUT: f64 = 0.005;
/// Largest error of colour, transmittance, normal sum, and depth sum in units of the farthest depth.
const IMAGE_ERROR: f64 = 2e-5;

/// A model and its image by the f64 renderer.
struct Case {
    name: String,
    model: Gaussians,
    shot: RenderView,
    settings: Settings,
    splats: Vec<Splat<f64>>,
    image: Image,
}

/// Ratio of the axes of the projected ellipse; 1 for a splat that is not seen.
fn aspect(splat: &Splat<f64>, view: &TwinCamera<f64>) -> f64 {
    let Ok(p) = project(splat, view, None) else { return 1.0 };
    let [a, b, c] = p.conic;
    let (middle, reach) = ((a + c) / 2.0, (((a - c) / 2.0).powi(2) + b * b).sqrt());
    ((middle + reach) / (middle - reach)).sqrt()
}

fn case(size: (u32, u32), sh_degree: u32, antialias: bool, splats: usize, seed: u64) -> Case {
    let camera = rounded(camera(size.0, size.1));
    let projection = Projection { sh_degree, antialias, ..Projection::default() };
    let view = TwinCamera::<f64>::exact(&camera, &projection);
    let mut random = seeded(seed);
    let mut model = Gaussians::zeros(splats);
    let mut before = None;
    for i in 0..splats {
        let splat = loop {
            let mut splat = spread(&mut random, &camera, 1.3);
            // Some centres occur twice: identities then decide which splat is in front.
            if let Some(mean) = before.filter(|_| i % 10 == 9) {
                splat.mean = mean;
            }
            if aspect(&splat, &view) <= 10.0 {
                break splat;
            }
        };
        before = Some(splat.mean);
        splat.store(&mut model, i);
    }
    let background = [0.25f32, 0.5, 0.75];
    let settings = Settings {
        sh_degree,
        near: f64::from(NEAR as f32),
        antialias,
        background: background.map(f64::from),
        ..Settings::default()
    };
    let splats = Splat::all(&model);
    let image = reference::render(&splats, &camera, &settings);
    let name = format!("{}x{}, SH {sh_degree}, antialias {antialias}", size.0, size.1);
    Case { name, model, shot: RenderView { camera, projection, background }, settings, splats, image }
}

/// Sizes that are and are not multiples of the tiles, every SH degree, with and without anti-aliasing.
fn cases(splats: usize) -> Vec<Case> {
    let mut out = Vec::new();
    for (k, size) in [(64, 64), (61, 45), (97, 34), (7, 50)].into_iter().enumerate() {
        for antialias in [false, true] {
            let degree = (k as u32 + 2 * u32::from(antialias)) % 4;
            out.push(case(size, degree, antialias, splats, 100 + out.len() as u64));
        }
    }
    out
}

impl Case {
    /// Which pixels are away from every decision.
    fn decided(&self) -> Vec<bool> {
        let decided: Vec<bool> = self.image.margin.iter().map(|m| *m > BAND).collect();
        let left_out = decided.iter().filter(|d| !**d).count();
        let share = left_out as f64 / decided.len() as f64;
        assert!(share < MOST_LEFT_OUT, "{}: {left_out} of {} pixels are near a decision", self.name, decided.len());
        decided
    }

    /// Compares what the device draws with the brute-force renderer; `far` is the unit of depths.
    fn check_picture(&self, gpu: &Gpu, tile: TileShape, far: f64) {
        let mut viewer = Viewer::with_variants(gpu, Variants::new(tile, GradientSum::Slots));
        let planes = viewer.upload(&self.model).unwrap();
        let picture = viewer.render(&planes, self.model.len() as u32, &self.shot, true).unwrap();
        let (image, aux) = (&self.image, picture.aux.as_ref().unwrap());
        for c in 0..3 {
            self.check("colour", tile, 1.0, |i| image.colour[i][c], |i| picture.rgbt[4 * i + c]);
            self.check("normal", tile, 1.0, |i| image.normal[i][c], |i| aux[4 * i + 1 + c]);
        }
        self.check("transmittance", tile, 1.0, |i| image.transmittance[i], |i| picture.rgbt[4 * i + 3]);
        self.check("depth", tile, far, |i| image.depth[i], |i| aux[4 * i]);
    }

    /// The largest error over the decided pixels of some channels.
    fn check(&self, what: &str, shape: TileShape, unit: f64, want: impl Fn(usize) -> f64, got: impl Fn(usize) -> f32) {
        let (mut worst, mut at) = (0.0, 0);
        for (i, _) in self.decided().into_iter().enumerate().filter(|(_, d)| *d) {
            let error = (f64::from(got(i)) - want(i)).abs() / unit;
            if error.is_nan() || error > worst {
                (worst, at) = (error, i);
            }
        }
        let (g, w) = (got(at), want(at));
        assert!(
            worst < IMAGE_ERROR,
            "{}, {shape:?}, {what} at pixel {at}: {g} against {w}, off by {worst:e}",
            self.name
        );
    }
}

#[test]
fn images_agree_with_the_brute_force_renderer() {
    let Some(gpu) = common::gpu() else { return };
    let mut seen = 0;
    for case in cases(200) {
        seen += case.image.blended.iter().sum::<u32>();
        let far = case.splats.iter().flat_map(|s| s.mean).fold(1.0f64, |m, v| m.max(v.abs()));
        for tile in SHAPES {
            case.check_picture(&gpu, tile, far);
        }
    }
    assert!(seen > 100_000, "only {seen} splats blended in all");
    gpu.check_canaries().unwrap();
    common::assert_no_messages(&gpu);
}

/// Every splat covers the whole image: more pairs than a viewer has room for at first.
#[test]
fn pictures_are_whole_when_the_pairs_had_to_grow() {
    let Some(gpu) = common::gpu() else { return };
    let mut case = case((64, 64), 1, false, 60, 3);
    case.model.scales.fill(0.4);
    case.model.opacities.fill(-2.5);
    case.splats = Splat::all(&case.model);
    case.image = reference::render(&case.splats, &case.shot.camera, &case.settings);
    for tile in SHAPES {
        let tiles = (64 / tile.size()).pow(2);
        let mut viewer = Viewer::with_variants(&gpu, Variants::new(tile, GradientSum::Slots));
        let planes = viewer.upload(&case.model).unwrap();
        let submits = gpu.stats().submits;
        let picture = viewer.render(&planes, 60, &case.shot, false).unwrap();
        assert!(gpu.stats().submits > submits + 3, "nothing had to grow");
        assert!(case.image.blended.iter().sum::<u32>() > 30 * tiles * tile.size().pow(2));
        for c in 0..3 {
            case.check("colour", tile, 1.0, |i| case.image.colour[i][c], |i| picture.rgbt[4 * i + c]);
        }
    }
}

/// How the device computes gradients of the planes.
#[derive(Clone, Copy, PartialEq)]
enum Way {
    /// By the passes that write gradients.
    Written,
    /// From the first moments after a fused step from zero moments: a tenth of the gradients.
    Fused,
}

/// Gradients of the planes, for upstream gradients of colour and, with `grad_aux`, of the auxiliary channels.
fn device_gradients(
    gpu: &Gpu,
    (variants, way): (Variants, Way),
    case: &Case,
    grad_image: &[f32],
    grad_aux: Option<&[f32]>,
) -> [Vec<f32>; 8] {
    let aux = grad_aux.is_some();
    let n = case.model.len() as u32;
    let (width, height) = (case.shot.camera.width, case.shot.camera.height);
    let side = variants.tile.size();
    let size = Size {
        aux,
        clamp_gradient_passes: false,
        ..Size::training(n, 40_000, width.div_ceil(side) * height.div_ceil(side))
    };
    let renderer = Renderer::new(gpu, variants, size).unwrap();
    let (model, grads) = (Planes::new(gpu, "", n).unwrap(), Planes::new(gpu, "g_", n).unwrap());
    let target = Target::new(gpu, "", width * height, aux).unwrap();
    let upstream = gpu.buffer("grad_image", 4 * grad_image.len() as u64, Memory::Device).unwrap();
    model.write(gpu, &case.model).unwrap();
    gpu.write(&upstream, grad_image).unwrap();
    let upstream_aux = gpu.buffer("grad_aux", 4 * grad_image.len() as u64, Memory::Device).unwrap();
    if let Some(values) = grad_aux {
        gpu.write(&upstream_aux, values).unwrap();
    }
    let mut words = [0u32; counters::COUNT];
    words[counters::SPLATS] = n;
    let mut rec = gpu.recorder("forward and backward").unwrap();
    rec.upload(&renderer.counters, 0, bytemuck::cast_slice(&words)).unwrap();
    let unset = if way == Way::Written { f32::NAN } else { 0.0 };
    for buffer in grads.buffers() {
        rec.fill(buffer, unset.to_bits()).unwrap();
    }
    rec.fill(renderer.grad2d().unwrap(), f32::NAN.to_bits()).unwrap();
    assert_eq!(renderer.grad_normals().is_some(), aux);
    if let Some(grad_normals) = renderer.grad_normals() {
        rec.fill(grad_normals, f32::NAN.to_bits()).unwrap();
    }
    let lists = renderer.record_forward(&mut rec, &model, &case.shot, &target, aux).unwrap();
    let of_image = raster::ImageGradients { of_image: &upstream, of_aux: aux.then_some(&upstream_aux) };
    if way == Way::Written {
        let gradients = raster::Gradients { model: &model, of_model: &grads, of_image };
        renderer.record_backward(&mut rec, &lists, &gradients, &case.shot, &target).unwrap();
    } else {
        renderer.record_blend_backward(&mut rec, &lists, of_image, &case.shot, &target).unwrap();
        let settings = adam::AdamSettings::default();
        let rates =
            fused::LearningRates { means: 0.0, quats: 0.0, scales: 0.0, opacities: 0.0, sh_base: 0.0, sh_rest: 0.0 };
        let second = Planes::new(gpu, "v_", n).unwrap();
        second.clear(&mut rec).unwrap();
        let stats = gpu.buffer("stats", 16 * u64::from(n), Memory::Device).unwrap();
        let step = raster::BackwardStep {
            model: &model,
            moments: &[grads.clone(), second],
            pipeline: &gpu.pipeline(&fused::PASS.kernel, &fused::constants(&settings, 3, aux)).unwrap(),
            settings: &settings,
            rates: &rates,
            steps: fused::StepCounts { most: 1, opacities: Some(1) },
            decides: false,
            stats: &stats,
            catches_up: false,
        };
        renderer.record_backward_step(&mut rec, &step, &case.shot).unwrap();
    }
    rec.submit().unwrap();
    let words: Vec<u32> = gpu.read(&renderer.counters).unwrap();
    assert_eq!(words[counters::STATUS], 0, "the pairs were meant to fit: {}", words[counters::PAIRS]);
    let planes = grads.read(gpu, n).unwrap();
    if way == Way::Written { planes } else { planes.map(|plane| plane.iter().map(|m| 10.0 * m).collect()) }
}

/// An element below this share of its plane's largest is judged against that share. Behind many splats a gradient is a
/// small difference of large numbers and has their rounding.
const FLOOR: f64 = 1e-3;
/// Bounds for each row by itself: no row is zero or wrong by a factor.
const ROW: Guards = Guards { element: 2e-2, ..Guards::of(1e-3) };
const ROWS: [usize; 8] = [3, 4, 3, 1, 12, 12, 12, 12];
const NAMES: [&str; 8] = ["means", "quats", "scales", "opacities", "sh0", "sh1", "sh2", "sh3"];

#[test]
fn gradients_agree_with_the_brute_force_renderer() {
    let Some(gpu) = common::gpu() else { return };
    for (k, case) in cases(200).into_iter().enumerate() {
        let decided = case.decided();
        let mut random = seeded(1000 + k as u64);
        let mut upstream = ImageGradient::zeros(decided.len());
        let mut grad_image = vec![0.0f32; 4 * decided.len()];
        for i in (0..decided.len()).filter(|i| decided[*i]) {
            let values: [f32; 4] = std::array::from_fn(|_| random.symmetric() as f32);
            grad_image[4 * i..4 * i + 4].copy_from_slice(&values);
            upstream.colour[i] = std::array::from_fn(|c| f64::from(values[c]));
            upstream.transmittance[i] = f64::from(values[3]);
        }
        let gradients = reference::backward(&case.splats, &case.shot.camera, &case.settings, &upstream);
        let want = gradients.planes();
        assert!(want[..5].iter().all(|plane| plane.iter().filter(|v| **v != 0.0).count() > 40));
        for variants in Variants::possible(&gpu) {
            let got = device_gradients(&gpu, (variants, Way::Written), &case, &grad_image, None);
            for p in 0..8 {
                let name = format!("{}, {variants:?}, {}", case.name, NAMES[p]);
                Guards { floor: FLOOR, ..Guards::of(1e-3) }.check(&name, got[p].len(), &got[p], &want[p]);
                ROW.check(&name, ROWS[p], &got[p], &want[p]);
            }
        }
    }
    gpu.check_canaries().unwrap();
    common::assert_no_messages(&gpu);
}

/// Also with gradients of depth and normals, by every variant of the backward blending, and by the fused step.
#[test]
fn gradients_of_depth_and_normals_agree_with_brute_force() {
    let Some(gpu) = common::gpu() else { return };
    for (k, case) in [case((61, 45), 1, false, 200, 301), case((34, 40), 2, true, 200, 302)].into_iter().enumerate() {
        let decided = case.decided();
        let far = case.splats.iter().flat_map(|s| s.mean).fold(1.0f64, |m, v| m.max(v.abs()));
        let mut random = seeded(2000 + k as u64);
        let mut upstream = ImageGradient::zeros(decided.len());
        let mut grad_image = vec![0.0f32; 4 * decided.len()];
        let mut grad_aux = grad_image.clone();
        for i in (0..decided.len()).filter(|i| decided[*i]) {
            let values: [f32; 8] =
                std::array::from_fn(|c| (random.symmetric() / if c == 4 { far } else { 1.0 }) as f32);
            let [colour, aux] = [&values[..4], &values[4..]];
            grad_image[4 * i..4 * i + 4].copy_from_slice(colour);
            grad_aux[4 * i..4 * i + 4].copy_from_slice(aux);
            upstream.colour[i] = std::array::from_fn(|c| f64::from(colour[c]));
            upstream.transmittance[i] = f64::from(colour[3]);
            upstream.depth[i] = f64::from(aux[0]);
            upstream.normal[i] = std::array::from_fn(|c| f64::from(aux[1 + c]));
        }
        let want = reference::backward(&case.splats, &case.shot.camera, &case.settings, &upstream).planes();
        let without = ImageGradient { depth: vec![0.0; decided.len()], ..upstream.clone() };
        let without = reference::backward(&case.splats, &case.shot.camera, &case.settings, &without).planes();
        let moved = |p: usize| want[p].iter().zip(&without[p]).filter(|(a, b)| (*a - *b).abs() > 0.01).count();
        assert!(moved(0) > 40 && moved(3) > 20, "the depth makes too little difference: {} {}", moved(0), moved(3));
        let stepped = SHAPES.map(|tile| (Variants::new(tile, GradientSum::Slots), Way::Fused));
        let written = Variants::possible(&gpu).into_iter().map(|variants| (variants, Way::Written));
        for (variants, way) in written.chain(stepped) {
            if way == Way::Fused && gpu.caps().limits.storage_buffers < fused::BINDINGS {
                continue;
            }
            let got = device_gradients(&gpu, (variants, way), &case, &grad_image, Some(&grad_aux));
            for p in 0..8 {
                let name = format!("{}, {variants:?}, {}", case.name, NAMES[p]);
                Guards { floor: FLOOR, ..Guards::of(1e-3) }.check(&name, got[p].len(), &got[p], &want[p]);
                ROW.check(&name, ROWS[p], &got[p], &want[p]);
            }
        }
    }
    gpu.check_canaries().unwrap();
    common::assert_no_messages(&gpu);
}
