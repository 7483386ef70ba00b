//! Point clouds in PLY files, and the distinction from models.

use std::fs;

use psrgs_vk::format::ply::{self, Cloud, Content, Model, read_content};
use psrgs_vk::train::cloud;

use super::splats;

#[test]
fn clouds_come_back_bit_for_bit() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("cloud.ply");
    let positions = vec![[5e5 + 0.1, 4.6e6 / 3.0, -0.0], [1.0, 2.0, 1e-300]];
    let colours = vec![[0, 128, 255], [7, 8, 9]];
    for normals in [vec![], vec![[0.6, 0.0, -0.8], [0.1, 0.2, 0.3]]] {
        let cloud = Cloud { positions: positions.clone(), normals, colours: colours.clone(), ..Cloud::default() };
        cloud.write(&file).expect("written");
        assert_eq!(Cloud::read(&file).expect("read"), cloud);
        assert_eq!(read_content(&file).expect("read"), Content::Cloud(cloud));
    }
    let wrong = Cloud { positions, normals: vec![[0.0; 3]], colours, ..Cloud::default() };
    assert!(wrong.write(&file).expect_err("does not fit").to_string().contains("1 normals"));
}

/// LAS stores integers: steps of a millimetre from an offset near the site, or of a centimetre from the grid's origin.
#[test]
fn scans_in_a_national_grid_keep_their_coordinates() {
    use las::{Builder, Point, Transform, Vector, Writer};
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("scan.las");
    let positions: Vec<[f64; 3]> =
        (0..50).map(f64::from).map(|k| [500_000.0 + 0.37 * k, 4_600_000.0 - 1.13 * k, 100.0 + 0.02 * k]).collect();
    for (scale, offset) in [(1e-3, [5e5, 4.6e6, 0.0]), (1e-2, [0.0; 3])] {
        let mut header = Builder::from((1, 2));
        let [x, y, z] = offset.map(|offset| Transform { scale, offset });
        header.transforms = Vector { x, y, z };
        let mut writer = Writer::from_path(&file, header.into_header().expect("a header")).expect("a file");
        for [x, y, z] in &positions {
            writer.write_point(Point { x: *x, y: *y, z: *z, ..Point::default() }).expect("written");
        }
        writer.close().expect("closed");
        let read = cloud::read(&file).expect("read");
        assert_eq!(read.len(), positions.len());
        // The scan is 50 m wide: a millionth of it is 0.05 mm.
        for (got, want) in read.iter().flatten().zip(positions.iter().flatten()) {
            assert!((got - want).abs() < 5e-5, "{got} instead of {want}");
        }
    }
}

/// Clouds of other programs: text, any order, no colours, an offset in a comment.
#[test]
fn foreign_clouds_are_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("cloud.ply");
    let head = "ply\nformat ascii 1.0\ncomment psrgs-vk offset 500000 0 -1\nelement vertex 2\n";
    fs::write(
        &file,
        format!("{head}property float z\nproperty int x\nproperty double y\nend_header\n3 1 2.5\n6 4 5\n"),
    )
    .expect("written");
    let cloud = Cloud::read(&file).expect("read");
    assert_eq!(cloud.positions, [[500_001.0, 2.5, 2.0], [500_004.0, 5.0, 5.0]]);
    assert_eq!((cloud.colours.len(), cloud.unknown.len(), cloud.normals.len()), (0, 0, 0));
    fs::write(&file, format!("{head}property float x\nproperty float y\nend_header\n1 2\n3 4\n")).expect("written");
    let error = read_content(&file).expect_err("no z").to_string();
    assert!(error.contains("the property 'z' is missing"), "{error}");
}

/// A file with any property of splats is a model, even an incomplete one.
#[test]
fn models_are_told_from_clouds() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("model.ply");
    let model = Model { gaussians: splats(3), sh_degree: 3, ..Model::default() };
    ply::write(&file, &model).expect("written");
    match read_content(&file).expect("read") {
        Content::Model(read) => assert_eq!(read.gaussians, model.gaussians),
        Content::Cloud(_) => panic!("taken for a cloud"),
    }
    let names = ["x", "y", "z", "scale_0"].map(|name| format!("property float {name}\n")).concat();
    fs::write(&file, format!("ply\nformat ascii 1.0\nelement vertex 1\n{names}end_header\n1 2 3 4\n"))
        .expect("written");
    let error = read_content(&file).expect_err("half a model").to_string();
    assert!(error.contains("'f_dc_0' is missing"), "{error}");
}

