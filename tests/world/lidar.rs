//! The simulated laser scan: its files, density, noise and gaps.

use std::collections::HashMap;

use glam::DVec3;
use psrgs_vk::eval::geometry::Closest;
use psrgs_vk::world::{Class, Effects, LidarParams, World, WorldParams, generate};

use crate::small;

fn params() -> WorldParams {
    WorldParams { images: 1, offpath: 0, lidar: LidarParams { density: 4.0, ..LidarParams::default() }, ..small() }
}

#[test]
fn both_files_hold_the_echoes() {
    let dir = tempfile::tempdir().unwrap();
    let params = params();
    let summary = generate(&params, dir.path(), &mut |_| ()).unwrap();
    let echoes = World::new(&params).unwrap().lidar();
    let mut las = las::Reader::from_path(dir.path().join("lidar.las")).unwrap();
    assert_eq!((las.header().number_of_points() as usize, summary.lidar), (echoes.len(), echoes.len()));
    let mut classes = HashMap::new();
    for (point, echo) in las.points().map(Result::unwrap).zip(&echoes) {
        let [x, y, z] = echo.position;
        assert!(DVec3::new(point.x - x, point.y - y, point.z - z).abs().max_element() <= 0.0005 + 1e-9);
        let colour = point.color.unwrap();
        assert_eq!([colour.red, colour.green, colour.blue], echo.colour.map(|c| u16::from(c) * 257));
        assert_eq!((u8::from(point.classification), point.intensity), (echo.class as u8, echo.intensity));
        assert!((point.scan_angle - echo.angle).abs() < 0.01 && point.gps_time == Some(echo.time));
        *classes.entry(echo.class).or_insert(0) += 1;
    }
    for class in [Class::Ground, Class::Vegetation, Class::Building, Class::Other] {
        assert!(classes[&class] > 20, "{classes:?}");
    }
    // The PLY file by another reader.
    let mut file = std::io::BufReader::new(std::fs::File::open(dir.path().join("lidar.ply")).unwrap());
    let ply = ply_rs::parser::Parser::<ply_rs::ply::DefaultElement>::new().read_ply(&mut file).unwrap();
    let vertices = &ply.payload["vertex"];
    assert_eq!(vertices.len(), echoes.len());
    for (vertex, echo) in vertices.iter().zip(&echoes).step_by(97) {
        assert_eq!(vertex["x"], ply_rs::ply::Property::Double(echo.position[0]));
        assert_eq!(vertex["green"], ply_rs::ply::Property::UChar(echo.colour[1]));
        assert_eq!(vertex["classification"], ply_rs::ply::Property::UChar(echo.class as u8));
    }
}

#[test]
fn density_and_noise_are_as_stated_and_walls_have_gaps() {
    // Without objects, so that the ground has an even density.
    let bare = WorldParams { effects: Effects::none(), ..params() };
    let world = World::new(&bare).unwrap();
    let echoes = world.lidar();
    let side = 1.4 * 80.0;
    let pulses = echoes.len() as f64 / (side * side);
    assert!((pulses - 4.0).abs() < 0.05 * 4.0, "{pulses} echoes per square metre");

    let surface = Closest::new(&world.mesh());
    let (mut squares, mut ground) = (0.0, 0.0);
    for e in echoes.iter().filter(|e| e.class == Class::Ground) {
        let off = surface.distance(e.position);
        // Range noise along an oblique ray is smaller across the ground, whose slope is a few per cent.
        assert!(off < 6.0 * 0.03, "{off} m");
        squares += (off / f64::from(e.angle).to_radians().cos()).powi(2);
        ground += 1.0;
    }
    let sigma = (squares / ground).sqrt();
    assert!((sigma - 0.03).abs() < 0.1 * 0.03, "range noise of {sigma} m");

    // Echoes on the walls of buildings, by their height: a plan area has 4 echoes per square metre, a wall far fewer.
    let walls: Vec<bool> = echoes
        .iter()
        .filter(|e| e.class == Class::Building)
        .map(|e| {
            let p = DVec3::from_array(e.position);
            let down = psrgs_vk::world::Ray { origin: p + DVec3::Z * 50.0, direction: DVec3::NEG_Z };
            let top = 50.0 - world.trace(&down).unwrap().t;
            // More than 40 cm below the surface above: a wall, or under the eaves.
            top > 0.4
        })
        .collect();
    let on_walls = walls.iter().filter(|w| **w).count() as f64;
    let share = on_walls / walls.len() as f64;
    assert!(share > 0.005 && share < 0.25, "{share} of the echoes of buildings are on walls");
}

#[test]
fn water_hardly_answers_and_makes_a_hole() {
    let with = World::new(&params()).unwrap().lidar();
    let dry = WorldParams { effects: Effects { water: false, ..Effects::default() }, ..params() };
    let without = World::new(&dry).unwrap().lidar();
    let water = with.iter().filter(|e| e.class == Class::Water).count();
    let gone = without.len() - with.len();
    assert!(gone > 100, "{gone} echoes less");
    let share = water as f64 / (water + gone) as f64;
    assert!(
        (share - 0.03).abs() < 5.0 * (0.03f64 * 0.97 / (water + gone) as f64).sqrt(),
        "{share} of the pulses came back"
    );
    assert!(without.iter().all(|e| e.class != Class::Water));
}
