//! `project`: every column against the f64 twin, tile counts against the shared tile test on the stored row, hard and
//! poisoned splats.

use half::f16;
use psrgs_vk::pass::camera::Projection;
use psrgs_vk::pass::{
    counters,
    project::{HALF, PASS, SPARSE},
};
use psrgs_vk::scene::Gaussians;
use psrgs_vk::scene::tile::{self, ALPHA_MIN, TileGrid};
use psrgs_vk::twin::project::{Culled, PIXEL_STEPS, Projected, project};
use psrgs_vk::twin::splat::{PARAMETERS, Splat, TwinCamera};
use psrgs_vk::vk::{Gpu, Subgroup};

use super::common::guards::{Guards, eased};
use super::common::splats::{seeded, spread, to_scene};
use super::harness::{self, Outcome};
use super::projection_scene as scene;

/// Groups of columns of `splat2d`, each with the size of the terms that its elements sum (a difference of terms has the
/// error of the terms), and the bound of elements relative to this size. Means are pixels of an image of 200.
const COLUMNS: [(&str, &[usize], f64, f64); 5] = [
    ("mean", &[0, 1], 200.0, 4e-6),
    ("conic", &[2, 3, 4], 0.0, 2e-5),
    ("opacity", &[5], 0.0, 4e-6),
    ("depth", &[6], 2.0, 1e-6),
    ("color", &[8, 9, 10], 1.0, 4e-6),
];

/// A determinant near the end of f32's range: the projection overflows on the device, and the splat is culled.
const OVERFLOW: f64 = 1e37;

struct Case<'a> {
    model: &'a Gaussians,
    projection: Projection,
    tile: [u32; 2],
    aux: bool,
    alpha_min: f32,
    /// Spherical harmonics in half floats.
    halved: bool,
}

impl<'a> Case<'a> {
    fn new(model: &'a Gaussians, projection: Projection, tile: [u32; 2], aux: bool) -> Self {
        Self { model, projection, tile, aux, alpha_min: ALPHA_MIN, halved: false }
    }

    fn grid(&self, view: &TwinCamera<f64>) -> TileGrid {
        TileGrid { alpha_min: self.alpha_min, ..TileGrid::new(view.size, self.tile) }
    }
}

fn dispatch(gpu: &Gpu, case: &Case<'_>) -> Outcome {
    let mut constants = vec![("TILE_W", case.tile[0]), ("TILE_H", case.tile[1]), ("AUX", u32::from(case.aux))];
    if case.projection.orthographic {
        constants.push(("ORTHOGRAPHIC", 1));
    }
    if case.alpha_min != ALPHA_MIN {
        constants.push(("ALPHA_MIN", case.alpha_min.to_bits()));
    }
    let mut buffers = scene::project_buffers(case.model);
    if case.halved {
        for plane in &mut buffers[5..9] {
            let numbers: Vec<f32> = bytemuck::pod_collect_to_vec(plane);
            let halves: Vec<u16> = numbers.into_iter().map(|v| f16::from_f32(v).to_bits()).collect();
            *plane = harness::bytes(&halves);
        }
    }
    // At least one workgroup, so that an empty model is a dispatch that does nothing.
    let groups = case.model.len().div_ceil(64).max(1) as u32;
    let run = |pass| harness::run(gpu, pass, &constants, &buffers, &scene::push(&case.projection), groups);
    if case.halved {
        return run(&HALF);
    }
    let outcome = run(&PASS);
    if matches!(gpu.caps().subgroup, Subgroup::Hardware(8)) {
        let sparse = run(&SPARSE);
        for (k, (got, want)) in sparse.device.iter().zip(&outcome.device).enumerate() {
            assert!(got == want, "buffer {k} differs where splats out of view are left out first");
        }
    }
    outcome
}

/// Whether rounding may cull the splat: the verdict changes with small changes of depth, opacity or mean.
fn undecided(splat: &Splat<f64>, view: &TwinCamera<f64>, grid: &TileGrid) -> bool {
    let verdict = |view: &TwinCamera<f64>| project(splat, view, Some(grid)).is_ok();
    let here = verdict(view);
    let z = psrgs_vk::twin::project::to_camera(view, splat.mean)[2];
    let near = (z / view.near - 1.0).abs() < 1e-5;
    let moved = [-2e-3, 2e-3].iter().any(|step| {
        (0..2).any(|axis| {
            let mut other = view.clone();
            other.principal[axis] += step;
            verdict(&other) != here
        })
    });
    let faint = project(splat, view, None).is_ok_and(|p| (p.opacity / f64::from(grid.alpha_min) - 1.0).abs() < 1e-4);
    near || moved || faint
}

