//! The world's place on a map: positions in the photographs, ground control points, and the truth beside them.

use std::fs;

use image::codecs::jpeg::JpegEncoder;
use psrgs_vk::dataset::georeference::{PlaceOptions, noted_position};
use psrgs_vk::dataset::{Dataset, LoadOptions};
use psrgs_vk::format::FrameFile;
use psrgs_vk::geodesy::{Georeference, KnownFrom, Tangent};
use psrgs_vk::scene::Coordinates;
use psrgs_vk::world::{CameraKind, Effects, LidarParams, SurveyParams, World, WorldParams, generate};

use crate::small;

/// A world of many small photographs.
fn flown(camera: CameraKind) -> WorldParams {
    let lidar = LidarParams { density: 0.02, ..LidarParams::default() };
    let effects = Effects { jpeg_quality: 80, ..Effects::none() };
    WorldParams { images: 24, camera, offpath: 0, supersample: 1, effects, lidar, ..small() }
}

/// Largest distance on the site between two ways to the map, along the map and of heights.
fn apart(a: &Georeference, b: &Georeference, extent: f64) -> [f64; 2] {
    let corners = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5], [0.0, 0.0]];
    corners.into_iter().fold([0.0, 0.0], |[plane, height], [x, y]| {
        let p = [x * extent, y * extent, 0.0];
        let (a, b) = (a.to_map(p), b.to_map(p));
        [(a[0] - b[0]).hypot(a[1] - b[1]).max(plane), (a[2] - b[2]).abs().max(height)]
    })
}

#[test]
fn positions_have_the_stated_noise_and_place_the_world() {
    let dir = tempfile::tempdir().unwrap();
    let params = flown(CameraKind::Pinhole);
    generate(&params, dir.path(), &mut |_| {}).unwrap();
    let world = World::new(&params).unwrap();
    let Coordinates::EastNorthUp { origin } = world.coordinates() else { panic!("a plane") };
    let plane = Tangent::at(origin);
    let mut squares = [0.0; 3];
    for view in world.views() {
        let at = noted_position(&dir.path().join("images").join(&view.name)).expect("a position");
        assert_eq!((at.horizontal, at.vertical), (Some(1.5), None));
        let place = psrgs_vk::scene::Geodetic {
            latitude: at.latitude,
            longitude: at.longitude,
            altitude: at.altitude.expect("an altitude"),
        };
        let (got, want) = (plane.from_geodetic(place), view.camera.center());
        (0..3).for_each(|k| squares[k] += (got[k] - want[k]).powi(2) / 24.0);
    }
    // The deviation of 24 draws is within a third of the true one.
    for (square, want) in squares.into_iter().zip([1.5, 1.5, 3.0]) {
        assert!((square.sqrt() / want - 1.0).abs() < 0.34, "{} {want}", square.sqrt());
    }
    let dataset = Dataset::load(dir.path(), &LoadOptions::default()).unwrap();
    let placed = dataset.georeference(&PlaceOptions::default()).unwrap();
    let [along, up] = apart(&placed.georeference, &world.georeference().unwrap(), params.extent);
    assert_eq!(placed.georeference.known_from(), KnownFrom::Gps);
    assert!(along < 1.5 && up < 3.0, "{along} {up}");
    let fit = placed.fit.unwrap();
    assert!((1.0..3.0).contains(&fit.plane[1]) && (fit.scale - 1.0).abs() < 0.05, "{:?} {}", fit.plane, fit.scale);
}

#[test]
fn control_points_place_the_world_to_a_third_of_a_pixel() {
    for camera in [CameraKind::Pinhole, CameraKind::Opencv] {
        let dir = tempfile::tempdir().unwrap();
        let params = flown(camera);
        let summary = generate(&params, dir.path(), &mut |_| {}).unwrap();
        assert!(summary.control_points >= 6 && summary.system.contains("EPSG:32632"), "{summary:?}");
        let truth = World::new(&params).unwrap().georeference().unwrap();
        let dataset = Dataset::load(dir.path(), &LoadOptions::default()).unwrap();
        let file = dir.path().join("gcp_list.txt");
        let options = PlaceOptions { control_points: Some(file.clone()), ..PlaceOptions::default() };
        let placed = dataset.georeference(&options).unwrap();
        // A pixel is 0.56 m on the ground.
        let [along, up] = apart(&placed.georeference, &truth, params.extent);
        assert!(along < 0.2 && up < 0.4, "{camera:?}: {along} {up}");
        let fit = placed.fit.unwrap();
        assert!(fit.wrong().is_empty() && fit.notes.is_empty(), "{fit:?}");
        // One point 8 m too far north.
        let text = fs::read_to_string(&file).unwrap();
        let moved = text.lines().map(|line| {
            let mut words: Vec<String> = line.split(' ').map(str::to_owned).collect();
            if words.last().is_some_and(|name| name == "gcp02") {
                words[1] = format!("{:.4}", words[1].parse::<f64>().unwrap() + 8.0);
            }
            words.join(" ")
        });
        fs::write(&file, moved.collect::<Vec<_>>().join("\n")).unwrap();
        let placed = dataset.georeference(&options).unwrap();
        let fit = placed.fit.unwrap();
        assert_eq!(fit.wrong().iter().map(|off| off.name.as_str()).collect::<Vec<_>>(), ["gcp02"], "{fit:?}");
        let [along, up] = apart(&placed.georeference, &truth, params.extent);
        assert!(along < 0.2 && up < 0.4, "{camera:?}: {along} {up}");
    }
}

#[test]
fn frame_beside_a_world_is_the_true_way_to_the_map() {
    let dir = tempfile::tempdir().unwrap();
    let survey = SurveyParams { latitude: -33.86, longitude: 151.21, altitude: 20.0, ..SurveyParams::default() };
    let params = WorldParams { survey, images: 3, ..flown(CameraKind::Pinhole) };
    generate(&params, dir.path(), &mut |_| {}).unwrap();
    let frame = FrameFile::read(&dir.path().join("frame.json")).unwrap();
    let map = frame.map.expect("a map");
    assert_eq!((map.epsg, map.known_from.as_str()), (Some(32_756), "dataset"));
    let found = Georeference::of_record(&map, frame.coordinates.as_ref()).unwrap();
    let truth = World::new(&params).unwrap().georeference().unwrap();
    assert!(apart(&found, &truth, params.extent).iter().all(|off| *off < 1e-6));
}

/// The pixels are those of the encoder without EXIF.
#[test]
fn positions_leave_the_pixels_as_they_were() {
    let dir = tempfile::tempdir().unwrap();
    let params = WorldParams { images: 3, ..flown(CameraKind::Pinhole) };
    generate(&params, dir.path(), &mut |_| {}).unwrap();
    let world = World::new(&params).unwrap();
    let mut plain = Vec::new();
    let shot = world.shot(&world.views()[1], 1).photograph;
    shot.write_with_encoder(JpegEncoder::new_with_quality(&mut plain, 80)).unwrap();
    let written = image::open(dir.path().join("images/view_0001.jpg")).unwrap();
    assert_eq!(written.to_rgb8(), image::load_from_memory(&plain).unwrap().to_rgb8());
    let png = WorldParams { effects: Effects { jpeg_quality: 0, ..Effects::none() }, ..params };
    let dir = tempfile::tempdir().unwrap();
    generate(&png, dir.path(), &mut |_| {}).unwrap();
    let file = dir.path().join("images/view_0001.png");
    assert_eq!(image::open(&file).unwrap().to_rgb8(), shot);
    assert!(noted_position(&file).is_some(), "PNG files note positions too");
}
