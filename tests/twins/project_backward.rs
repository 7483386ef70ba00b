//! `project_backward`: every family of parameters against the f64 twin, culled rows, and finite gradients of hard
//! splats.

use psrgs_vk::pass::camera::{CameraPush, Projection};
use psrgs_vk::pass::project_backward::{PASS, Penalties};
use psrgs_vk::scene::Gaussians;
use psrgs_vk::scene::random::Random;
use psrgs_vk::scene::tile::TileGrid;
use psrgs_vk::twin::project::project;
use psrgs_vk::twin::project_backward::{Grad2d, project_backward};
use psrgs_vk::twin::splat::{Splat, TwinCamera};
use psrgs_vk::vk::Gpu;

use super::common::guards::{Guards, eased};
use super::common::splats::{seeded, vector};
use super::harness::{self, bytes, garbage};
use super::projection_scene as scene;

/// Families of a splat's 59 gradients, with the bound of elements relative to the family's largest.
const FAMILIES: [(&str, std::ops::Range<usize>, f64); 5] = [
    ("means", 0..3, 2e-4),
    ("quats", 3..7, 2e-4),
    ("scales", 7..10, 2e-4),
    ("opacities", 10..11, 1e-5),
    ("sh", 11..59, 1e-5),
];

/// Floats of a splat in each plane.
const ROWS: [usize; 8] = [3, 4, 3, 1, 12, 12, 12, 12];

/// Random gradients in the size of those of blending: gradients of a conic grow with the inverse conic.
fn random_gradient(random: &mut Random, conic: [f64; 3], aux: bool) -> Grad2d<f64> {
    let size = 1.0 / (conic[0] * conic[2]).sqrt();
    let row = std::array::from_fn(|k| match k {
        2..=4 => size * random.symmetric(),
        10 | 11 => f64::NAN,
        // Without normals the depth has no gradient.
        9 if !aux => 0.0,
        _ => random.symmetric(),
    });
    Grad2d { row, normal: if aux { vector(random) } else { [0.0; 3] } }
}

