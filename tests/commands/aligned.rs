//! Datasets that COLMAP's `model_aligner` has moved: no file notes an origin, and the photographs' GPS places them.

use std::fs;
use std::path::Path;

use glam::{DMat3, DQuat};
use psrgs_vk::dataset::{Dataset, LoadOptions, Split};
use psrgs_vk::format::ply;
use psrgs_vk::geodesy::Tangent;
use psrgs_vk::scene::{Geodetic, Similarity};

use crate::colmap_folder::{CameraRow, Folder, ImageRow, PINHOLE, PointRow};
use crate::run::{copy_folder, psrgs, shared, stderr, text, works};
use crate::viewing::json;

/// Writes the reconstruction of a dataset in other coordinates, and copies the photographs.
fn write_moved(data: &Path, by: &Similarity, to: &Path) {
    let options = LoadOptions { split: Split::None, ..LoadOptions::default() };
    let dataset = Dataset::load(data, &options).expect("loads");
    let mut folder = Folder { cameras: Vec::new(), images: Vec::new(), points: Vec::new() };
    for (id, view) in (1..).zip(&dataset.views) {
        let camera = &view.camera;
        let params = vec![camera.fx, camera.fy, camera.cx, camera.cy];
        folder.cameras.push(CameraRow {
            id,
            model: PINHOLE,
            size: [camera.width.into(), camera.height.into()],
            params,
        });
        // Rows as columns are the transposed matrix: the turn back.
        let back = DMat3::from_cols_array_2d(&by.rotation);
        let turn = DMat3::from_cols_array_2d(&camera.rotation).transpose() * back;
        let q = DQuat::from_mat3(&turn);
        let translation = (turn * -glam::DVec3::from_array(by.point(camera.center()))).to_array();
        let (name, quaternion) = (view.name.clone(), [q.w, q.x, q.y, q.z]);
        folder.images.push(ImageRow { id, quaternion, translation, camera: id, name, keypoints: Vec::new() });
    }
    for (id, point) in (1..).zip(&dataset.points) {
        let (position, colour) = (by.point(point.position), [128; 3]);
        folder.points.push(PointRow { id, position, colour, error: 0.5, track: Vec::new() });
    }
    folder.write(to, &folder.binary());
    copy_folder(&data.join("images"), &to.join("images"));
    // Maps are judged by the true world.
    fs::copy(data.join("world.toml"), to.join("world.toml")).expect("copied");
}

/// Writes a model in other coordinates, less a shift where f32 is too coarse.
fn write_moved_model(model: &Path, by: &Similarity, to: &Path) {
    let read = ply::read(model).expect("a model");
    assert_eq!(read.shift, [0.0; 3]);
    let turned = Similarity { translation: [0.0; 3], ..*by }.gaussians(&read.gaussians);
    let moved = ply::Model { gaussians: turned, shift: by.translation, ..read };
    ply::write(to, &moved).expect("written");
}

#[test]
fn aligned_datasets_have_the_map_of_the_unmoved_one() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name);
    let (model, data) = (shared.model(), shared.data());
    let plane = Tangent::at(Geodetic { latitude: 47.65, longitude: 10.3, altitude: 740.0 });
    // A world is in metres east, north and up; as COLMAP leaves a reconstruction, it is in no such axes and units.
    let (s, c) = 0.5_f64.sin_cos();
    let rotation = [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]];
    let free = Similarity { rotation, scale: 0.07, translation: [4.0, -2.0, 1.0] };
    let checked = |data: &Path| {
        let output = psrgs(&["check", text(data), "--json", "--max-side", "32", "--iterations", "20"]);
        let said = stderr(&output);
        let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{said}"));
        assert_eq!((&found["map"]["epsg"], &found["map"]["known_from"]), (&32_632.into(), &"gps".into()), "{said}");
        found["fit"]["plane"][1].as_f64().unwrap_or_else(|| panic!("{}", found["fit"]))
    };
    let mapped = |model: &Path, data: &Path, name: &str| {
        works(&["map", text(model), "--cameras", text(data), "--gsd", "1", "--out", text(&path(name))]);
        json(&path(name).join("accuracy.json"))
    };
    let (residual, unmoved) = (checked(&data), mapped(&model, &data, "map"));
    for (name, by) in [("free", free), ("earth", plane.to_earth())] {
        let (moved, moved_model) = (path(&format!("{name}-data")), path(&format!("{name}.ply")));
        write_moved(&data, &by, &moved);
        write_moved_model(&model, &by, &moved_model);
        let found = checked(&moved);
        assert!((found - residual).abs() < 1e-3 * residual, "{name}: {found} m, unmoved {residual} m");
        let accuracy = mapped(&moved_model, &moved, name);
        for at in ["up", "tilt_degrees", "rmse_without"] {
            let of = |told: &serde_json::Value| told["map"]["whole"][at].as_f64().expect("a number");
            let (got, want) = (of(&accuracy), of(&unmoved));
            assert!((got - want).abs() < 0.05 * want.abs() + 0.02, "{name}: {at} is {got}, unmoved {want}");
        }
        let cells = |told: &serde_json::Value| told["map"]["vertical"]["count"].as_f64().expect("a count");
        let (got, want) = (cells(&accuracy), cells(&unmoved));
        assert!((got - want).abs() < 0.03 * want, "{name}: {got} cells, unmoved {want}");
    }
}
