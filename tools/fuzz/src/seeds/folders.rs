//! Datasets with a few synthetic cameras.

use serde_json::{Value, json};

// The tests' own module, of which only a part is used here.
#[allow(dead_code)]
#[path = "../../../../tests/colmap_folder/mod.rs"]
mod colmap_folder;

use colmap_folder::Folder;

use crate::chosen;

/// Two cameras and twelve points.
pub(crate) fn ring() -> Folder {
    Folder::ring(&["a.png", "b.png"], [1.0, 2.0, 3.0])
}

/// Each file of a COLMAP model, with cameras of every camera model.
pub fn colmap(text: bool) -> Vec<Vec<u8>> {
    let models: [((&str, i32), usize); 12] = [
        (("SIMPLE_PINHOLE", 0), 3),
        (("PINHOLE", 1), 4),
        (("SIMPLE_RADIAL", 2), 4),
        (("RADIAL", 3), 5),
        (("OPENCV", 4), 8),
        (("OPENCV_FISHEYE", 5), 8),
        (("FULL_OPENCV", 6), 12),
        (("FOV", 7), 5),
        (("SIMPLE_RADIAL_FISHEYE", 8), 4),
        (("RADIAL_FISHEYE", 9), 5),
        (("THIN_PRISM_FISHEYE", 10), 12),
        (("RAD_TAN_THIN_PRISM_FISHEYE", 11), 16),
    ];
    let written = |folder: &Folder| if text { folder.text() } else { folder.binary() };
    let mut seeds: Vec<Vec<u8>> = (0..).zip(written(&ring())).map(|(i, (_, bytes))| chosen(i, bytes)).collect();
    for (model, count) in models {
        let mut folder = ring();
        let single = ["SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE"];
        let focal = if single.contains(&model.0) { 1 } else { 2 };
        let params = (0..count).map(|k| {
            if k < focal {
                20.5
            } else if k < focal + 2 {
                10.25
            } else {
                0.015625
            }
        });
        folder.cameras[0].model = model;
        folder.cameras[0].params = params.collect();
        let [(_, cameras), ..] = written(&folder);
        seeds.push(chosen(0, cameras));
    }
    seeds
}

/// `transforms.json` as nerfstudio writes it, and with only an angle of view, as for synthetic scenes.
pub fn transforms() -> Vec<Vec<u8>> {
    let pose = |x: f64| json!([[1.0, 0.0, 0.0, x], [0.0, 1.0, 0.0, 2.5], [0.0, 0.0, 1.0, 3.0], [0.0, 0.0, 0.0, 1.0]]);
    let frames = |prefix: &str| {
        json!([
            {"file_path": format!("{prefix}a.png"), "transform_matrix": pose(1.0), "mask_path": "masks/a.png"},
            {"file_path": format!("{prefix}b.png"), "transform_matrix": pose(2.0)},
        ])
    };
    let whole = json!({
        "camera_model": "OPENCV", "fl_x": 20.5, "fl_y": 21.25, "cx": 11.125, "cy": 8.75, "w": 24, "h": 16,
        "k1": 0.01, "k2": -0.002, "k3": 0.0, "k4": 0.0, "p1": 0.001, "p2": 0.0005,
        "ply_file_path": "points.ply", "frames": frames("images/"),
    });
    let angle = json!({"camera_angle_x": 0.8, "frames": frames("./images/")});
    let fisheye = json!({
        "camera_model": "OPENCV_FISHEYE", "fl_x": 9.5, "w": 24, "h": 16, "k1": 0.02, "frames": frames("images/"),
    });
    [whole, angle, fisheye].iter().map(text).collect()
}

/// `reconstruction.json` with each kind of camera.
pub fn reconstructions() -> Vec<Vec<u8>> {
    let kinds = ["perspective", "simple_radial", "radial", "brown", "fisheye", "fisheye_opencv"];
    let one = |kind: &&str| {
        let camera = json!({
            "projection_type": kind, "width": 24, "height": 16, "focal": 0.85, "focal_x": 0.85, "focal_y": 0.875,
            "c_x": 0.001, "c_y": -0.002, "k1": -0.05, "k2": 0.01, "k3": 0.001, "k4": 0.0, "p1": 0.0001, "p2": 0.0,
        });
        let shot = |x: f64| json!({"rotation": [3.0, x, 0.25], "translation": [x, 0.5, 2.0], "camera": "v2"});
        let point = |x: f64| json!({"color": [255.0, 0.5, 20.0], "coordinates": [x, 2.0, -1.5]});
        text(&json!([{
            "cameras": {"v2": camera}, "shots": {"a.png": shot(0.0), "b.png": shot(1.0)},
            "points": {"7": point(0.0), "x": point(3.0)},
            "reference_lla": {"latitude": 46.5, "longitude": 6.5, "altitude": 400.0},
        }]))
    };
    kinds.iter().map(one).collect()
}

fn text(value: &Value) -> Vec<u8> {
    value.to_string().into_bytes()
}