/// Runs one dispatch and compares it; returns how many splats had gradients.
fn compare(gpu: &Gpu, model: &Gaussians, projection: Projection, aux: bool, what: &str) -> usize {
    let n = model.len();
    let push = scene::push(&projection);
    let view = TwinCamera::<f64>::of(&push);
    let grid = TileGrid::new(view.size, [16, 16]);
    let mut random = seeded(n as u64);
    let (mut splat2d, mut tiles) = (vec![[f32::NAN; 12]; n], vec![0u32; n]);
    let (mut grad2d, mut grad_normals) = (vec![[f32::NAN; 12]; n], vec![[f32::NAN; 4]; n]);
    let mut want = Gaussians::zeros(n);
    let mut exact: Vec<Splat<f64>> = Vec::new();
    let mut seen = 0;
    for i in 0..n {
        let splat = Splat::<f64>::of(model, i);
        // Projections that overflow in f32 are culled on the device.
        let on_device = project(&Splat::<f32>::of(model, i), &TwinCamera::of(&push), Some(&grid)).is_ok();
        let Some(p) = project(&splat, &view, Some(&grid)).ok().filter(|_| on_device) else {
            exact.push(Splat::of(&want, i));
            continue;
        };
        seen += 1;
        tiles[i] = p.tiles;
        splat2d[i] = p.row().map(|v| v as f32);
        let g = random_gradient(&mut random, p.conic, aux);
        grad2d[i] = g.row.map(|v| v as f32);
        grad_normals[i] = [g.normal[0] as f32, g.normal[1] as f32, g.normal[2] as f32, f32::NAN];
        // The twin gets what the device gets.
        let g = Grad2d { row: grad2d[i].map(f64::from), normal: [0, 1, 2].map(|k| f64::from(grad_normals[i][k])) };
        let colour = [8, 9, 10].map(|c| f64::from(splat2d[i][c]));
        let gradient = project_backward(&splat, &view, colour, &g);
        gradient.store(&mut want, i);
        exact.push(gradient);
    }
    let mut buffers = vec![scene::counts(n)];
    buffers.extend(scene::planes(model));
    buffers.extend(
        [bytes(&splat2d), bytes(&tiles), bytes(&grad2d), bytes(&grad_normals)].map(|b| [b, garbage(8)].concat()),
    );
    let rows = ROWS;
    buffers.extend(rows.map(|row| garbage(row * n + scene::BEYOND)));
    let outcome = harness::run(gpu, &PASS, &[("AUX", u32::from(aux))], &buffers, &push, n.div_ceil(64).max(1) as u32);

    for k in 0..8 {
        let name = PASS.kernel.bindings[13 + k].name;
        let got = outcome.device::<f32>(13 + k);
        let (inside, beyond) = got.split_at(rows[k] * n);
        assert!(inside.iter().all(|v| v.is_finite()), "{what}: {name} is not finite");
        assert_eq!(bytes(beyond), buffers[13 + k][4 * rows[k] * n..], "{what}: {name} beyond its rows");
        for i in (0..n).filter(|&i| tiles[i] == 0) {
            assert!(
                inside[rows[k] * i..rows[k] * (i + 1)].iter().all(|v| *v == 0.0),
                "{what}: {name} of a culled splat"
            );
        }
    }
    let plane = |k: usize| outcome.device::<f32>(13 + k)[..rows[k] * n].to_vec();
    let device = Gaussians {
        means: plane(0),
        quats: plane(1),
        scales: plane(2),
        opacities: plane(3),
        sh: std::array::from_fn(|g| plane(4 + g)),
        ids: Vec::new(),
    };
    let mut complaints = Vec::new();
    for (name, family, bound) in FAMILIES {
        let mut got: Vec<f32> =
            (0..n).flat_map(|i| Splat::<f32>::of(&device, i).to_array()[family.clone()].to_vec()).collect();
        let want: Vec<f64> = exact.iter().flat_map(|s| s.to_array()[family.clone()].to_vec()).collect();
        if name == "opacities" && projection.antialias {
            // The anti-aliasing factor depends on the area of the shape before its dilation.
            let condition: Vec<f64> = (0..n)
                .map(|i| if tiles[i] == 0 { 1.0 } else { scene::condition(&Splat::of(model, i), &view) })
                .collect();
            got = eased(&got, &want, &condition);
        }
        let verdict = Guards::of(bound).verdict(family.len(), &got, &want);
        complaints.extend(verdict.err().map(|why| format!("{name}: {why}")));
    }
    assert!(complaints.is_empty(), "{what}: {}", complaints.join("\n"));
    adds(gpu, (&buffers, &push), aux, &outcome, &tiles, what);
    assert_eq!(outcome.device[..13], buffers[..13], "{what}: inputs changed");
    seen
}

/// The dispatch on other values: earlier results are added to them, and a culled splat keeps its values to the bit.
fn adds(
    gpu: &Gpu,
    (buffers, push): (&[Vec<u8>], &CameraPush),
    aux: bool,
    written: &harness::Outcome,
    tiles: &[u32],
    what: &str,
) {
    let mut random = seeded(5);
    let mut buffers = buffers.to_vec();
    for (k, row) in ROWS.into_iter().enumerate() {
        let before: Vec<f32> = (0..row * tiles.len()).map(|_| random.symmetric() as f32).collect();
        buffers[13 + k][..4 * before.len()].copy_from_slice(&bytes(&before));
    }
    let groups = tiles.len().div_ceil(64).max(1) as u32;
    let added = harness::run(gpu, &PASS, &[("AUX", u32::from(aux)), ("ADD", 1)], &buffers, push, groups);
    for (k, row) in ROWS.into_iter().enumerate() {
        let name = PASS.kernel.bindings[13 + k].name;
        let (now, more) = (added.device::<f32>(13 + k), written.device::<f32>(13 + k));
        let before: Vec<f32> = bytemuck::pod_collect_to_vec(&buffers[13 + k]);
        assert_eq!(
            bytes(&now[row * tiles.len()..]),
            bytes(&before[row * tiles.len()..]),
            "{what}: {name} beyond its rows"
        );
        for at in 0..row * tiles.len() {
            let want = f64::from(before[at]) + f64::from(more[at]);
            let wrong = (f64::from(now[at]) - want).abs();
            // A sum may round differently where it is fused with the product before it.
            let bound = 1e-6 * (f64::from(before[at]).abs() + f64::from(more[at]).abs());
            assert!(wrong <= bound, "{what}: {name} {at}: {} instead of {want}", now[at]);
            assert!(
                tiles[at / row] != 0 || now[at].to_bits() == before[at].to_bits(),
                "{what}: {name} of a culled splat"
            );
        }
    }
}

