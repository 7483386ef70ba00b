//! `lod`: levels of detail of a model file.

use std::fs;
use std::path::{Path, PathBuf};

use psrgs_vk::format::FrameFile;
use psrgs_vk::format::ply::{self, Model};
use psrgs_vk::format::splats;
use psrgs_vk::geodesy::Georeference;
use psrgs_vk::scene::{Coordinates, Frame, Gaussians, Geodetic};

use crate::run::{content, fails, text, works};
use crate::viewing::json;

/// A model of splats along a line.
fn model(folder: &Path, splats: usize) -> PathBuf {
    let mut gaussians = Gaussians::zeros(splats);
    gaussians.means.iter_mut().step_by(3).enumerate().for_each(|(i, x)| *x = i as f32);
    gaussians.quats.iter_mut().step_by(4).for_each(|w| *w = 1.0);
    let file = folder.join("point_cloud.ply");
    let model = Model { gaussians, sh_degree: 3, version: Some("0.1.0".to_owned()), ..Model::default() };
    ply::write(&file, &model).expect("written");
    file
}

#[test]
fn lod_writes_the_same_files_each_time() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = model(folder.path(), 700);
    for format in ["tiles", "tiles-spz", "sog"] {
        let (first, second) = (folder.path().join(format), folder.path().join(format!("{format}2")));
        let args = |out: &Path| {
            ["lod", text(&file), "--format", format, "--tile-splats", "100", "--out", text(out)].map(str::to_owned)
        };
        let said = works(&args(&first).each_ref().map(String::as_str));
        works(&args(&second).each_ref().map(String::as_str));
        assert!(said.contains("700 splats") && said.contains("level 2: "), "{said}");
        let inside = |of: &Path| -> Vec<Vec<u8>> { content(of).into_values().collect() };
        assert!(inside(&first).len() > 8 && inside(&first) == inside(&second), "{format}");
    }
}

#[test]
fn lod_lies_on_the_globe_where_the_frame_says() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (file, out) = (model(folder.path(), 10), folder.path().join("tiles"));
    let root = || json(&out.join("tileset.json"))["root"]["transform"].clone();
    let said = works(&["lod", text(&file), "--out", text(&out)]);
    assert!(said.contains("place: none is known") && root()[15] == 1.0 && root()[12] == 0.0, "{said}");
    let origin = Geodetic { latitude: 0.0, longitude: 90.0, altitude: 0.0 };
    let coordinates = Coordinates::EastNorthUp { origin };
    let map = Georeference::of_coordinates(&coordinates, None).expect("a map").record([0.0; 3]);
    let frame = FrameFile::new(Frame::IDENTITY, Some(coordinates)).with_map(map);
    frame.write(&folder.path().join("frame.json")).expect("written");
    let said = works(&["lod", text(&file), "--out", text(&out)]);
    // The second axis of the Earth goes through longitude 90 degrees.
    let at = root()[13].as_f64().expect("a number");
    assert!(said.contains("on the globe") && (at - 6_378_137.0).abs() < 1e-3, "{said}: {}", root());
}

#[test]
fn lod_writes_harmonics_up_to_the_degree_asked_for() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (file, out) = (model(folder.path(), 10), folder.path().join("tiles"));
    for (asked, degree) in [(&[][..], 3), (&["--sh-degree", "1"], 1)] {
        works(&[&["lod", text(&file), "--out", text(&out)], asked].concat());
        assert_eq!(splats::read(&out.join("tile.glb"), true).expect("a tile").sh_degree, degree);
    }
}

#[test]
fn lod_refuses_what_it_cannot_use() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let empty = model(folder.path(), 0);
    let out = folder.path().join("tiles");
    fails(&["lod", text(&empty), "--out", text(&out)], 3, &["point_cloud.ply", "has no splats"]);
    assert!(!out.exists());
    let file = model(folder.path(), 10);
    fails(&["lod", text(&file), "--out", text(&file)], 8, &["cannot write", "point_cloud.ply"]);
    fails(&["lod", text(&file), "--out", text(&out), "--tile-splats", "60000"], 2, &["--tile-splats", "50000"]);
    fs::write(folder.path().join("frame.json"), "{").expect("written");
    fails(&["lod", text(&file), "--out", text(&out)], 3, &["frame.json"]);
}

#[test]
fn lod_replaces_its_own_files_and_no_others() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = model(folder.path(), 700);
    let others: [(&str, &str, &str); 4] = [
        ("tiles", "tile2024.glb", "photogrammetry"),
        ("tiles", "tileset.json", "{\"asset\": {\"generator\": \"another program\"}}"),
        ("tiles-spz", "tileset.json", "{}"),
        ("sog", "lod-meta.json", "{\"version\": 1}"),
    ];
    for (k, (format, name, other)) in others.into_iter().enumerate() {
        let out = folder.path().join(k.to_string());
        fs::create_dir(&out).expect("a folder");
        fs::write(out.join(name), other).expect("written");
        fails(&["lod", text(&file), "--format", format, "--out", text(&out)], 8, &[name, "another program's"]);
        assert_eq!(fs::read_to_string(out.join(name)).expect("it is still there"), other);
        assert_eq!(content(&out).len(), 1, "{format}: nothing was written");
    }
    // A tile of a set is no model for that set.
    let out = folder.path().join("own");
    works(&["lod", text(&file), "--tile-splats", "100", "--out", text(&out)]);
    let before = content(&out);
    fails(&["lod", text(&out.join("tile.glb")), "--out", text(&out)], 2, &["tile.glb", "another folder"]);
    assert_eq!(content(&out), before);
    // Fewer tiles replace more, also of a model that lies beside them.
    let beside = out.join("model.glb");
    fs::copy(out.join("tile.glb"), &beside).expect("copied");
    works(&["lod", text(&beside), "--out", text(&out)]);
    assert!(content(&out).len() == 3 && beside.is_file());
    let out = folder.path().join("streamed");
    works(&["lod", text(&file), "--format", "sog", "--out", text(&out)]);
    let cell = out.join("0_0/meta.json");
    fails(&["lod", text(&cell), "--format", "sog", "--out", text(&out)], 2, &["meta.json", "another folder"]);
}
