//! Datasets placed on a map by the positions that photographs note, and by ground control points.

use std::fmt::Write as _;
use std::fs;
use std::io::Cursor;
use std::path::Path;

use exif::experimental::Writer;
use exif::{Field, In, Rational, Tag, Value};
use glam::{DMat3, DQuat, DVec3};
use image::codecs::jpeg::JpegEncoder;
use image::{ImageEncoder, RgbImage};
use psrgs_vk::dataset::georeference::{PlaceError, PlaceOptions, Position, noted_position};
use psrgs_vk::dataset::{Dataset, LoadOptions, Split};
use psrgs_vk::geodesy::{Georeference, KnownFrom, ReferenceSystem, Tangent};
use psrgs_vk::scene::random::Random;
use psrgs_vk::scene::{Coordinates, Geodetic, Similarity};

use super::colmap_folder::Folder;

const ALPS: Geodetic = Geodetic { latitude: 47.65, longitude: 10.3, altitude: 740.0 };

/// From the dataset to metres east, north and up: turned about two axes, 12 m per unit.
fn truth() -> Similarity {
    let ((s, c), (u, v)) = (0.6_f64.sin_cos(), 0.2_f64.sin_cos());
    let rows = [[c, -s * v, s * u, 3.0], [s, c * v, -c * u, -5.0], [0.0, u, v, 60.0]];
    Similarity::from_rows(&rows.map(|[a, b, c, t]| [12.0 * a, 12.0 * b, 12.0 * c, t])).expect("a similarity")
}

/// Twenty cameras over an area of 4 by 3 units, ten above points.
fn flight() -> Folder {
    let names: Vec<String> = (0..20).map(|k| format!("DJI_{k:04}.JPG")).collect();
    let mut folder = Folder::ring(&names.iter().map(String::as_str).collect::<Vec<_>>(), [0.0; 3]);
    let mut random = Random::new(3);
    for (k, image) in folder.images.iter_mut().enumerate() {
        let at = [(k % 5) as f64 - 2.0, (k / 5) as f64 - 1.5, 10.0 + 0.3 * random.normal()];
        image.translation = [-at[0], at[1], at[2]];
    }
    folder
}

/// The reconstruction in other coordinates.
fn moved(folder: &Folder, by: &Similarity) -> Folder {
    // Rows as columns: the turn back. Cameras of the flight look down: half a turn about x.
    let turn = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)) * DMat3::from_cols_array_2d(&by.rotation);
    let mut folder = folder.clone();
    for image in &mut folder.images {
        let at = DVec3::from_array(by.point(center(image.translation)));
        let q = DQuat::from_mat3(&turn);
        (image.quaternion, image.translation) = ([q.w, q.x, q.y, q.z], (turn * -at).to_array());
    }
    folder.points.iter_mut().for_each(|point| point.position = by.point(point.position));
    folder
}

/// The centre of a camera that looks down.
fn center(translation: [f64; 3]) -> [f64; 3] {
    [-translation[0], translation[1], translation[2]]
}

fn jpeg(exif: Option<Vec<u8>>, xmp: Option<&str>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = JpegEncoder::new(&mut bytes);
    encoder.set_exif_metadata(exif.unwrap_or_default()).expect("EXIF");
    RgbImage::from_pixel(24, 16, image::Rgb([90, 120, 40])).write_with_encoder(encoder).expect("a JPEG file");
    if let Some(xmp) = xmp {
        let mut segment = b"\xff\xe1".to_vec();
        let packet = [b"http://ns.adobe.com/xap/1.0/\0".as_slice(), xmp.as_bytes()].concat();
        segment.extend((packet.len() as u16 + 2).to_be_bytes());
        segment.extend(packet);
        bytes.splice(2..2, segment);
    }
    bytes
}

