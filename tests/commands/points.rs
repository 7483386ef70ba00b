//! `points`: point clouds of splats and of stereo, on a map where one is known.

use std::fs;
use std::path::Path;

use psrgs_vk::format::{las, ply};

use crate::run::{copy_of, fails, psrgs, shared, stderr, text, works};

/// East-north-up about a place, as OpenSfM and OpenDroneMap write it beside a reconstruction.
fn placed(model: &Path, folder: &Path) -> std::path::PathBuf {
    let to = folder.join("point_cloud.ply");
    fs::copy(model, &to).expect("copied");
    let origin = r#"{"kind":"east-north-up","origin":{"latitude":45.0,"longitude":11.0,"altitude":200.0}}"#;
    let map = r#"{"system":"WGS 84 / UTM zone 32N","epsg":32632,"proj":"+proj=utm +zone=32 +datum=WGS84 +units=m +no_defs",
        "heights":"ellipsoid","known_from":"dataset","origin":{"latitude":45.0,"longitude":11.0,"altitude":200.0},
        "at":[0,0,0],"dataset_to_map":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]],"fitted":{"origin":{"latitude":45.0,
        "longitude":11.0,"altitude":200.0},"similarity":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}}"#;
    let frame = format!(r#"{{"offset":[0,0,0],"scale":1.0,"shift":[0,0,0],"coordinates":{origin},"map":{map}}}"#);
    fs::write(folder.join("frame.json"), frame).expect("written");
    to
}

#[test]
fn splats_become_points_of_a_las_file() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (model, data) = (folder.path().join("model.ply"), shared.data());
    // Nothing beside the model names a place.
    fs::copy(shared.model(), &model).expect("copied");
    let splats = ply::read(&model).expect("a model");
    let opaque = |least: f32| splats.gaussians.opacities.iter().filter(|o| 1.0 / (1.0 + (-**o).exp()) >= least).count();
    let (las_file, laz_file) = (folder.path().join("a.las"), folder.path().join("a.laz"));
    // After few steps no splat is opaque.
    works(&["points", text(&model), "--keep-opacity", "0", "--out", text(&las_file)]);
    works(&["points", text(&model), "--keep-opacity", "0.1", "--out", text(&laz_file)]);
    let (all, few) = (las::read(&las_file).expect("a file"), las::read(&laz_file).expect("a file"));
    assert_eq!((all.len(), few.len()), (splats.gaussians.len(), opaque(0.1)));
    assert!(!few.is_empty() && few.len() < all.len());
    // Without a map the coordinates are those of the dataset, to about a millionth of its extent.
    let means: Vec<&[f32]> = splats.gaussians.means.chunks_exact(3).collect();
    for point in all.iter().step_by(50) {
        let off = |m: &&[f32]| (0..3).map(|k| (f64::from(m[k]) + splats.shift[k] - point[k]).abs()).fold(0.0, f64::max);
        let nearest = means.iter().map(off).fold(f64::MAX, f64::min);
        assert!(nearest < 1e-3, "{point:?} is {nearest} from every splat");
    }
    // The photographs of the dataset note where they were taken: 47.65 N, 10.3 E is at 597627 E, 5278219 N.
    let on_map = folder.path().join("map.laz");
    works(&["points", text(&model), "--keep-opacity", "0", "--cameras", text(&data), "--out", text(&on_map)]);
    let found = las::read(&on_map).expect("a file");
    assert_eq!(found.len(), all.len());
    let near = |p: &[f64; 3]| (p[0] - 597_627.0).abs() < 200.0 && (p[1] - 5_278_219.0).abs() < 200.0;
    assert!(found.iter().filter(|p| near(p)).count() > found.len() * 9 / 10, "{:?}", found.first());
}

