//! Numbers that are finite in the file and infinite in the scene, and names that lead out of the dataset.

use std::fs;
use std::path::Path;

use psrgs_vk::dataset::{Dataset, Error, LoadOptions};
use psrgs_vk::format::{las, ply};

use super::colmap_folder::{Folder, PointRow};
use super::{load, scan};

fn refused(folder: &Folder, text: bool) -> String {
    let root = tempfile::tempdir().expect("temporary folder");
    folder.write(root.path(), &if text { folder.text() } else { folder.binary() });
    let options = LoadOptions { photographs: false, strict: true, ..LoadOptions::default() };
    match Dataset::load(root.path(), &options) {
        Err(error @ Error::OutOfRange { .. }) => error.to_string(),
        Err(error) => panic!("{error}"),
        Ok(dataset) => panic!("{:?} {:?}", dataset.frame, dataset.views[0].camera),
    }
}

#[test]
fn lenses_without_a_picture_are_refused() {
    let good = Folder::ring(&["a.png", "b.png"], [0.0; 3]);
    for (model, params) in [
        // The polynomial of the lens turns back at once.
        (("RADIAL", 3), vec![20.5, 11.0, 8.0, -1e300, 0.0]),
        (("OPENCV_FISHEYE", 5), vec![20.5, 20.5, 11.0, 8.0, -1e300, 0.0, 0.0, 0.0]),
    ] {
        let mut folder = good.clone();
        folder.cameras[0].model = model;
        folder.cameras[0].params = params;
        let error = refused(&folder, model.0 == "RADIAL");
        assert!(error.contains("the camera of 'a.png' cannot be used"), "{error}");
    }
}

#[test]
fn poses_and_points_beyond_the_scene_are_refused() {
    let good = Folder::ring(&["a.png", "b.png"], [0.0; 3]);
    let mut far = good.clone();
    far.images[1].translation = [1e200, 0.0, 0.0];
    let error = refused(&far, false);
    assert!(error.contains("images.bin") && error.contains("the camera of 'a.png'"), "{error}");
    let mut far = good.clone();
    far.points.push(PointRow { id: 7, position: [0.0, 1e60, 0.0], ..far.points[0].clone() });
    let error = refused(&far, true);
    assert!(error.contains("points3D.txt") && error.contains("point 7"), "{error}");
}

#[test]
fn a_cloud_is_finite_with_its_offset_too() {
    let root = tempfile::tempdir().expect("temporary folder");
    let file = root.path().join("cloud.ply");
    let header = "ply\nformat ascii 1.0\ncomment psrgs-vk offset 1.7e308 0 0\nelement vertex 1\nproperty double \
                  x\nproperty double y\n\
                  property double z\nend_header\n";
    fs::write(&file, format!("{header}1.7e308 0 0\n")).expect("written");
    let error = ply::Cloud::read(&file).expect_err("infinite").to_string();
    assert!(error.contains("vertex 0") && error.contains("not finite"), "{error}");
}

#[test]
fn a_scan_is_finite_with_its_scale() {
    let root = tempfile::tempdir().expect("temporary folder");
    let (plain, compressed) = (root.path().join("scan.las"), root.path().join("scan.laz"));
    scan(&plain, &compressed);
    for file in [plain, compressed] {
        let mut bytes = fs::read(&file).expect("file");
        bytes[139..147].copy_from_slice(&(-1e300_f64).to_le_bytes());
        fs::write(&file, &bytes).expect("written");
        let error = las::read(&file).map(|points| points.len()).expect_err("an infinite y").to_string();
        assert!(error.contains("y scale at byte 139: -1e300 makes coordinates that are not finite"), "{error}");
    }
}

fn transforms(root: &Path, photograph: &str, points: &str) {
    let text = format!(
        r#"{{"camera_angle_x": 0.8, "ply_file_path": "{points}", "frames": [{{"file_path": "{photograph}",
        "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]}}]}}"#
    );
    fs::write(root.join("transforms.json"), text).expect("written");
}

/// A camera without a size takes the size of its photograph: the name is checked before the photograph is opened.
#[test]
fn sizes_are_not_asked_of_files_outside_of_the_dataset() {
    let root = tempfile::tempdir().expect("temporary folder");
    for name in ["/dev/zero", "../a.png", "images/../../a.png"] {
        transforms(root.path(), name, "points.ply");
        let error = load(root.path()).expect_err("a name");
        assert!(error.contains("leads out of the folder of photographs"), "{error}");
    }
}

/// Opening a pipe would wait for a writer.
#[cfg(unix)]
#[test]
fn pipes_are_refused_unopened() {
    let folder = Folder::ring(&["images/a.png"], [0.0; 3]);
    let root = tempfile::tempdir().expect("temporary folder");
    folder.write_photographs(root.path());
    let pipe = |name: &str| {
        let file = root.path().join(name);
        if file.exists() {
            fs::remove_file(&file).expect("removed");
        }
        let made = std::process::Command::new("mkfifo").arg(&file).status().expect("mkfifo");
        assert!(made.success());
    };
    pipe("points.ply");
    transforms(root.path(), "images/a.png", "points.ply");
    let error = load(root.path()).expect_err("points in a pipe");
    assert!(error.contains("points.ply") && error.contains("not a regular file"), "{error}");
    pipe("images/a.png");
    let error = load(root.path()).expect_err("a photograph in a pipe");
    assert!(error.contains("a.png") && error.contains("not a regular file"), "{error}");
}