/// EXIF with a position; without altitude where that is not finite.
fn gps(at: Geodetic) -> Vec<u8> {
    let rational = |value: f64, denom: u32| Rational { num: (value * f64::from(denom)).round() as u32, denom };
    let degrees =
        |value: f64| Value::Rational(vec![rational(value.abs(), 10_000_000), rational(0.0, 1), rational(0.0, 1)]);
    let letter = |text: &str| Value::Ascii(vec![text.as_bytes().to_vec()]);
    let field = |tag, value| Field { tag, ifd_num: In::PRIMARY, value };
    let mut fields = vec![
        field(Tag::GPSLatitudeRef, letter(if at.latitude < 0.0 { "S" } else { "N" })),
        field(Tag::GPSLatitude, degrees(at.latitude)),
        field(Tag::GPSLongitudeRef, letter(if at.longitude < 0.0 { "W" } else { "E" })),
        field(Tag::GPSLongitude, degrees(at.longitude)),
    ];
    if at.altitude.is_finite() {
        fields.push(field(Tag::GPSAltitudeRef, Value::Byte(vec![u8::from(at.altitude < 0.0)])));
        fields.push(field(Tag::GPSAltitude, Value::Rational(vec![rational(at.altitude.abs(), 1000)])));
    }
    let mut writer = Writer::new();
    fields.iter().for_each(|field| writer.push_field(field));
    let mut bytes = Cursor::new(Vec::new());
    writer.write(&mut bytes, false).expect("EXIF");
    bytes.into_inner()
}

/// The flight with photographs that note `place(number, true place)`.
fn flown(origin: Geodetic, place: impl Fn(usize, Geodetic) -> Option<Geodetic>) -> tempfile::TempDir {
    flown_in(&Similarity::IDENTITY, origin, place)
}

/// The same with the reconstruction in other coordinates.
fn flown_in(
    by: &Similarity,
    origin: Geodetic,
    place: impl Fn(usize, Geodetic) -> Option<Geodetic>,
) -> tempfile::TempDir {
    let folder = flight();
    let root = tempfile::tempdir().expect("temporary folder");
    folder.write(root.path(), &moved(&folder, by).binary());
    fs::create_dir(root.path().join("images")).expect("folder");
    let plane = Tangent::at(origin);
    for (k, image) in folder.images.iter().enumerate() {
        let at = plane.to_geodetic(truth().point(center(image.translation)));
        let bytes = jpeg(place(k, at).map(gps), None);
        fs::write(root.path().join("images").join(&image.name), bytes).expect("a photograph");
    }
    root
}

fn load(root: &Path) -> Dataset {
    Dataset::load(root, &LoadOptions { split: Split::None, ..LoadOptions::default() }).expect("loads")
}

/// Largest distance of a dataset's cameras and points from where the true similarity puts them.
fn off(found: &Georeference, origin: Geodetic, dataset: &Dataset) -> f64 {
    let (plane, system) = (Tangent::at(origin), found.system().expect("a system"));
    let points = dataset.points.iter().map(|point| point.position);
    let all = points.chain(dataset.views.iter().map(|view| view.camera.center()));
    all.map(|p| {
        let (got, want) = (found.to_map(p), system.from_geodetic(plane.to_geodetic(truth().point(p))));
        (0..3).map(|k| (got[k] - want[k]).powi(2)).sum::<f64>().sqrt()
    })
    .fold(0.0, f64::max)
}

#[test]
fn gps_of_all_hemispheres_places_a_dataset() {
    for (latitude, longitude, altitude, code) in [
        (47.65, 10.3, 740.0, 32_632),
        (-33.86, 151.21, 20.0, 32_756),
        (-22.9, -43.2, -55.0, 32_723),
        (40.7, -74.0, 15.0, 32_618),
        // Photographs on both sides of the antimeridian.
        (-17.8, 179.999_6, 10.0, 32_760),
    ] {
        let origin = Geodetic { latitude, longitude, altitude };
        let root = flown(origin, |_, at| Some(at));
        let dataset = load(root.path());
        let placed = dataset.georeference(&PlaceOptions::default()).expect("placed");
        let found = &placed.georeference;
        assert_eq!(found.known_from(), KnownFrom::Gps, "{latitude} {longitude}: {:?}", placed.unplaced);
        assert_eq!(found.system().and_then(|system| system.code()), Some(code));
        // Seven digits of a degree are 1 cm.
        assert!(off(found, origin, &dataset) < 0.05, "{latitude} {longitude}: {}", off(found, origin, &dataset));
        let fit = placed.fit.expect("a fit");
        assert!(fit.plane[2] < 0.02 && fit.height.is_some_and(|h| h[2] < 0.02), "{:?} {:?}", fit.plane, fit.height);
        assert!((fit.scale - 12.0).abs() < 1e-3 && fit.residuals.len() == 20, "{}", fit.scale);
    }
}