#[test]
fn points_lie_on_the_map_that_frame_json_names() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (model, out) = (placed(&shared.model(), folder.path()), folder.path().join("a.laz"));
    let output = psrgs(&["points", text(&model), "--keep-opacity", "0", "--out", text(&out)]);
    let said = stderr(&output);
    assert!(output.status.success() && said.contains("UTM zone 32N") && said.contains("frame.json"), "{said}");
    let points = las::read(&out).expect("a file");
    // 45 N 11 E is at 657630.64 E, 4984896.17 N (pyproj); the scene has a few dozen metres.
    let near = |p: &[f64; 3]| (p[0] - 657_630.6).abs() < 200.0 && (p[1] - 4_984_896.2).abs() < 200.0;
    assert!(points.iter().filter(|p| near(p)).count() > points.len() * 9 / 10, "{:?}", points.first());
    // A reader learns what heights are measured from where that is not the ellipsoid.
    let named = folder.path().join("heights.las");
    let wkt = |file: &Path| String::from_utf8_lossy(&fs::read(file).expect("a file")).into_owned();
    let args = ["points", text(&model), "--keep-opacity", "0", "--heights", "EPSG:5773", "--out", text(&named)];
    works(&args);
    let told = wkt(&named);
    assert!(told.contains("COMPD_CS[") && told.contains("VERT_CS[\"EPSG:5773\"") && !wkt(&out).contains("COMPD_CS"));
    // An export is turned, and the file beside it leads back to the dataset and on to the map.
    let turned = folder.path().join("turned.glb");
    works(&["export", text(&model), "--out", text(&turned), "--center", "--up", "z"]);
    fs::remove_file(folder.path().join("frame.json")).expect("removed");
    let again = folder.path().join("b.laz");
    let said = works(&["points", text(&turned), "--keep-opacity", "0", "--out", text(&again)]);
    assert!(said.contains("UTM zone 32N") && said.contains("turned.glb.frame.json"), "{said}");
    let middle =
        |points: &[[f64; 3]]| [0, 1, 2].map(|k| points.iter().map(|p| p[k]).sum::<f64>() / points.len() as f64);
    let (got, want) = (middle(&las::read(&again).expect("a file")), middle(&points));
    assert!((0..3).all(|k| (got[k] - want[k]).abs() < 0.01), "{got:?} {want:?}");
    let needs = ["--crs", "--cameras"];
    fails(&["points", text(&model), "--crs", "EPSG:25832", "--out", text(&out)], 2, &needs);
}

#[test]
fn stereo_becomes_points_with_an_error() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("stereo.las");
    works(&["points", "--stereo", text(&shared.data()), "--max-side", "64", "--out", text(&out), "-q"]);
    assert!(las::read(&out).expect("a file").len() > 100);
    // The error is the last of the extra values. Photographs of 64 pixels are taken from some 60 m.
    let mut reader = ::las::Reader::from_path(&out).expect("a LAS file");
    let error = |point: ::las::Point| {
        let bytes = point.extra_bytes.last_chunk::<4>().copied().expect("extra values");
        f32::from_le_bytes(bytes)
    };
    let mut errors: Vec<f32> = reader.points().map(|point| error(point.expect("a point"))).collect();
    errors.sort_by(f32::total_cmp);
    let middle = errors[errors.len() / 2];
    assert!(errors[0] > 0.0 && (0.02..10.0).contains(&middle), "{} to {middle}", errors[0]);
}

#[test]
fn points_that_cannot_be_written_lose_nothing() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (model, out) = (shared.model(), folder.path().join("a.las"));
    fs::write(&out, "what was there").expect("written");
    let model = text(&model).to_owned();
    let base = ["points", model.as_str(), "--out"];
    fails(&[&base[..], &[text(&out), "--keep-opacity", "1"]].concat(), 3, &["--keep-opacity", "none of"]);
    assert_eq!(fs::read_to_string(&out).expect("a file"), "what was there");
    fails(&[&base[..], &["a.ply"]].concat(), 2, &[".las or .laz"]);
    let nowhere = folder.path().join("none/a.las");
    fails(&[&base[..], &[text(&nowhere)]].concat(), 8, &["none"]);
    fails(&["points", "--out", text(&out)], 2, &["<MODEL>"]);
    // A file of the dataset keeps its place.
    let data = copy_of(&shared.data());
    let cloud = data.path().join("images/cloud.las");
    fs::write(&cloud, "a scan").expect("written");
    fails(&[&base[..], &[text(&cloud), "--cameras", text(data.path())]].concat(), 2, &["another folder"]);
    assert_eq!(fs::read_to_string(&cloud).expect("a file"), "a scan");
}
