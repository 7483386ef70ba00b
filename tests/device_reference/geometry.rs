//! The geometry loss from splats to gradients: image, loss and backward pass of the device against their f64
//! counterparts, each of which has its own test against finite differences.

use psrgs_vk::loss::{Edges, GeometryLoss, GeometryWeights, Photograph, Prior, Rendered, TextureMask};
use psrgs_vk::pass::geometry::{Push, pack_prior};
use psrgs_vk::pass::{counters, loss};
use psrgs_vk::raster::{self, GradientSum, Planes, Renderer, Size, Target, TileShape, Variants};
use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::geometry::Scene;
use psrgs_vk::twin::loss::{counting, unpack};
use psrgs_vk::twin::place;
use psrgs_vk::twin::reference::{self, ImageGradient};
use psrgs_vk::twin::slot_sum::sum_of_parts;
use psrgs_vk::twin::splat::Splat;
use psrgs_vk::vk::{Gpu, Memory};

use super::common::guards::Guards;
use super::common::splats::seeded;
use super::{Case, FLOOR, NAMES, ROW, ROWS, case, common};

const PRIOR: (u32, u32) = (23, 17);
const MASK: (u32, u32) = (8, 6);

/// What the loss compares a render with.
struct Known {
    target: Vec<u32>,
    prior: Vec<[u32; 2]>,
    mask: Vec<u8>,
    median: f32,
    values: f32,
}

/// Photograph, prior and mask at random. Pixels near a decision of the renderer or of the loss are masked.
fn known(case: &Case, scene_depth: f64) -> Known {
    let mut random = seeded(77);
    let decided = case.decided();
    let mut target = Vec::new();
    for (i, decided) in decided.iter().enumerate() {
        let opacity = 1.0 - case.image.transmittance[i];
        let normal = case.image.normal[i].iter().map(|v| v * v).sum::<f64>().sqrt();
        let calm = (opacity - 0.9).abs() > 1e-3 && (normal - 0.1).abs() > 1e-3;
        let byte = |random: &mut Random| (127.0 * (1.0 + random.symmetric())) as u32;
        let [r, g, b] = std::array::from_fn(|_| byte(&mut random));
        target.push(r | g << 8 | b << 16 | u32::from(*decided && calm) << 24);
    }
    let prior = (0..PRIOR.0 * PRIOR.1)
        .map(|_| {
            let depth = scene_depth * (1.0 + 0.1 * random.symmetric());
            let normal = [0.3 * random.symmetric() as f32, 0.3 * random.symmetric() as f32, -1.0];
            pack_prior(depth as f32, Some(normal), (0.6 + 0.4 * random.symmetric()) as f32)
        })
        .collect();
    let mask = (0..MASK.0 * MASK.1).map(|k| (k * 5) as u8).collect();
    let masked = target.iter().filter(|t| **t >> 24 == 0).count() as u32;
    let camera = &case.shot.camera;
    Known { target, prior, mask, median: scene_depth as f32, values: loss::values(camera.width, camera.height, masked) }
}

fn weights(smooth: f32) -> GeometryWeights {
    GeometryWeights { depth: 1.0, huber: 0.05, edges: Edges::More(1.0), smooth, edge_stop: 3.0, cosine: 0.5, l1: 0.2 }
}

/// In f64: the three terms with their sum, the gradients of the splats, and the number of compared pixels.
fn wanted(case: &Case, known: &Known, weights: &GeometryWeights) -> ([f64; 4], [Vec<f64>; 8], usize) {
    let camera = &case.shot.camera;
    let Edges::More(edge) = weights.edges else { unreachable!() };
    let push = Push {
        width: camera.width,
        height: camera.height,
        prior_width: PRIOR.0,
        prior_height: PRIOR.1,
        mask_width: MASK.0,
        mask_height: MASK.1,
        pixels: known.values / 3.0,
        median: known.median,
        depth_weight: weights.depth,
        huber: weights.huber,
        edge,
        smooth_weight: weights.smooth,
        edge_stop: weights.edge_stop,
        cosine_weight: weights.cosine,
        l1_weight: weights.l1,
    };
    let pixels = case.image.colour.len();
    let image = &case.image;
    let scene = Scene::<f64> {
        push,
        edges: 0,
        image: (0..pixels).map(|i| [0.0, 0.0, 0.0, image.transmittance[i]]).collect(),
        aux: (0..pixels)
            .map(|i| [image.depth[i], image.normal[i][0], image.normal[i][1], image.normal[i][2]])
            .collect(),
        photo: unpack(&known.target, 8),
        counts: counting(&known.target, 8),
        prior: &known.prior,
        mask: Some(place::ByteMask { bytes: &known.mask, size: [MASK.0 as usize, MASK.1 as usize] }),
    };
    let (map, counted): (Vec<_>, Vec<_>) = (0..pixels).map(|k| scene.depth_row(k)).unzip();
    let totals = sum_of_parts(&counted);
    let mut upstream = ImageGradient::zeros(pixels);
    let mut terms = [0.0; 4];
    for k in 0..pixels {
        let (part, of_transmittance, [of_depth, x, y, z]) = scene.grad_row(&map, &totals, k);
        terms.iter_mut().zip(part).for_each(|(sum, v)| *sum += v);
        (upstream.transmittance[k], upstream.depth[k], upstream.normal[k]) = (of_transmittance, of_depth, [x, y, z]);
    }
    let gradients = reference::backward(&case.splats, camera, &case.settings, &upstream);
    (terms, gradients.planes(), totals[1] as usize)
}