/// What COLMAP's `model_aligner` makes, and what else may have moved a reconstruction. No file notes an origin, so that
/// GPS alone says where the dataset lies.
#[test]
fn gps_places_aligned_models_as_well_as_its_noise_allows() {
    const NOISE: [f64; 3] = [1.5, 1.5, 3.0];
    const FLIGHTS: u64 = 16;
    let (plane, to_map) = (Tangent::at(ALPS), truth());
    let turned = Similarity { scale: 0.01, translation: [7.0, -3.0, 900.0], ..truth() };
    let sides = [("as it is", Similarity::IDENTITY), ("ENU", truth()), ("turned", turned)];
    for (name, by) in sides.into_iter().chain([("ECEF", truth().then(&plane.to_earth()))]) {
        let (mut off, mut tilt) = ([0.0; 3], 0.0);
        for flight in 0..FLIGHTS {
            let mut random = Random::new(flight);
            let noise: Vec<[f64; 3]> = (0..20).map(|_| NOISE.map(|sigma| sigma * random.normal())).collect();
            let place = |k: usize, at: Geodetic| {
                let p = plane.from_geodetic(at);
                Some(plane.to_geodetic([0, 1, 2].map(|axis| p[axis] + noise[k][axis])))
            };
            let root = flown_in(&by, ALPS, place);
            let dataset = load(root.path());
            let placed = dataset.georeference(&PlaceOptions::default()).expect("placed");
            let found = &placed.georeference;
            assert_eq!(found.known_from(), KnownFrom::Gps, "{name}: {:?}", placed.unplaced);
            let system = found.system().expect("a system");
            let error = |p: [f64; 3]| {
                let (got, want) = (found.to_map(by.point(p)), system.from_geodetic(plane.to_geodetic(to_map.point(p))));
                [0, 1, 2].map(|axis| got[axis] - want[axis])
            };
            let n = dataset.views.len() as f64;
            let mut middle = [0.0; 3];
            for view in &dataset.views {
                (0..3).for_each(|axis| middle[axis] += by.inverse().point(view.camera.center())[axis] / n);
            }
            let here = error(middle);
            (0..3).for_each(|axis| off[axis] += here[axis].powi(2) / FLIGHTS as f64);
            // How far the ground's height differs a metre to the side.
            let aside = |axis: usize| {
                let mut there = middle;
                there[axis] += 1.0;
                (error(there)[2] - here[2]) / 12.0
            };
            tilt += (aside(0).powi(2) + aside(1).powi(2)) / FLIGHTS as f64;
        }
        // Twenty cameras, whose eastings and northings have deviations of 17 and 13 m, or nearly so in turned axes. The
        // mean square of sixteen errors is below twice its expectation in all but one of two hundred cases.
        let allowed = NOISE.map(|sigma| sigma.powi(2) / 20.0);
        let allowed_tilt = allowed[2] * (1.0 / 17.0_f64.powi(2) + 1.0 / 13.4_f64.powi(2));
        println!("{name}: {:?} of {allowed:?}, tilt {tilt:.5} of {allowed_tilt:.5}", off);
        assert!((0..3).all(|axis| off[axis] < 2.0 * allowed[axis]), "{name}: {off:?} of {allowed:?}");
        assert!(tilt < 2.0 * allowed_tilt, "{name}: {tilt} of {allowed_tilt}");
        // Noise that the fit did not see would leave no error.
        assert!(off[0] > 0.1 * allowed[0] && tilt > 0.1 * allowed_tilt, "{name}: {off:?} {tilt}");
    }
}

