//! The synthetic world against independent ray casting, parsing and projection.

use glam::{DMat3, DVec3};
use psrgs_vk::scene::Camera;
use psrgs_vk::scene::random::Random;
use psrgs_vk::world::{Effects, LidarParams, Ray, Shape, Solid, Surface, World, WorldError, WorldParams};

#[path = "world/dataset.rs"]
mod dataset;
#[path = "world/lidar.rs"]
mod lidar;
#[path = "world/opencv.rs"]
mod opencv;
#[path = "world/sparse.rs"]
mod sparse;
#[path = "world/survey.rs"]
mod survey;
#[path = "world/true_map.rs"]
mod true_map;
#[path = "world/truth.rs"]
mod truth;

pub(crate) fn small() -> WorldParams {
    let lidar = LidarParams { density: 0.1, ..LidarParams::default() };
    WorldParams { images: 8, max_side: 96, seed: 5, pixels_per_point: 40, offpath: 2, lidar, ..WorldParams::default() }
}

/// The ray through a point of the image, from the camera's definition: the direction has camera-frame z = 1.
pub(crate) fn ray_of(camera: &Camera, x: f64, y: f64) -> (DVec3, DVec3) {
    let rows = camera.rotation.map(DVec3::from_array);
    let r = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
    let back = r.transpose();
    let centre = back * -DVec3::from_array(camera.translation);
    let d = back * DVec3::new((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0);
    (centre, d)
}

/// Whether a point in a solid's frame is inside, from the shape's definition alone.
fn is_inside(shape: &Shape, p: DVec3) -> bool {
    match shape {
        Shape::Convex(faces) => faces.iter().all(|f| f.normal.dot(p) <= f.offset),
        Shape::Ellipsoid(r) => (p.x / r.x).powi(2) + (p.y / r.y).powi(2) + (p.z / r.z).powi(2) <= 1.0,
        Shape::Cone { radius, height } => {
            (0.0..=*height).contains(&p.z) && p.x.hypot(p.y) <= radius * (1.0 - p.z / height)
        }
    }
}

/// First t at which the ray is inside the solid. Candidates are intersections with any bounding surface; the point just
/// behind a candidate must be inside.
fn first_inside(solid: &Solid, origin: DVec3, direction: DVec3) -> f64 {
    let turn = DMat3::from_rotation_z(-solid.yaw);
    let (o, d) = (turn * (origin - solid.origin), turn * direction);
    let quadratic = |a: f64, b: f64, c: f64| {
        let root = (b * b - 4.0 * a * c).sqrt();
        [(-b - root) / (2.0 * a), (-b + root) / (2.0 * a)]
    };
    let mut candidates = Vec::new();
    match &solid.shape {
        Shape::Convex(faces) => {
            candidates.extend(faces.iter().map(|f| (f.offset - f.normal.dot(o)) / f.normal.dot(d)));
        }
        Shape::Ellipsoid(r) => {
            let (oo, dd) = (o / *r, d / *r);
            candidates.extend(quadratic(dd.length_squared(), 2.0 * oo.dot(dd), oo.length_squared() - 1.0));
        }
        Shape::Cone { radius, height } => {
            let k = (radius / height).powi(2);
            let g = o.z - height;
            candidates.extend(quadratic(
                d.x * d.x + d.y * d.y - k * d.z * d.z,
                2.0 * (o.x * d.x + o.y * d.y - k * g * d.z),
                o.x * o.x + o.y * o.y - k * g * g,
            ));
            candidates.push(-o.z / d.z);
        }
    }
    candidates
        .into_iter()
        .filter(|t| t.is_finite() && *t > 0.0 && is_inside(&solid.shape, o + d * (t + 1e-7)))
        .fold(f64::INFINITY, f64::min)
}

/// First crossing from above to below the ground, by marching in steps of a few centimetres and bisection.
fn first_below(world: &World, origin: DVec3, direction: DVec3, limit: f64) -> f64 {
    let above = |t: f64| {
        let p = origin + direction * t;
        p.z - world.terrain().height(p.x, p.y)
    };
    let step = 0.03 / direction.length();
    let (_, top) = world.terrain().range();
    // The march begins at the height of the highest ground.
    let mut t = if direction.z < 0.0 { ((top + 0.1 - origin.z) / direction.z).max(0.0) } else { 0.0 };
    while t < limit {
        if above(t + step) <= 0.0 {
            let (mut a, mut b) = (t, t + step);
            for _ in 0..60 {
                let m = 0.5 * (a + b);
                if above(m) > 0.0 { a = m } else { b = m }
            }
            return b;
        }
        t += step;
    }
    f64::INFINITY
}

/// Depths along a ray by the two searches above: of the solids and of the ground.
pub(crate) fn cast(world: &World, origin: DVec3, direction: DVec3) -> (f64, f64) {
    let solid = world.solids().iter().map(|s| first_inside(s, origin, direction)).fold(f64::INFINITY, f64::min);
    (solid, first_below(world, origin, direction, solid.min(2000.0)))
}

#[test]
fn depth_agrees_with_an_independent_ray_caster() {
    let world = World::new(&small()).unwrap();
    let (mut terrain, mut solids, mut grazing) = (0, 0, 0);
    let mut random = Random::new(1);
    for view in world.views().iter().chain(world.offpath()) {
        let depth = world.depth(&view.camera);
        for _ in 0..60 {
            let x = (random.unit() * f64::from(view.camera.width)) as u32;
            let y = (random.unit() * f64::from(view.camera.height)) as u32;
            let (origin, direction) = ray_of(&view.camera, f64::from(x) + 0.5, f64::from(y) + 0.5);
            let (solid, ground) = cast(&world, origin, direction);
            let expected = solid.min(ground);
            let got = f64::from(depth[(y * view.camera.width + x) as usize]);
            // The march misses dips within a step, and the membership test misses solids crossed in less than 1e-7.
            // Both need a ray that touches an edge. Such rays are counted and must be rare.
            if (got - expected).abs() > 1e-6 * expected {
                let moved = ray_of(&view.camera, f64::from(x) + 0.5005, f64::from(y) + 0.5005);
                let near = world.trace(&Ray { origin: moved.0, direction: moved.1 }).map_or(0.0, |h| h.t);
                assert!(
                    (near - got).abs() > 1e-4 * got || (near - expected).abs() > 1e-4 * expected,
                    "{} ({x}, {y}): depth {got}, independent {expected}",
                    view.name
                );
                grazing += 1;
            }
            if solid < ground { solids += 1 } else { terrain += 1 }
        }
    }
    assert!(grazing <= 2, "{grazing} rays touch edges");
    assert!(terrain > 80 && solids > 80, "too few rays of a kind of surface: {terrain} ground, {solids} solid");
}

#[test]
fn hits_lie_on_their_surface_and_normals_face_the_ray() {
    let world = World::new(&small()).unwrap();
    let camera = &world.views()[6].camera;
    for k in 0..400u32 {
        let (origin, direction) = ray_of(camera, f64::from(k % 20) * 4.7 + 1.3, f64::from(k / 20) * 3.5 + 1.1);
        let hit = world.trace(&Ray { origin, direction }).expect("the ground extends beyond the view");
        let p = origin + direction * hit.t;
        assert!((hit.normal.length() - 1.0).abs() < 1e-9);
        assert!(hit.normal.dot(direction) < 1e-9, "{:?}", hit.surface);
        match hit.surface {
            Surface::Terrain => assert!((p.z - world.terrain().height(p.x, p.y)).abs() < 1e-6),
            Surface::Solid { index, .. } => {
                let solid = &world.solids()[index as usize];
                let local = |shift: f64| DMat3::from_rotation_z(-solid.yaw) * (p + hit.normal * shift - solid.origin);
                assert!(!is_inside(&solid.shape, local(1e-6)));
                let b = solid.bounds();
                assert!(p.cmpge(b.min - 1e-6).all() && p.cmple(b.max + 1e-6).all());
            }
        }
    }
}

#[test]
fn photographs_depend_on_parameters_only() {
    let effects = Effects { exposure: 0.0, sensor_noise: 0.0, ..Effects::default() };
    let params = WorldParams { supersample: 1, effects, ..small() };
    let shot = |p: &WorldParams, threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let world = World::new(p).unwrap();
        pool.install(|| world.photograph(&world.views()[5].camera, 5))
    };
    let (image, depth) = shot(&params, 1);
    let again = shot(&params, 3);
    assert_eq!((&image, &depth), (&again.0, &again.1));
    assert_ne!(image, shot(&WorldParams { seed: 6, ..params.clone() }, 2).0);
    // Each effect changes the photograph (number 5) or leaves fewer solids.
    let with = |change: fn(&mut Effects)| {
        let mut p = params.clone();
        change(&mut p.effects);
        p
    };
    for change in [
        (|e: &mut Effects| e.exposure = 0.1) as fn(&mut Effects),
        |e| e.sensor_noise = 2.0,
        |e| e.shadows = false,
        |e| e.reflections = false,
    ] {
        let (other, same) = shot(&with(change), 2);
        assert_ne!(image, other);
        assert_eq!(depth, same);
    }
    let places = |p: &WorldParams| -> Vec<([f64; 3], f64)> {
        World::new(p).unwrap().solids().iter().map(|solid| (solid.origin.to_array(), solid.yaw)).collect()
    };
    let everything = places(&params);
    let solids = |p: &WorldParams| World::new(p).unwrap().solids().len();
    let all = everything.len();
    for change in [
        (|e: &mut Effects| e.vegetation = false) as fn(&mut Effects),
        |e| e.vehicles = false,
        |e| e.masts = false,
        |e| e.wires = false,
    ] {
        let left = places(&with(change));
        assert!(left.len() < all);
        // The remaining solids keep their places and their order.
        let mut before = everything.iter();
        assert!(left.iter().all(|place| before.any(|p| p == place)), "something was moved");
    }
    // Other effects change colours somewhere. Geometry and all else stay.
    for change in [
        (|e: &mut Effects| e.text = false) as fn(&mut Effects),
        |e| e.repeats = false,
        |e| e.plain = false,
        |e| e.water = false,
    ] {
        let other = with(change);
        assert_eq!(solids(&other), all);
        let (before, after) = (World::new(&params).unwrap(), World::new(&other).unwrap());
        let changed = before.views().iter().filter(|v| before.clean(&v.camera).0 != after.clean(&v.camera).0).count();
        assert!(changed > 0, "{:?}", other.effects);
        for view in before.views() {
            assert_eq!(before.truth(&view.camera), after.truth(&view.camera));
        }
    }
}

