//! Point clouds in PLY files, and telling them from models.

use std::fs;

use psrgs_vk::format::ply::{self, Cloud, Content, Model, read_content};
use psrgs_vk::train::cloud;

use super::splats;

#[test]
fn clouds_come_back_bit_for_bit() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("cloud.ply");
    let positions = vec![[5e5 + 0.1, 4.6e6 / 3.0, -0.0], [1.0, 2.0, 1e-300]];
    let colors = vec![[0, 128, 255], [7, 8, 9]];
    for normals in [vec![], vec![[0.6, 0.0, -0.8], [0.1, 0.2, 0.3]]] {
        let cloud = Cloud { positions: positions.clone(), normals, colors: colors.clone() };
        cloud.write(&file).expect("written");
        assert_eq!(Cloud::read(&file).expect("read"), cloud);
        assert_eq!(read_content(&file).expect("read"), Content::Cloud(cloud));
    }
    let wrong = Cloud { positions, normals: vec![[0.0; 3]], colors };
    assert!(wrong.write(&file).expect_err("does not fit").to_string().contains("1 normals"));
}

/// LAS keeps integers: in steps of a millimetre from an offset near the site, or of a centimetre from the grid's origin.
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

/// As other programs write them: text, any order, no colours, an offset in a comment.
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
    assert_eq!((cloud.colors, cloud.normals.len()), (vec![[128; 3]; 2], 0));
    fs::write(&file, format!("{head}property float x\nproperty float y\nend_header\n1 2\n3 4\n")).expect("written");
    let error = read_content(&file).expect_err("no z").to_string();
    assert!(error.contains("the property 'z' is missing"), "{error}");
}

/// A file with anything of splats is a model, whole or not.
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