#[test]
fn wrong_positions_are_named_and_left_out() {
    let root = flown(ALPS, |k, at| match k {
        4 => Some(Geodetic { latitude: at.latitude + 0.001, ..at }),
        11 => Some(Geodetic { altitude: at.altitude + 60.0, ..at }),
        _ => Some(at),
    });
    let dataset = load(root.path());
    let placed = dataset.georeference(&PlaceOptions::default()).expect("placed");
    let fit = placed.fit.expect("a fit");
    let wrong: Vec<&str> = fit.wrong().iter().map(|off| off.name.as_str()).collect();
    assert_eq!(wrong, ["DJI_0004.JPG", "DJI_0011.JPG"]);
    assert!((fit.wrong()[0].north - 111.2).abs() < 0.5, "{:?}", fit.wrong()[0]);
    assert!(off(&placed.georeference, ALPS, &dataset) < 0.05);
}

#[test]
fn missing_altitudes_count_for_nothing() {
    let root = flown(ALPS, |k, at| Some(if k % 2 == 0 { Geodetic { altitude: f64::NAN, ..at } } else { at }));
    let dataset = load(root.path());
    let placed = dataset.georeference(&PlaceOptions::default()).expect("placed");
    assert!(off(&placed.georeference, ALPS, &dataset) < 0.05);
    assert_eq!(placed.fit.expect("a fit").residuals.iter().filter(|off| off.up.is_none()).count(), 10);
    let root = flown(ALPS, |_, at| Some(Geodetic { altitude: f64::NAN, ..at }));
    let placed = load(root.path()).georeference(&PlaceOptions::default()).expect("local");
    assert!(placed.georeference.system().is_none());
    assert!(placed.unplaced.expect("a reason").contains("0 of at least 3 heights"));
}

#[test]
fn too_few_positions_leave_a_local_system() {
    for (count, want) in [(0, "neither the dataset nor its photographs"), (2, "2 of at least 3 places")] {
        let root = flown(ALPS, |k, at| (k < count).then_some(at));
        let dataset = load(root.path());
        let placed = dataset.georeference(&PlaceOptions::default()).expect("local");
        assert!(placed.georeference.system().is_none() && placed.fit.is_none());
        assert!(placed.unplaced.expect("a reason").contains(want));
        let asked = PlaceOptions { system: Some(ReferenceSystem::epsg(32_632).unwrap()), ..PlaceOptions::default() };
        let problem = dataset.georeference(&asked).expect_err("no way to the system");
        assert!(matches!(problem, PlaceError::Unplaced { .. }), "{problem}");
        assert!(problem.to_string().contains(want) && problem.to_string().contains("ground control points"));
    }
    // One strip.
    let root = flown(ALPS, |k, at| (k < 5).then_some(at));
    let placed = load(root.path()).georeference(&PlaceOptions::default()).expect("local");
    assert!(placed.unplaced.expect("a reason").contains("lie on a line"));
}

#[test]
fn coordinates_of_the_dataset_go_before_gps() {
    let root = flown(ALPS, |_, at| Some(at));
    let mut dataset = load(root.path());
    let origin = Geodetic { latitude: 10.0, longitude: 20.0, altitude: 0.0 };
    dataset.coordinates = Some(Coordinates::EastNorthUp { origin });
    let placed = dataset.georeference(&PlaceOptions::default()).expect("placed");
    assert_eq!((placed.georeference.known_from(), placed.fit), (KnownFrom::Dataset, None));
    assert_eq!(placed.georeference.system().and_then(|system| system.code()), Some(32_634));
}

fn noted(exif: Option<Vec<u8>>, xmp: Option<&str>) -> Option<Position> {
    let root = tempfile::tempdir().expect("temporary folder");
    let file = root.path().join("a.jpg");
    fs::write(&file, jpeg(exif, xmp)).expect("a photograph");
    noted_position(&file)
}