/// Whether rounding picks the step of a pixel that a position under parallel rays is rounded to.
fn between_steps(splat: &Splat<f64>, view: &TwinCamera<f64>) -> bool {
    let p = psrgs_vk::twin::project::to_camera(view, splat.mean);
    view.orthographic && (0..2).any(|k| ((view.focal[k] * p[k] * PIXEL_STEPS).rem_euclid(1.0) - 0.5).abs() < 0.1)
}

/// Compares one dispatch; returns how many splats were compared.
fn compare(gpu: &Gpu, case: &Case<'_>, what: &str) -> usize {
    let n = case.model.len();
    let outcome = dispatch(gpu, case);
    let orthographic = case.projection.orthographic;
    let view = TwinCamera::<f64> { orthographic, ..TwinCamera::of(&scene::push(&case.projection)) };
    let grid = case.grid(&view);
    let got = outcome.device::<[f32; 12]>(9);
    let tiles = outcome.device::<u32>(10);
    let normals = outcome.device::<[f32; 4]>(11);
    let untouched = scene::project_buffers(case.model);
    let mut pairs: Vec<(usize, Projected<f64>)> = Vec::new();
    let mut left_out = 0;
    for i in 0..n {
        let splat = Splat::<f64>::of(case.model, i);
        let want = match psrgs_vk::twin::project::geometry(&splat, &view).1.det {
            det if det < OVERFLOW => project(&splat, &view, Some(&grid)),
            _ => Err(Culled::Faint),
        };
        if (tiles[i] > 0) != want.is_ok() {
            assert!(undecided(&splat, &view, &grid), "{what}: splat {i}: {} tiles, twin says {want:?}", tiles[i]);
            left_out += 1;
            continue;
        }
        let Ok(want) = want else {
            assert_eq!(
                bytemuck::bytes_of(&got[i]),
                &untouched[9][48 * i..48 * i + 48],
                "{what}: culled splat {i} written"
            );
            continue;
        };
        let r = got[i];
        assert!(r.iter().all(|v| v.is_finite()), "{what}: splat {i}: {r:?}");
        let same_row = tile::count([r[0], r[1]], [r[2], r[3], r[4]], r[5], &grid);
        assert_eq!(tiles[i], same_row, "{what}: splat {i}: tiles of the stored row");
        pairs.push((i, want));
    }
    assert!(left_out * 50 <= n.max(50), "{what}: {left_out} of {n} splats undecided");
    let mut complaints = Vec::new();
    for (name, columns, size, bound) in COLUMNS {
        let compared = |i: usize| name != "mean" || !between_steps(&Splat::of(case.model, i), &view);
        let rows = || pairs.iter().filter(|(i, _)| compared(*i));
        let each = || rows().flat_map(|(i, p)| columns.iter().map(move |&c| (*i, c, p)));
        let mut device: Vec<f32> = each().map(|(i, c, _)| got[i][c] + size as f32).collect();
        let twin: Vec<f64> = each().map(|(_, c, p)| p.row()[c] + size).collect();
        if name == "opacity" && case.projection.antialias {
            // The anti-aliasing factor depends on the area of the shape before its dilation.
            let of = |i: &usize| scene::condition(&Splat::of(case.model, *i), &view);
            let condition: Vec<f64> = pairs.iter().map(|(i, _)| of(i)).collect();
            device = eased(&device, &twin, &condition);
        }
        let verdict = Guards::of(bound).verdict(columns.len(), &device, &twin);
        complaints.extend(verdict.err().map(|why| format!("{name}: {why}")));
    }
    assert!(complaints.is_empty(), "{what}: {}", complaints.join("\n"));
    if case.aux {
        let device: Vec<f32> = pairs.iter().flat_map(|(i, _)| normals[*i][..3].to_vec()).collect();
        let twin: Vec<f64> = pairs.iter().flat_map(|(_, p)| p.normal).collect();
        Guards::of(4e-6).check(&format!("{what}: normals"), 3, &device, &twin);
        let shares = |slope: [f64; 2], i: usize| {
            let steepest = scene::steepest(&Splat::of(case.model, i), &view);
            // Shares of at most 1, which the error is relative to.
            [1.0 + slope[0] / steepest[0], 1.0 + slope[1] / steepest[1]]
        };
        let on_device = |i: usize| shares([got[i][11], normals[i][3]].map(f64::from), i).map(|v| v as f32);
        let device: Vec<f32> = pairs.iter().flat_map(|(i, _)| on_device(*i)).collect();
        let twin: Vec<f64> = pairs.iter().flat_map(|(i, p)| shares(p.slope, *i)).collect();
        Guards::of(2e-5).check(&format!("{what}: slopes"), 2, &device, &twin);
    } else {
        assert_eq!(outcome.device[11], untouched[11], "{what}: normals written without AUX");
        assert!(pairs.iter().all(|(i, _)| got[*i][11] == 0.0), "{what}: slopes without AUX");
    }
    // Words behind the last splat do not change, and of the counters at most that of bad splats.
    for (k, row) in [(9, 12), (10, 1), (11, 4)] {
        assert_eq!(outcome.device[k][4 * row * n..], untouched[k][4 * row * n..], "{what}: buffer {k} beyond its rows");
    }
    assert_eq!(outcome.device[0], scene::counts(n), "{what}: counters");
    pairs.len()
}

