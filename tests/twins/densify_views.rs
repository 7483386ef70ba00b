//! The views that the rule of 3DGS counts, against the rule of that publication's program: whole tiles, in integers.

use glam::{DMat3, DQuat, DVec3};
use psrgs_vk::pass::camera::{Projection, clamp_limits};
use psrgs_vk::pass::densify_views;
use psrgs_vk::scene::Gaussians;
use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::densify_views::is_counted;
use psrgs_vk::twin::splat::{Splat, TwinCamera};
use psrgs_vk::vk::Gpu;

use super::harness::{self, Words, bytes};
use super::projection_scene::{self as scene, BEYOND};

/// Of a splat in front of the near plane: mean, half side of its square, and the number of tiles of 16 x 16 pixels
/// between the corners. Covariances are multiplied out.
fn square(splat: &Splat<f64>) -> Option<([f64; 2], f64, i64)> {
    let camera = scene::view();
    let world = DMat3::from_cols_array_2d(&camera.rotation).transpose();
    let p = world * DVec3::from_array(splat.mean) + DVec3::from_array(camera.translation);
    if p.z <= 0.2 {
        return None;
    }
    let [w, x, y, z] = splat.quat;
    let long = splat.quat.iter().map(|q| q * q).sum::<f64>() >= 1e-24;
    let turn = if long { DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize()) } else { DMat3::IDENTITY };
    let axes = turn * DMat3::from_diagonal(DVec3::from_array(splat.log_scale.map(f64::exp)));
    let [x0, x1, y0, y1] = clamp_limits(&camera);
    let (u, v) = ((p.x / p.z).clamp(x0, x1), (p.y / p.z).clamp(y0, y1));
    let rows = [DVec3::new(camera.fx, 0.0, -camera.fx * u) / p.z, DVec3::new(0.0, camera.fy, -camera.fy * v) / p.z];
    let [m0, m1] = rows.map(|row| (world * axes).transpose() * row);
    let (a, b, c) = (m0.dot(m0) + 0.3, m0.dot(m1), m1.dot(m1) + 0.3);
    let (middle, det) = (0.5 * (a + c), a * c - b * b);
    let radius = (3.0 * (middle + (middle * middle - det).max(0.1).sqrt()).sqrt()).ceil();
    let at = [camera.fx * p.x / p.z + camera.cx - 0.5, camera.fy * p.y / p.z + camera.cy - 0.5];
    Some((at, radius, tiles(at, radius)))
}

fn tiles(at: [f64; 2], radius: f64) -> i64 {
    let camera = scene::view();
    let along = |at: f64, size: u32| {
        let tiles = i64::from(size.div_ceil(16));
        let first = (((at - radius) / 16.0) as i64).clamp(0, tiles);
        let end = (((at + radius + 15.0) / 16.0) as i64).clamp(0, tiles);
        end - first
    };
    along(at[0], camera.width) * along(at[1], camera.height)
}

/// The answer of the publication's program; `None` where rounding may decide.
fn expected(splat: &Splat<f64>) -> Option<bool> {
    let Some((at, radius, count)) = square(splat) else { return Some(false) };
    // Squares whose variance overflows f32 have no position.
    if radius > 1e12 {
        return None;
    }
    let slack = 0.01 + 1e-4 * (at[0].abs() + at[1].abs() + radius);
    let nearby = [-1.0, 1.0].map(|way| tiles(at, radius + way * (1.0 + slack)) > 0);
    // A square that ends within rounding of a tile may have one pixel more or less.
    (nearby.iter().all(|more| *more == (count > 0))).then_some(count > 0)
}

fn splats(model: &Gaussians) -> impl Iterator<Item = Splat<f64>> + '_ {
    (0..model.len()).map(|i| Splat::of(model, i))
}

pub fn run(gpu: &Gpu) {
    for (model, seed) in [(scene::ordinary(300, 5), 1), (scene::hard(), 2)] {
        let n = model.len();
        let mut random = Random::new(seed);
        let tile_counts: Vec<u32> = (0..n + BEYOND).map(|_| (random.word() % 4) / 3).collect();
        let before: Vec<f32> = (0..4 * (n + BEYOND)).map(|_| random.between(0.0, 5.0)).collect();
        let [means, quats, scales, ..] = &scene::planes(&model)[..] else { unreachable!("a model has eight planes") };
        let buffers =
            [scene::counts(n), bytes(&tile_counts), means.clone(), quats.clone(), scales.clone(), bytes(&before)];
        let push = scene::push(&Projection::default());
        let groups = n.div_ceil(64).max(1) as u32;
        let outcome = harness::run(gpu, &densify_views::PASS, &[], &buffers, &push, groups);
        let (device, twin) = (outcome.device::<f32>(5), outcome.twin::<f32>(5));
        let mut counted = [0; 2];
        for (i, splat) in splats(&model).enumerate() {
            let Some(expected) = expected(&splat) else { continue };
            let more = if expected && tile_counts[i] == 0 { 1.0 } else { 0.0 };
            counted[usize::from(expected)] += 1;
            for (found, who) in [(&device, "device"), (&twin, "twin")] {
                let (row, was) = (&found[4 * i..4 * i + 4], &before[4 * i..4 * i + 4]);
                assert_eq!(row[2], was[2] + more, "splat {i} of set {seed}: views by the {who}");
                assert!(row[..2] == was[..2] && row[3] == was[3], "splat {i} of set {seed}: other columns");
            }
        }
        assert!(counted.iter().all(|count| *count > 20), "splats that are not counted and that are: {counted:?}");
        assert_eq!(device[4 * n..], before[4 * n..], "rows beyond the model");
    }
}

/// A speck between pixel centres, and a splat off the image whose square reaches a tile: neither blends into any pixel.
#[test]
fn views_of_3dgs_count_where_no_pixel_is_blended() {
    let camera = scene::view();
    let view = TwinCamera::<f64>::exact(&camera, &Projection::default());
    let at = |x: f64, y: f64, log_scale: f64| {
        let mean =
            super::common::splats::to_scene(&camera, [(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0]);
        is_counted(&view, mean, [1.0, 0.0, 0.0, 0.0], [log_scale; 3])
    };
    let speck = -12.0;
    // A speck's square has a half side of 3 * sqrt(0.3 + sqrt(0.1)) pixels, rounded up: 3.
    assert!(at(100.0, 75.0, speck));
    assert!(at(-1.4, 75.0, speck) && !at(-1.6, 75.0, speck));
    // 200 pixels are 13 tiles, which end at 208; 150 pixels are 10 tiles, which end at 160.
    assert!(at(211.4, 75.0, speck) && !at(211.6, 75.0, speck));
    assert!(at(100.0, 163.4, speck) && !at(100.0, 163.6, speck));
}