#[test]
fn xmp_of_dji_has_rtk_deviations_and_all_digits() {
    let xmp = r#"<x:xmpmeta><rdf:Description drone-dji:GpsLatitude="-47.650000123" drone-dji:GpsLongitude="+10.300000456"
        drone-dji:AbsoluteAltitude="-812.345" drone-dji:RtkFlag="50" drone-dji:RtkStdLon="0.012"
        drone-dji:RtkStdLat="0.016" drone-dji:RtkStdHgt="0.031"/></x:xmpmeta>"#;
    let at = noted(Some(gps(ALPS)), Some(xmp)).expect("a position");
    assert_eq!((at.latitude, at.longitude, at.altitude), (-47.650000123, 10.300000456, Some(-812.345)));
    assert!((at.horizontal.expect("a deviation") - 0.0141).abs() < 1e-4 && at.vertical == Some(0.031));
    // Elements, an older spelling, and a flag alone.
    let xmp = "<drone-dji:GpsLatitude>1.5</drone-dji:GpsLatitude><drone-dji:GpsLongtitude>2.5</drone-dji:GpsLongtitude>\
               <drone-dji:RtkFlag>34</drone-dji:RtkFlag>";
    let at = noted(None, Some(xmp)).expect("a position");
    assert_eq!((at.latitude, at.longitude, at.altitude, at.horizontal), (1.5, 2.5, None, Some(0.5)));
    // Deviations alone go with the position of EXIF.
    let at = noted(Some(gps(ALPS)), Some(r#"<a Camera:GPSXYAccuracy="0.02" Camera:GPSZAccuracy='0.04'/>"#));
    let at = at.expect("a position");
    assert!((at.latitude - ALPS.latitude).abs() < 1e-7 && at.altitude == Some(740.0));
    assert_eq!((at.horizontal, at.vertical), (Some(0.02), Some(0.04)));
}

#[test]
fn positions_that_are_none_are_not_taken() {
    let at = |latitude, longitude, altitude| Geodetic { latitude, longitude, altitude };
    assert_eq!(noted(None, None), None);
    assert_eq!(noted(Some(gps(at(0.0, 0.0, 10.0))), None), None);
    assert_eq!(noted(Some(gps(at(91.0, 10.0, 10.0))), None), None);
    assert_eq!(noted(Some(gps(at(10.0, 10.0, 2e6))), None).expect("a position").altitude, None);
    for xmp in ["drone-dji:GpsLatitude", "drone-dji:GpsLatitude=", "drone-dji:GpsLatitude=\"", "drone-dji:GpsLatitude>"]
    {
        assert_eq!(noted(None, Some(xmp)), None, "{xmp}");
    }
    let nan = r#"drone-dji:GpsLatitude="nan" drone-dji:GpsLongitude="inf""#;
    assert_eq!(noted(None, Some(nan)), None);
}

/// Every length and many changed bytes: a damaged head gives a position or none.
#[test]
fn damaged_positions_do_no_harm() {
    let root = tempfile::tempdir().expect("temporary folder");
    let file = root.path().join("a.jpg");
    let xmp = r#"<a drone-dji:GpsLatitude="1.25" drone-dji:GpsLongitude="2.5" drone-dji:RtkFlag="50"/>"#;
    let whole = jpeg(Some(gps(ALPS)), Some(xmp));
    let mut random = Random::new(8);
    for length in 0..400.min(whole.len()) {
        fs::write(&file, &whole[..length]).expect("written");
        noted_position(&file);
        let mut changed = whole.clone();
        for _ in 0..3 {
            changed[(random.unit() * 400.0) as usize] = random.bits() as u8;
        }
        fs::write(&file, &changed).expect("written");
        if let Some(at) = noted_position(&file) {
            assert!(at.latitude.abs() <= 90.0 && at.longitude.abs() <= 180.0, "{at:?}");
        }
    }
}

/// Six points on the ground, and their marks in all photographs that see them, with the photographs' true cameras.
fn control_file(dataset: &Dataset, system: &ReferenceSystem, change: impl Fn(usize, usize, &mut [f64; 5])) -> String {
    let points =
        [[-1.5, -1.0, 0.2], [1.5, -1.0, -0.1], [1.4, 1.2, 0.0], [-1.6, 1.1, 0.1], [0.1, 0.0, 0.3], [0.7, -0.4, 0.0]];
    let plane = Tangent::at(ALPS);
    let mut text = "# surveyed\n".to_owned();
    let _ = writeln!(text, "EPSG:{}", system.code().expect("a code"));
    for (number, p) in points.into_iter().enumerate() {
        let [x, y, z] = system.from_geodetic(plane.to_geodetic(truth().point(p)));
        for (k, view) in dataset.views.iter().enumerate() {
            let (camera, r) = (&view.camera, &view.camera.rotation);
            let q: [f64; 3] =
                std::array::from_fn(|i| (0..3).map(|j| r[i][j] * p[j]).sum::<f64>() + camera.translation[i]);
            let [u, v] = [camera.fx * q[0] / q[2] + camera.cx, camera.fy * q[1] / q[2] + camera.cy];
            if !(0.0..24.0).contains(&u) || !(0.0..16.0).contains(&v) {
                continue;
            }
            let mut row = [x, y, z, u - 0.5, v - 0.5];
            change(number, k, &mut row);
            let [x, y, z, u, v] = row;
            let _ = writeln!(text, "{x:.4}\t{y:.4}\t{z:.4}\t{u:.4}\t{v:.4}\t{}\tgcp{number}", view.name.to_lowercase());
        }
    }
    text
}

fn by_marks(dataset: &Dataset, root: &Path, text: &str) -> Result<psrgs_vk::dataset::georeference::Placed, PlaceError> {
    let file = root.join("gcp_list.txt");
    fs::write(&file, text).expect("written");
    dataset.georeference(&PlaceOptions { control_points: Some(file), ..PlaceOptions::default() })
}

#[test]
fn control_points_place_a_dataset_and_a_gross_error_is_named() {
    let root = flown(ALPS, |_, _| None);
    let dataset = load(root.path());
    let gauss = ReferenceSystem::epsg(31_467).unwrap();
    let utm = ReferenceSystem::epsg(32_632).unwrap();
    for system in [&utm, &gauss] {
        let placed = by_marks(&dataset, root.path(), &control_file(&dataset, system, |_, _, _| {})).expect("placed");
        let found = &placed.georeference;
        assert_eq!((found.known_from(), found.system()), (KnownFrom::ControlPoints, Some(system)));
        assert!(off(found, ALPS, &dataset) < 0.02, "{}", off(found, ALPS, &dataset));
        assert!(placed.fit.expect("a fit").wrong().is_empty());
    }
    // A point 20 m off, and a mark 7 pixels off.
    let text = control_file(&dataset, &utm, |point, view, row| {
        row[0] += if point == 3 { 20.0 } else { 0.0 };
        row[3] += if (point, view) == (4, 7) { 7.0 } else { 0.0 };
    });
    let placed = by_marks(&dataset, root.path(), &text).expect("placed");
    let fit = placed.fit.expect("a fit");
    assert_eq!(fit.wrong().iter().map(|off| off.name.as_str()).collect::<Vec<_>>(), ["gcp3"]);
    assert!((fit.wrong()[0].east - 20.0).abs() < 0.2, "{:?}", fit.wrong()[0]);
    assert_eq!(fit.notes.len(), 1, "{:?}", fit.notes);
    assert!(fit.notes[0].contains("gcp4: the mark in dji_0007.jpg is "), "{:?}", fit.notes);
    assert!(off(&placed.georeference, ALPS, &dataset) < 0.05, "{}", off(&placed.georeference, ALPS, &dataset));
}

#[test]
fn control_points_move_a_grid_of_opendronemap() {
    let root = flown(ALPS, |_, _| None);
    let mut dataset = load(root.path());
    let utm = ReferenceSystem::epsg(32_632).unwrap();
    let text = control_file(&dataset, &utm, |_, _, _| {});
    // The dataset in metres of the grid, 3 m too far east and 2 m too high; its cameras move with it.
    let [x, y, _] = utm.from_geodetic(ALPS);
    let true_way = Georeference::on_plane(Tangent::at(ALPS), &truth(), Some(utm)).expect("a way");
    let to_grid = true_way.similarity_at([0.0; 3]);
    let shift = [3.0 - x, 2.0 - y, 2.0];
    let shifted = Similarity { translation: std::array::from_fn(|k| to_grid.translation[k] + shift[k]), ..to_grid };
    for view in &mut dataset.views {
        let center = shifted.point(view.camera.center());
        let r = view.camera.rotation;
        let turned: [[f64; 3]; 3] =
            std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| r[i][k] * shifted.rotation[j][k]).sum()));
        view.camera.rotation = turned;
        view.camera.translation = std::array::from_fn(|i| -(0..3).map(|j| turned[i][j] * center[j]).sum::<f64>());
    }
    dataset.coordinates = Some(Coordinates::grid("WGS84 UTM 32N", None, [x, y]));
    let placed = by_marks(&dataset, root.path(), &text).expect("placed");
    assert_eq!(placed.georeference.known_from(), KnownFrom::ControlPoints);
    for p in [[0.0; 3], [1.0, -1.0, 0.3]] {
        let (got, want) = (placed.georeference.to_map(shifted.point(p)), true_way.to_map(p));
        assert!((0..3).all(|k| (got[k] - want[k]).abs() < 0.02), "{got:?} {want:?}");
        let back = placed.georeference.to_dataset(got);
        assert!((0..3).all(|k| (back[k] - shifted.point(p)[k]).abs() < 1e-3), "{back:?}");
    }
    let record = placed.georeference.record([0.0; 3]).expect("a record");
    let again = Georeference::of_record(&record, dataset.coordinates.as_ref()).expect("read again");
    let (a, b) = (again.to_map([5.0, 6.0, 7.0]), placed.georeference.to_map([5.0, 6.0, 7.0]));
    assert!((0..3).all(|k| (a[k] - b[k]).abs() < 1e-6), "{a:?} {b:?}");
}