fn ordinary(gpu: &Gpu) {
    for (k, projection) in scene::settings().into_iter().enumerate() {
        let model = scene::ordinary(600, k as u64);
        let tile = if k % 2 == 0 { [16, 16] } else { [8, 4] };
        let case = Case::new(&model, projection, tile, k % 3 != 1);
        let compared = compare(gpu, &case, &format!("ordinary splats, {projection:?}"));
        assert!(compared > 250, "{compared} compared");
    }
}

fn sizes(gpu: &Gpu) {
    for n in [0, 1, 63, 64, 65, 129] {
        let model = scene::ordinary(n, 40 + n as u64);
        let case = Case::new(&model, Projection::default(), [16, 16], true);
        compare(gpu, &case, &format!("{n} splats"));
    }
}

/// Splats of all sizes and shapes about the edges of the image, where a bound of their extent that is too small would
/// first leave out a splat.
fn edges(gpu: &Gpu) {
    let camera = scene::view();
    let mut random = seeded(31);
    for aspect in [1.0, 30.0, 3000.0, 3e5] {
        let mut splats = Vec::new();
        for _ in 0..4000 {
            let mut splat = spread(&mut random, &camera, 1.0);
            let z = random.range(0.3, 8.0);
            // Means around the distance at which an ellipse of this width just reaches a side of the image.
            let pixels = 10f64.powf(random.range(-1.0, 2.5));
            let out = pixels * random.range(0.0, 5.0);
            let along = random.range(-0.5, 1.5);
            let (w, h) = (f64::from(camera.width), f64::from(camera.height));
            let at = match random.range(0.0, 4.0) as u32 {
                0 => [-out, along * h],
                1 => [w + out, along * h],
                2 => [along * w, -out],
                _ => [along * w, h + out],
            };
            splat.mean =
                to_scene(&camera, [(at[0] - camera.cx) / camera.fx * z, (at[1] - camera.cy) / camera.fy * z, z]);
            let wide = (pixels * z / camera.fx).ln();
            splat.log_scale = [wide, wide - f64::ln(aspect) * random.range(0.5, 1.0), wide - f64::ln(aspect)];
            splat.logit = random.range(-6.0, 12.0);
            splats.push(splat);
        }
        let model = scene::model(&splats);
        for antialias in [false, true] {
            let projection = Projection { antialias, ..Projection::default() };
            for alpha_min in [ALPHA_MIN, 1.0 / 32.0] {
                let case = Case { alpha_min, ..Case::new(&model, projection, [8, 8], true) };
                let tiles = dispatch(gpu, &case).device::<u32>(10);
                let seen = tiles[..model.len()].iter().filter(|t| **t > 0).count();
                // Needles lose their opacity to anti-aliasing.
                assert!((antialias || seen > 50) && seen < 3600, "{seen} reach the image, aspect {aspect}");
            }
        }
    }
}

/// Fewer splats and tiles where splats are skipped at a higher alpha.
fn skipped_sooner(gpu: &Gpu) {
    let model = scene::ordinary(600, 7);
    let exact = Case::new(&model, Projection::default(), [16, 16], true);
    let sooner = Case { alpha_min: 1.0 / 32.0, ..Case::new(&model, Projection::default(), [16, 16], true) };
    let [all, fewer] = [exact, sooner].map(|case| {
        let compared = compare(gpu, &case, &format!("splats skipped below {}", case.alpha_min));
        let tiles: u32 = dispatch(gpu, &case).device::<u32>(10)[..model.len()].iter().sum();
        (compared, tiles)
    });
    assert!(fewer.0 < all.0 && 10 * fewer.1 < 9 * all.1, "{fewer:?} of {all:?} splats and tiles");
}