/// Text of a cloud whose points have the given properties (type and name).
fn with_properties(properties: &[(&str, &str)], rows: &[&str]) -> String {
    let names: String = properties.iter().map(|(kind, name)| format!("property {kind} {name}\n")).collect();
    let rows: String = rows.iter().map(|row| format!("1 2 3 {row}\n")).collect();
    let n = rows.lines().count();
    format!(
        "ply\nformat ascii 1.0\nelement vertex {n}\nproperty float x\nproperty float y\nproperty float \
         z\n{names}end_header\n{rows}"
    )
}

#[test]
fn colours_of_clouds_are_read_under_all_usual_names_and_ranges() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("cloud.ply");
    let want = vec![[0, 51, 255], [255, 102, 0]];
    let three = |kind: &'static str, names: [&'static str; 3]| names.map(|name| (kind, name)).to_vec();
    let (bytes, units, words) = (["0 51 255", "255 102 0"], ["0 0.2 1", "1 0.4 0"], ["0 13107 65535", "65535 26214 0"]);
    let harmonics = ["-1.77245385 -1.06347231 1.77245385", "1.77245385 -0.35449077 -1.77245385"];
    let packed = ["13311", "16737792"];
    // The bits of small floats: those of 0x33ff and 0xff6600.
    let floats = [13311_u32, 16_737_792].map(|bits| f32::from_bits(bits).to_string());
    for (properties, rows) in [
        (three("uchar", ["red", "green", "blue"]), bytes),
        (three("float", ["red", "green", "blue"]), units),
        (three("double", ["red", "green", "blue"]), bytes),
        (three("uchar", ["red", "green", "blue"]), units),
        (three("ushort", ["red", "green", "blue"]), words),
        (three("int", ["red", "green", "blue"]), bytes),
        (three("uchar", ["diffuse_red", "diffuse_green", "diffuse_blue"]), bytes),
        (three("float", ["red_float", "green_float", "blue_float"]), units),
        (three("float", ["r", "g", "b"]), units),
        (three("uint8", ["R", "G", "B"]), bytes),
        (three("uchar", ["Red", "Green", "Blue"]), bytes),
        (three("float", ["scalar_R", "scalar_G", "scalar_B"]), bytes),
        (three("float", ["f_dc_0", "f_dc_1", "f_dc_2"]), harmonics),
        (vec![("uint", "rgb")], packed),
        (vec![("float", "rgb")], [floats[0].as_str(), floats[1].as_str()]),
        (vec![("uint", "rgba")], packed),
    ] {
        fs::write(&file, with_properties(&properties, &rows)).expect("written");
        let cloud = Cloud::read(&file).expect("read");
        assert_eq!(cloud.colours, want, "{properties:?}");
        assert!(cloud.unknown.is_empty());
        assert!(matches!(read_content(&file).expect("read"), Content::Cloud(_)), "{properties:?}");
    }
}

#[test]
fn colours_of_unknown_form_are_none_with_properties_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("cloud.ply");
    for (properties, row, unknown) in [
        (vec![("float", "red"), ("float", "green")], "0.1 0.2", vec!["red", "green"]),
        (vec![("float", "hue"), ("float", "intensity")], "0.1 0.2", vec!["hue", "intensity"]),
        (vec![("float", "red"), ("float", "green"), ("float", "blue")], "-7 1e9 0.2", vec!["red", "green", "blue"]),
        (vec![("float", "nx")], "0.1", vec![]),
    ] {
        fs::write(&file, with_properties(&properties, &[row, row])).expect("written");
        let cloud = Cloud::read(&file).expect("read");
        assert!(cloud.colours.is_empty(), "{properties:?}");
        assert_eq!(cloud.unknown, unknown);
        cloud.write(&file).expect("written");
        assert!(Cloud::read(&file).expect("read").colours.is_empty());
    }
}
