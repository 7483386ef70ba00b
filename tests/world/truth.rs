//! Normals, off-path views and the surface, against independently cast rays and against each other.

use glam::{DMat3, DVec3};
use psrgs_vk::dataset::{Dataset, LoadOptions};
use psrgs_vk::eval::geometry::Closest;
use psrgs_vk::format::image_out::{read_depth, read_normals};
use psrgs_vk::scene::random::Random;
use psrgs_vk::world::{Class, World, WorldParams, generate};

use crate::{cast, ray_of, small};

/// Three rays around the middle of a pixel give a plane, if they meet one face: its normal, turned towards the camera.
#[test]
fn normals_are_those_of_the_surface_that_independent_rays_meet() {
    let world = World::new(&small()).unwrap();
    let mut random = Random::new(2);
    let (mut compared, mut edges) = (0, 0);
    for view in world.views().iter().chain(world.offpath()) {
        let camera = &view.camera;
        let truth = world.truth(camera);
        assert_eq!(truth.depth, world.depth(camera));
        let rows = camera.rotation.map(DVec3::from_array);
        let to_camera = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
        for _ in 0..20 {
            let x = (random.unit() * f64::from(camera.width)) as u32;
            let y = (random.unit() * f64::from(camera.height)) as u32;
            let point = |dx: f64, dy: f64| {
                let (origin, direction) = ray_of(camera, f64::from(x) + 0.5 + dx, f64::from(y) + 0.5 + dy);
                let (solid, ground) = cast(&world, origin, direction);
                origin + direction * solid.min(ground)
            };
            let step = 2e-3;
            let (a, b, c) = (point(-step, -step), point(step, -step), point(0.0, step));
            let normal = to_camera * (b - a).cross(c - a).normalize();
            let eye = to_camera * (DVec3::from_array(camera.center()) - a);
            let normal = if normal.dot(eye) < 0.0 { -normal } else { normal };
            let k = (y * camera.width + x) as usize;
            let got = DVec3::from_array(truth.normals[k].map(f64::from));
            assert!((got.length() - 1.0).abs() < 1e-5 && got.dot(eye) > 0.0, "{} ({x}, {y}): {got}", view.name);
            // A plane through rays on two faces belongs to no face.
            if got.dot(normal) > 0.999 { compared += 1 } else { edges += 1 }
        }
    }
    assert!(compared > 190 && edges <= 4, "{compared} pixels agree, {edges} lie on edges");
}

#[test]
fn what_the_photographs_show_lies_on_the_surface() {
    let world = World::new(&small()).unwrap();
    let surface = Closest::new(&world.mesh());
    let mut of_class = std::collections::HashMap::new();
    for view in world.views() {
        let (width, height) = (view.camera.width, view.camera.height);
        for k in 0..(width * height / 7) {
            let (x, y) = ((7 * k) % width, (7 * k) / width);
            let (origin, direction) = ray_of(&view.camera, f64::from(x) + 0.5, f64::from(y) + 0.5);
            let hit = world.trace(&psrgs_vk::world::Ray { origin, direction }).unwrap();
            let p = origin + direction * hit.t;
            let class = world.class(hit.surface, p);
            // Crowns are ellipsoids and cones with radii up to 1.7 m, which the mesh follows to 5 %.
            let allowed = if class == Class::Vegetation { 0.085 } else { 1e-6 };
            let distance = surface.distance(p.to_array());
            assert!(distance < allowed, "{class:?} at {p}: {distance} m off the surface");
            *of_class.entry(class).or_insert(0) += 1;
        }
    }
    assert!(of_class[&Class::Vegetation] > 100 && of_class[&Class::Building] > 100, "{of_class:?}");
}