/// Terms and gradients on the device.
fn on_device(
    gpu: &Gpu,
    variants: Variants,
    case: &Case,
    known: &Known,
    weights: &GeometryWeights,
) -> (Vec<f32>, [Vec<f32>; 8]) {
    let n = case.model.len() as u32;
    let camera = &case.shot.camera;
    let (width, height) = (camera.width, camera.height);
    let side = variants.tile.size();
    let tiles = width.div_ceil(side) * height.div_ceil(side);
    let size = Size { aux: true, clamp_gradient_passes: false, ..Size::training(n, 40_000, tiles) };
    let renderer = Renderer::new(gpu, variants, size).unwrap();
    let (model, grads) = (Planes::new(gpu, "", n).unwrap(), Planes::new(gpu, "g_", n).unwrap());
    model.write(gpu, &case.model).unwrap();
    let target = Target::new(gpu, "", width * height, true).unwrap();
    let upload = |name: &str, bytes: &[u8]| {
        let buffer = gpu.buffer(name, bytes.len() as u64, Memory::Device).unwrap();
        gpu.write(&buffer, bytes).unwrap();
        buffer
    };
    let buffers = [
        upload("photograph", bytemuck::cast_slice(&known.target)),
        upload("prior", bytemuck::cast_slice(&known.prior)),
        upload("mask", &known.mask),
        upload("grad_image", &vec![0; 16 * (width * height) as usize]),
    ];
    let [photograph, prior, mask, grad_image] = &buffers;
    let mut words = [0u32; counters::COUNT];
    words[counters::SPLATS] = n;
    let geometry = GeometryLoss::new(gpu, width * height).unwrap();
    let mut rec = gpu.recorder("forward, loss and backward").unwrap();
    rec.upload(&renderer.counters, 0, bytemuck::cast_slice(&words)).unwrap();
    let lists = renderer.record_forward(&mut rec, &model, &case.shot, &target, true).unwrap();
    let photograph = Photograph {
        buffer: photograph,
        bits: 8,
        size: (width, height),
        values: known.values,
        part_values: known.values,
        mask: Some(TextureMask { buffer: mask, size: MASK }),
    };
    let prior = Prior { buffer: prior, size: PRIOR, median: known.median };
    let rendered = Rendered { target: &target, photograph: &photograph, prior: &prior };
    geometry.record(&mut rec, rendered, weights, grad_image).unwrap();
    let of_image = raster::ImageGradients { of_image: grad_image, of_aux: Some(geometry.grad_aux()) };
    let gradients = raster::Gradients { model: &model, of_model: &grads, of_image };
    renderer.record_backward(&mut rec, &lists, &gradients, &case.shot, &target).unwrap();
    rec.submit().unwrap();
    (gpu.read(geometry.result()).unwrap(), grads.read(gpu, n).unwrap())
}

#[test]
fn gradients_of_the_geometry_loss_agree_with_brute_force() {
    let Some(gpu) = common::gpu() else { return };
    // Enough splats that most pixels have a depth, small enough that the depth varies.
    let mut case = case((61, 45), 1, false, 900, 411);
    case.model.scales.iter_mut().for_each(|s| *s -= 0.4);
    case.model.opacities.iter_mut().for_each(|o| *o = o.abs() + 0.3);
    case.splats = Splat::all(&case.model);
    case.image = reference::render(&case.splats, &case.shot.camera, &case.settings);
    let opaque = case.image.transmittance.iter().position(|t| *t < 0.05).expect("something is opaque");
    let depth = case.image.depth[opaque] / (1.0 - case.image.transmittance[opaque]);
    let known = known(&case, depth);
    // A pixel's gradient of smoothness is a second difference of depths, which may be pure rounding. A splat that is
    // seen only in pixels with such differences has no exact digits. So with smoothness, rows are judged against the
    // largest of their plane.
    for (smooth, each_row) in [(0.0, true), (100.0, false)] {
        let weights = weights(smooth);
        let (terms, want, compared) = wanted(&case, &known, &weights);
        assert!(compared > 300, "only {compared} pixels have a depth");
        assert!(terms[0] > 5e-5 && terms[2] > 5e-5 && (terms[1] > 5e-5) == (smooth > 0.0), "{terms:?}");
        for tile in [TileShape::Column, TileShape::Pixel] {
            let (result, got) = on_device(&gpu, Variants::new(tile, GradientSum::Slots), &case, &known, &weights);
            for (got, want) in result.iter().zip(terms) {
                assert!((f64::from(*got) - want).abs() <= 1e-4 * want, "{tile:?}: {got} instead of {want}");
            }
            for p in 0..4 {
                let name = format!("{tile:?}, smooth {smooth}, {}", NAMES[p]);
                Guards { floor: FLOOR, ..Guards::of(1e-3) }.check(&name, got[p].len(), &got[p], &want[p]);
                if each_row {
                    ROW.check(&name, ROWS[p], &got[p], &want[p]);
                }
            }
            assert!(got[4..].iter().flatten().all(|v| *v == 0.0), "colours have a gradient");
        }
    }
    gpu.check_canaries().unwrap();
    common::assert_no_messages(&gpu);
}