/// With penalties: the twin on raw buffers agrees, written and added, and culled splats have the prices alone.
fn penalised(gpu: &Gpu) {
    let (n, push) = (600, scene::push(&Projection::default()));
    let (model, view) = (scene::ordinary(n, 41), TwinCamera::<f32>::of(&push));
    let grid = TileGrid::new(view.size, [16, 16]);
    let seen: Vec<u32> =
        (0..n).map(|i| project(&Splat::of(&model, i), &view, Some(&grid)).map_or(0, |p| p.tiles)).collect();
    let mut buffers = vec![scene::counts(n)];
    buffers.extend(scene::planes(&model));
    // Without gradients of colour, only the penalties are left.
    buffers.extend([bytes(&vec![0.5f32; 12 * n]), bytes(&seen), bytes(&vec![0f32; 12 * n]), bytes(&vec![0f32; 4 * n])]);
    buffers.extend(ROWS.map(|row| bytes(&vec![0.25f32; row * n])));
    let penalties = Penalties { opacity: 60.0, scale: 90.0, decide: 0.5, ..Penalties::default() };
    for add in [0, 1] {
        let constants = [penalties.constants().as_slice(), &[("ADD", add)]].concat();
        let outcome = harness::run(gpu, &PASS, &constants, &buffers, &push, n.div_ceil(64) as u32);
        for (k, row) in ROWS.into_iter().enumerate() {
            let (device, twin) = (outcome.device::<f32>(13 + k), outcome.twin::<f32>(13 + k));
            for (at, (d, t)) in device.iter().zip(&twin).enumerate() {
                // The two penalties of an opacity may cancel.
                assert!(
                    (d - t).abs() <= 1e-6 * (1.0 + t.abs()),
                    "plane {k} of rows of {row}, {at}: {d} instead of {t}"
                );
            }
        }
        let logits = outcome.device::<f32>(16);
        for (i, culled) in seen.iter().map(|tiles| *tiles == 0).enumerate() {
            let o = 1.0 / (1.0 + (-f64::from(model.opacities[i])).exp());
            let decision = if culled { 0.0 } else { 0.5 * (1.0 - 2.0 * o) };
            let want = 0.25 * f64::from(add) + o * (1.0 - o) * (60.0 / n as f64 + decision);
            assert!((f64::from(logits[i]) - want).abs() < 1e-6, "splat {i}: {} instead of {want}", logits[i]);
        }
    }
    assert!(seen.iter().filter(|tiles| **tiles == 0).count() > 40);
}

pub fn run(gpu: &Gpu) {
    penalised(gpu);
    for n in [0, 1, 63, 64, 65] {
        compare(gpu, &scene::ordinary(n, 300 + n as u64), Projection::default(), true, &format!("{n} splats"));
    }
    for (k, projection) in scene::settings().into_iter().enumerate() {
        let model = scene::ordinary(600, 20 + k as u64);
        let seen = compare(gpu, &model, projection, k % 2 == 1, &format!("ordinary splats, {projection:?}"));
        assert!(seen > 250, "{seen} seen");
    }
    for antialias in [false, true] {
        let projection = Projection { antialias, ..Projection::default() };
        let seen = compare(gpu, &scene::hard(), projection, true, &format!("hard splats, anti-aliasing {antialias}"));
        assert!(seen > 150, "{seen} seen");
    }
}