#[test]
fn every_photograph_shows_the_ground_with_detail() {
    for seed in 0..3 {
        let world = World::new(&WorldParams { seed, images: 12, ..small() }).unwrap();
        for (k, view) in world.views().iter().enumerate() {
            let (image, depth) = world.photograph(&view.camera, k as u32);
            let sky = depth.iter().filter(|z| **z == 0.0).count();
            assert_eq!(sky, 0, "{} of seed {seed} sees past the ground", view.name);
            let (width, height) = image.dimensions();
            let at = |x, y| f64::from(image.get_pixel(x, y).0[1]);
            let mut detail = 0.0;
            for y in 1..height {
                for x in 1..width {
                    detail += (at(x, y) - at(x - 1, y)).abs() + (at(x, y) - at(x, y - 1)).abs();
                }
            }
            detail /= 2.0 * f64::from((width - 1) * (height - 1));
            assert!((4.0..60.0).contains(&detail), "{} of seed {seed}: mean step {detail}", view.name);
        }
    }
}

#[test]
fn parameters_out_of_range_are_named() {
    let bad = |p: WorldParams| World::new(&p).err().expect("rejected").to_string();
    assert!(bad(WorldParams { images: 0, ..small() }).contains("`images` is 0"));
    assert!(bad(WorldParams { extent: f64::NAN, ..small() }).contains("`extent`"));
    assert!(
        bad(WorldParams { effects: Effects { jpeg_quality: 101, ..Effects::default() }, ..small() }).contains("jpeg")
    );
    let even = World::new(&WorldParams { supersample: 2, ..small() }).err();
    assert!(matches!(even, Some(WorldError::EvenSupersample { value: 2 })));
    assert!(toml::from_str::<WorldParams>("imagse = 3").is_err(), "a misspelt key is an error");
}
