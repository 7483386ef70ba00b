//! Training with a laser scan.

use std::fs;

use psrgs_vk::format::ply::Cloud;

use crate::run::{fails, shared, text, works};

const SHORT: [&str; 8] =
    ["--iterations", "25", "--densify-from", "5", "--densify-interval", "10", "--set", "stereo-side=64"];

#[test]
fn a_lidar_scan_is_used_and_stereo_replaces_a_missing_scan() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (data, out) = (shared.data(), folder.path().join("run"));
    let metrics = || fs::read_to_string(out.join("metrics.json")).expect("metrics");
    for (lidar, name) in
        [("lidar.las", "\"rsgs\""), ("lidar.ply", "\"rsgs\""), ("mvs", "\"rsgs (MVS cloud, no LiDAR)\"")]
    {
        let file = if lidar == "mvs" { "mvs".into() } else { data.join(lidar) };
        let ends =
            ["train", text(&data), "--out", text(&out), "--overwrite", "--method", "rsgs", "--lidar", text(&file)];
        let said = works(&[&ends[..], &SHORT].concat());
        assert!(said.contains("cloud from") && said.contains("depths from lidar: 7 of 7"), "{said}");
        assert!(metrics().contains(name), "{lidar}: {}", metrics());
    }
}

#[test]
fn clouds_that_cannot_be_used_say_why() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (data, out) = (shared.data(), folder.path().join("run"));
    let ends = ["train", text(&data), "--out", text(&out), "--overwrite", "--method", "rsgs"];
    let with = |file: &std::path::Path, code: i32, words: &[&str]| {
        fails(&[&ends[..], &["--lidar", text(file)], &SHORT].concat(), code, words);
    };
    fails(&[&ends[..], &SHORT].concat(), 2, &["lidar", "mvs", "LAZ"]);
    with(&folder.path().join("gone.las"), 3, &["gone.las", "open"]);

    // The same scan in the coordinates of a map: the message has the bounding boxes of both.
    let cloud = Cloud::read(&data.join("lidar.ply")).expect("a cloud");
    let positions = cloud.positions.iter().map(|[x, y, z]| [x + 5e5, y + 4.6e6, *z]).collect();
    let moved = folder.path().join("utm.ply");
    Cloud { positions, ..cloud.clone() }.write(&moved).expect("written");
    with(&moved, 3, &["utm.ply", "another frame", "x 49", "y 45", "they look at x -"]);

    let empty = folder.path().join("empty.ply");
    Cloud::default().write(&empty).expect("written");
    with(&empty, 3, &["empty.ply", "it has no points"]);
    let text_file = folder.path().join("notes.txt");
    fs::write(&text_file, "x y z\n1 2 3\n").expect("written");
    with(&text_file, 3, &["notes.txt", "signature", "PLY", "LASF"]);
    let whole = fs::read(data.join("lidar.las")).expect("a scan");
    let half = folder.path().join("half.las");
    fs::write(&half, &whole[..whole.len() / 2]).expect("written");
    with(&half, 3, &["half.las", "number of points at byte"]);
}