#[test]
fn damaged_control_files_name_line_and_field() {
    let root = flown(ALPS, |_, _| None);
    let dataset = load(root.path());
    let utm = ReferenceSystem::epsg(32_632).unwrap();
    let row = "600000 5280000 700 5 5 DJI_0001.JPG a";
    for (text, want) in [
        (String::new(), "reference system at line 1: is missing"),
        ("600000 5280000 700 5 5 a.jpg\n".to_owned(), "reference system at line 1"),
        ("EPSG:32632+5783\n".to_owned(), "name the horizontal part alone"),
        ("EPSG:32632\n".to_owned(), "marks at line 1: none follow"),
        (format!("EPSG:32632\n\n{row}\n600000 x 700 5 5 a.jpg\n"), "y at line 4: 'x' is no number"),
        (format!("EPSG:32632\n{row}\n600000 5280000 700 inf 5 a.jpg\n"), "pixel x at line 3: 'inf' is no number"),
        ("EPSG:32632\n600000 5280000\n".to_owned(), "z at line 2: is missing"),
        ("EPSG:32632\n600000 5280000 700 5 5\n".to_owned(), "photograph at line 2: is missing"),
        ("EPSG:32632\n600000 5280000 700 5 5 other.jpg\n".to_owned(), "'other.jpg' is no photograph of the dataset"),
        ("EPSG:32632\n600000 5280000 700 99 5 DJI_0001.JPG\n".to_owned(), "which has 24x16 pixels"),
        (format!("EPSG:32632\n{row}\n"), "0 of at least 3 places are known; mark at least three points"),
    ] {
        let problem = by_marks(&dataset, root.path(), &text).expect_err(want).to_string();
        assert!(problem.contains(want), "{want}: {problem}");
    }
    // Heights may be unknown, but not all of them.
    let without: String = control_file(&dataset, &utm, |point, _, row| {
        if point > 3 {
            row[2] = f64::NAN
        }
    });
    let placed = by_marks(&dataset, root.path(), &without).expect("placed");
    assert!(off(&placed.georeference, ALPS, &dataset) < 0.05);
    let none = control_file(&dataset, &utm, |_, _, row| row[2] = f64::NAN);
    assert!(by_marks(&dataset, root.path(), &none).expect_err("none").to_string().contains("heights are known"));
}
