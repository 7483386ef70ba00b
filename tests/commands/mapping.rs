//! `map`: the files of a map, cells without data, and maps that cannot be made.

use std::fs;
use std::path::{Path, PathBuf};

use psrgs_vk::format::georaster::GeoRaster;
use psrgs_vk::format::ply;
use psrgs_vk::scene::{Frame, Gaussians};

use crate::run::{Shared, copy_folder, fails, shared, text, works};
use crate::viewing::json;

/// The cameras of a dataset without its photographs, so that nothing says where it lies.
pub fn cameras(shared: &Shared, folder: &Path) -> PathBuf {
    let to = folder.join("cameras");
    copy_folder(&shared.data().join("sparse"), &to.join("sparse"));
    to
}

#[test]
fn photographs_with_positions_have_a_map_on_earth() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("map");
    let (model, data) = (shared.model(), shared.data());
    let said = works(&["map", text(&model), "--cameras", text(&data), "--out", text(&out)]);
    let about = json(&out.join("map.json"));
    assert_eq!(about["epsg"].as_u64(), Some(32_632), "{about}");
    assert!(about["with_data"].as_u64() > Some(0) && said.contains("EPSG:32632"), "{said}");
    assert!(!out.join("orthophoto.png").exists(), "a picture without a system's name");
    // A made-up world is judged by its truth.
    let files = ["accuracy.json", "dsm.tif", "map.json", "orthophoto.tif", "quality.tif"];
    let mut left: Vec<_> = fs::read_dir(&out).expect("a folder").flatten().map(|entry| entry.file_name()).collect();
    left.sort();
    assert_eq!(left, files);
}

#[test]
fn a_map_has_its_files_and_their_numbers() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("map");
    let (model, data) = (shared.model(), cameras(shared, folder.path()));
    let args = ["map", text(&model), "--cameras", text(&data), "--out", text(&out), "--dtm", "--hillshade"];
    let said = works(&args);
    assert!(said.contains("cells of ") && said.contains("the median of the photographs"), "{said}");
    let about = json(&out.join("map.json"));
    let number = |name: &str| about[name].as_u64().unwrap_or_else(|| panic!("{name}: {about}"));
    let (width, height) = (number("width"), number("height"));
    assert!(number("with_data") > 0 && number("with_data") <= number("opaque"), "{about}");
    assert!(number("seen_by_two") <= number("with_data") && number("photographs") == 9, "{about}");
    assert!(number("with_height") > 0 && number("with_height") <= number("seen_by_two"), "{about}");
    assert_eq!((about["system"].as_str(), about["epsg"].is_null()), (Some("local"), true), "{about}");
    for name in ["orthophoto.tif", "dsm.tif", "quality.tif", "dtm.tif", "hillshade.tif"] {
        let bytes = fs::read(out.join(name)).unwrap_or_else(|problem| panic!("{name}: {problem}"));
        assert!(bytes.starts_with(b"II\x2a\0"), "{name}");
    }
    let heights = GeoRaster::read(&out.join("dsm.tif")).expect("heights").values;
    assert_eq!(heights.iter().filter(|v| v.is_finite()).count() as u64, number("with_height"));
    let picture = image::open(out.join("orthophoto.png")).expect("a PNG").to_rgba8();
    assert_eq!((u64::from(picture.width()), u64::from(picture.height())), (width, height));
    let opaque = picture.pixels().filter(|pixel| pixel.0[3] == 255).count() as u64;
    assert_eq!(opaque, number("with_data"));
    assert!(picture.pixels().all(|pixel| [0, 255].contains(&pixel.0[3])));
    let world = fs::read_to_string(out.join("orthophoto.pgw")).expect("a world file");
    let lines: Vec<f64> = world.lines().map(|line| line.parse().expect("a number")).collect();
    let of = |name: &str| about["bounds"][name].as_f64().expect("a bound");
    let gsd = about["gsd"].as_f64().expect("a distance");
    assert_eq!(lines[..4], [gsd, 0.0, 0.0, -gsd]);
    assert!((lines[4] - gsd / 2.0 - of("west")).abs() < 1e-6 && (lines[5] + gsd / 2.0 - of("north")).abs() < 1e-6);
    let left: Vec<_> = fs::read_dir(&out).expect("a folder").flatten().map(|entry| entry.file_name()).collect();
    assert_eq!(left.len(), 8, "{left:?}");
}