/// Splats under parallel rays, and hard ones.
fn orthographic(gpu: &Gpu) {
    for (k, projection) in scene::settings().into_iter().enumerate() {
        let projection = Projection { orthographic: true, ..projection };
        let model = scene::ordinary(600, 70 + k as u64);
        let case = Case { halved: k == 3, ..Case::new(&model, projection, [16, 16], k % 2 == 0) };
        let steps = dispatch(gpu, &case);
        if k != 3 {
            let compared = compare(gpu, &case, &format!("parallel rays, {projection:?}"));
            assert!(compared > 150, "{compared} compared");
        }
        let (tiles, rows) = (steps.device::<u32>(10), steps.device::<[f32; 12]>(9));
        let on_steps = |row: &[f32; 12]| row[..2].iter().all(|v| (v * PIXEL_STEPS as f32).fract() == 0.0);
        assert!((0..600).filter(|i| tiles[*i] > 0).all(|i| on_steps(&rows[i])), "positions between steps");
    }
    let model = scene::hard();
    let projection = Projection { orthographic: true, ..Projection::default() };
    let compared = compare(gpu, &Case::new(&model, projection, [16, 16], true), "hard splats under parallel rays");
    assert!(compared > 100, "{compared} compared");
}

/// Half floats against coefficients in 32 bits that half floats hold exactly.
fn halved(gpu: &Gpu) {
    for (k, mut model) in [scene::ordinary(600, 9), scene::hard()].into_iter().enumerate() {
        let rounded = |v: &mut f32| *v = f16::from_f32(*v).to_f32();
        model.sh.iter_mut().flatten().for_each(rounded);
        let case = Case { halved: true, ..Case::new(&model, Projection::default(), [16, 16], true) };
        let compared = compare(gpu, &case, "spherical harmonics in half floats");
        assert!(compared > 150, "{compared} compared in model {k}");
    }
}

fn hard(gpu: &Gpu) {
    let model = scene::hard();
    for antialias in [false, true] {
        let projection = Projection { antialias, ..Projection::default() };
        let case = Case::new(&model, projection, [16, 16], true);
        let compared = compare(gpu, &case, &format!("hard splats, anti-aliasing {antialias}"));
        assert!(compared > 150, "{compared} compared");
    }
}

/// Every parameter of a splat in turn is NaN or infinite: the splat is culled and counted, and its neighbours keep
/// their bits.
fn poison(gpu: &Gpu) {
    let clean = scene::ordinary(64, 8);
    let projection = Projection::default();
    let view = TwinCamera::<f32>::of(&scene::push(&projection));
    let grid = TileGrid::new(view.size, [16, 16]);
    let seen: Vec<usize> =
        (0..64).filter(|&i| project(&Splat::<f32>::of(&clean, i), &view, Some(&grid)).is_ok()).collect();
    let victim = seen[seen.len() / 2];
    let healthy = dispatch(gpu, &Case::new(&clean, projection, [16, 16], true));
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        // 59 copies side by side, copy k with parameter k poisoned.
        let mut model = Gaussians::zeros(64 * PARAMETERS);
        for k in 0..PARAMETERS {
            for i in 0..64 {
                let mut values = Splat::<f32>::of(&clean, i).to_array();
                if i == victim {
                    values[k] = value;
                }
                let splat = Splat::from_array(&values);
                splat.store(&mut model, 64 * k + i);
                let verdict = project(&splat, &view, Some(&grid));
                assert_eq!(matches!(verdict, Err(Culled::Bad)), i == victim);
            }
        }
        let outcome = dispatch(gpu, &Case::new(&model, projection, [16, 16], true));
        let counts = outcome.device::<u32>(0);
        assert_eq!(counts[counters::BAD_SPLATS], 7 + PARAMETERS as u32, "{value}: bad splats counted");
        let tiles = outcome.device::<u32>(10);
        let rows = outcome.device::<[u32; 12]>(9);
        let (healthy_tiles, healthy_rows) = (healthy.device::<u32>(10), healthy.device::<[u32; 12]>(9));
        for k in 0..PARAMETERS {
            for &i in &seen {
                if i == victim {
                    assert_eq!(tiles[64 * k + i], 0, "{value} in parameter {k}");
                } else {
                    assert_eq!(tiles[64 * k + i], healthy_tiles[i]);
                    assert_eq!(rows[64 * k + i], healthy_rows[i]);
                }
            }
        }
    }
}

pub fn run(gpu: &Gpu) {
    sizes(gpu);
    ordinary(gpu);
    hard(gpu);
    orthographic(gpu);
    edges(gpu);
    skipped_sooner(gpu);
    halved(gpu);
    poison(gpu);
}
