//! Sparse points and poses like those of structure from motion.

use glam::{DMat3, DVec3};
use psrgs_vk::dataset::{Dataset, LoadOptions};
use psrgs_vk::eval::geometry::Closest;
use psrgs_vk::scene::Camera;
use psrgs_vk::world::{Effects, World, WorldParams, generate};

use crate::small;

fn project(camera: &Camera, p: DVec3) -> [f64; 2] {
    let rows = camera.rotation.map(DVec3::from_array);
    let q = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose() * p + DVec3::from_array(camera.translation);
    [camera.fx * q.x / q.z + camera.cx, camera.fy * q.y / q.z + camera.cy]
}

/// Pose noise moves the middle of photographs by 0.2 px along each axis.
#[test]
fn poses_are_as_far_off_as_asked_for() {
    let params = WorldParams { images: 200, max_side: 96, offpath: 0, ..small() };
    let world = World::new(&params).unwrap();
    let (mut squares, mut turned, mut gains) = (0.0, 0.0, 0.0);
    for (k, view) in (0..).zip(world.views()) {
        let camera = &view.camera;
        let middle = [0.5 * f64::from(camera.width), 0.5 * f64::from(camera.height)];
        let (origin, direction) = crate::ray_of(camera, middle[0], middle[1]);
        let hit = world.trace(&psrgs_vk::world::Ray { origin, direction }).unwrap();
        let [x, y] = project(&view.reconstructed, origin + direction * hit.t);
        squares += (x - middle[0]).powi(2) + (y - middle[1]).powi(2);
        let eyes = DVec3::from_array(camera.center()).distance(DVec3::from_array(view.reconstructed.center()));
        turned += eyes / 200.0;
        let gain = world.exposure(k);
        assert!((0.8..1.25).contains(&gain));
        gains += gain.ln();
    }
    let sigma = (squares / 400.0_f64).sqrt();
    // Five standard errors of a standard deviation from 400 values.
    assert!((sigma - 0.2).abs() < 5.0 * 0.2 / 800f64.sqrt(), "{sigma} px");
    assert!(turned > 0.02, "the positions have too little noise: {turned} m in the mean");
    assert!(gains.abs() < 1e-9, "exposures are 1 in the mean");
    let still = Effects { pose_noise: 0.0, ..Effects::default() };
    let world = World::new(&WorldParams { effects: still, ..small() }).unwrap();
    assert!(world.views().iter().all(|v| v.camera == v.reconstructed));
}

/// Points far from the surface are the wrong matches; without noise every other point lies on the surface.
#[test]
fn the_asked_share_of_points_is_wrong_and_the_rest_is_sparse() {
    let effects = Effects { outliers: 0.1, pose_noise: 0.0, observation_noise: 0.0, ..Effects::default() };
    let params = WorldParams { images: 16, effects, ..small() };
    let dir = tempfile::tempdir().unwrap();
    let summary = generate(&params, dir.path(), &mut |_| ()).unwrap();
    let world = World::new(&params).unwrap();
    let data = Dataset::load(dir.path(), &LoadOptions::default()).unwrap();
    let surface = Closest::new(&world.mesh());
    let (mut wrong, mut water) = (0.0, 0);
    for p in &data.points {
        let off = surface.distance(p.position);
        wrong += f64::from(u8::from(off > 0.2));
        // Points on the surface avoid parts without texture.
        let top = DVec3::new(p.position[0], p.position[1], p.position[2] + 0.05);
        let down = psrgs_vk::world::Ray { origin: top, direction: DVec3::NEG_Z };
        if let Some(hit) = world.trace(&down).filter(|h| h.t < 0.1) {
            water += usize::from(world.class(hit.surface, top) == psrgs_vk::world::Class::Water);
        }
    }
    let n = data.points.len() as f64;
    assert!(n > 100.0, "{n} points");
    let sigma = (0.1 * 0.9 / n).sqrt();
    // Some wrong points leave the photographs and are dropped, some lie near another surface.
    assert!(wrong / n > 0.05 - 3.0 * sigma && wrong / n < 0.1 + 4.0 * sigma, "{wrong} of {n}");
    assert_eq!(water, 0, "points on water");
    let most = 96 * 72 / 40 * 16;
    assert!(summary.observations <= most, "{} observations, {most} cells", summary.observations);
}