/// Bounds far from everything, where a map has no data and a warning, and splats that no photograph sees.
#[test]
fn cells_that_no_photograph_sees_have_no_data() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("map");
    let (model, data) = (shared.model(), cameras(shared, folder.path()));
    let args = ["map", text(&model), "--cameras", text(&data), "--out", text(&out)];
    let said = works(&[&args[..], &["--gsd", "0.5", "--bounds", "-900,-910,-890,-900"]].concat());
    assert!(said.contains("no cell has data"), "{said}");
    let about = json(&out.join("map.json"));
    assert_eq!((about["with_data"].as_u64(), about["width"].as_u64()), (Some(0), Some(20)));
    assert!(about["expected_error"].is_null());
    let picture = image::open(out.join("orthophoto.png")).expect("a PNG").to_rgba8();
    assert!(picture.pixels().all(|pixel| pixel.0 == [0; 4]));
    // A floor that splats show and no photograph: 200 m beside the scene.
    let mut floor = Gaussians::zeros(400);
    for k in 0..400 {
        let at = |k: usize| k as f32 - 9.5;
        floor.means[3 * k..3 * k + 3].copy_from_slice(&[200.0 + at(k % 20), at(k / 20), 0.0]);
        floor.quats[4 * k] = 1.0;
        floor.opacities[k] = 6.0;
    }
    let file = folder.path().join("floor.ply");
    ply::save(&file, &floor, &Frame::IDENTITY, false).expect("written");
    let args = ["map", text(&file), "--cameras", text(&data), "--out", text(&out), "--gsd", "1"];
    works(&[&args[..], &["--bounds", "195,-5,205,5"]].concat());
    let about = json(&out.join("map.json"));
    assert_eq!((about["opaque"].as_u64(), about["with_data"].as_u64()), (Some(100), Some(0)), "{about}");
    let picture = image::open(out.join("orthophoto.png")).expect("a PNG").to_rgba8();
    assert!(picture.pixels().all(|pixel| pixel.0 == [0; 4]), "colour where no photograph looks");
    let heights = GeoRaster::read(&out.join("dsm.tif")).expect("heights").values;
    assert!(heights.iter().all(|v| v.is_nan()), "{heights:?}");
}

#[test]
fn maps_that_cannot_be_made_say_why() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("map");
    let (model, data) = (shared.model(), cameras(shared, folder.path()));
    let args = ["map", text(&model), "--cameras", text(&data), "--out", text(&out)];
    let with = |more: &[&'static str]| [&args[..], more].concat();
    fails(&with(&["--gsd", "0"]), 2, &["positive number of metres, not 0"]);
    fails(&with(&["--gsd=-1"]), 2, &["positive number of metres"]);
    fails(&with(&["--gsd", "1e-7"]), 2, &["more than 2^31", "ground sample distance of"]);
    fails(&with(&["--bounds", "1,2,3"]), 2, &["west,south,east,north"]);
    fails(&with(&["--bounds", "5,0,1,1"]), 2, &["west must be less than east"]);
    fails(&with(&["--crs", "EPSG:32632"]), 3, &["nothing leads to"]);
    let empty = folder.path().join("empty.ply");
    ply::save(&empty, &Gaussians::zeros(0), &Frame::IDENTITY, false).expect("written");
    fails(&["map", text(&empty), "--cameras", text(&data), "--out", text(&out)], 3, &["empty.ply", "no splats"]);
    let none = folder.path().join("none");
    fails(&["map", text(&model), "--cameras", text(&none), "--out", text(&out)], 3, &["none"]);
    fails(&["map", text(&model), "--cameras", text(&data), "--out", text(&data)], 2, &["that is the dataset"]);
    assert!(!out.exists(), "a folder without a map");
}