#[test]
fn files_hold_the_truth_of_undistorted_pictures() {
    let dir = tempfile::tempdir().unwrap();
    let params = WorldParams { images: 3, ..small() };
    let summary = generate(&params, dir.path(), &mut |_| ()).unwrap();
    let world = World::new(&params).unwrap();
    assert_eq!((summary.offpath, world.offpath().len()), (2, 2));
    for (root, views) in [(dir.path().to_owned(), world.views()), (dir.path().join("offpath"), world.offpath())] {
        for view in views {
            let (clean, truth) = world.clean(&view.camera);
            let depth = read_depth(&root.join("depth").join(view.file("exr"))).unwrap();
            let normals = read_normals(&root.join("normal").join(view.file("exr"))).unwrap();
            assert_eq!((depth.width, depth.height), (96, 72));
            assert_eq!((depth.values, normals.values), (truth.depth, truth.normals));
            let kind = if views.len() == 2 { "images" } else { "clean" };
            let file = root.join(kind).join(view.file("png"));
            assert_eq!(image::open(&file).unwrap().to_rgb8(), clean, "{}", file.display());
        }
    }
    // Off-path views are a dataset of their own, with exact poses.
    let offpath = Dataset::load(&dir.path().join("offpath"), &LoadOptions::default()).unwrap();
    for (read, made) in offpath.views.iter().zip(world.offpath()) {
        assert_eq!(read.name, made.name);
        assert!((0..3).all(|k| (read.camera.center()[k] - made.camera.center()[k]).abs() < 1e-9));
    }
    let mesh = psrgs_vk::format::ply::Mesh::read(&dir.path().join("surface.ply")).unwrap();
    assert_eq!(mesh, world.mesh());
    assert_eq!(mesh.triangles.len(), summary.triangles);
}

#[test]
fn offpath_views_look_from_half_the_height_and_at_45_degrees() {
    let params = WorldParams { offpath: 8, ..small() };
    let world = World::new(&params).unwrap();
    for (k, view) in world.offpath().iter().enumerate() {
        let camera = &view.camera;
        let eye = camera.center();
        let forward = camera.rotation[2];
        let nadir = k % 2 == 0;
        let angle = (-forward[2]).acos().to_degrees();
        assert!((angle - if nadir { 0.0 } else { 45.0 }).abs() < 1e-6, "{}: {angle} degrees", view.name);
        let (x, y) = if nadir {
            (eye[0], eye[1])
        } else {
            (eye[0] + forward[0] * 24.0 * 2f64.sqrt(), eye[1] + forward[1] * 24.0 * 2f64.sqrt())
        };
        let height = eye[2] - world.terrain().height(x, y);
        assert!((height - 24.0).abs() < 1e-6, "{}: {height} m", view.name);
        // Far from every photograph: 8 m is a sixth of the flight's height.
        let apart = world.views().iter().map(|v| DVec3::from_array(v.camera.center()).distance(DVec3::from_array(eye)));
        assert!(apart.fold(f64::INFINITY, f64::min) > 8.0, "{}", view.name);
    }
}

/// Every file, byte by byte; with other noise only the files with noise differ.
#[test]
fn equal_parameters_give_equal_files() {
    let params = WorldParams { images: 2, max_side: 48, supersample: 1, ..small() };
    let files = |params: &WorldParams| {
        let dir = tempfile::tempdir().unwrap();
        generate(params, dir.path(), &mut |_| ()).unwrap();
        let (mut folders, mut found) = (vec![dir.path().to_owned()], std::collections::BTreeMap::new());
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    folders.push(path);
                } else {
                    let name = path.strip_prefix(dir.path()).unwrap().display().to_string();
                    found.insert(name, std::fs::read(path).unwrap());
                }
            }
        }
        found
    };
    let (once, again) = (files(&params), files(&params));
    assert!(once == again && once.len() > 20, "{:?}", once.keys());
    let mut silent = params.clone();
    silent.effects.sensor_noise = 0.0;
    let other = files(&silent);
    let changed: Vec<&str> =
        once.iter().filter(|(name, bytes)| other[*name] != **bytes).map(|(n, _)| n.as_str()).collect();
    let may = |name: &&str| name.starts_with("images/") || name.starts_with("sparse/") || *name == "world.toml";
    assert!(changed.contains(&"images/view_0000.jpg") && changed.iter().all(may), "{changed:?}");
}
