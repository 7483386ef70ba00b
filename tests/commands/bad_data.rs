//! Data that cannot be used: each has its exit code and a message that says what is wrong and where, and nothing panics.

use std::fs;
use std::path::Path;

use psrgs_vk::world::{WorldParams, generate};

use crate::run::{copy_of, fails, psrgs, shared, stderr, text, works};

/// Trains for a moment.
fn train<'a>(data: &'a Path, out: &'a Path) -> [&'a str; 7] {
    ["train", text(data), "--out", text(out), "--iterations", "3", "-q"]
}

#[test]
fn damaged_datasets_are_told_apart() {
    let Some(shared) = shared() else { return };
    type Damage = fn(&Path);
    let cases: [(&str, Damage, &[&str]); 6] = [
        (
            "a photograph is missing",
            |data| fs::remove_file(data.join("images/view_0004.jpg")).expect("removed"),
            &["images", "1 of 9 photographs are missing", "view_0004.jpg"],
        ),
        (
            "a photograph of another shape",
            |data| image::RgbImage::new(48, 64).save(data.join("images/view_0002.jpg")).expect("written"),
            &["view_0002.jpg", "48x64", "64x48", "90 degrees"],
        ),
        (
            "a photograph that is none",
            |data| fs::write(data.join("images/view_0001.jpg"), "no picture").expect("written"),
            &["view_0001.jpg"],
        ),
        (
            "a camera with distortion",
            |data| {
                // Number of cameras (8 bytes), the first camera's id (4), its model (4): 2 is SIMPLE_RADIAL, of 4 parameters too.
                let file = data.join("sparse/0/cameras.bin");
                let mut bytes = fs::read(&file).expect("cameras");
                bytes[12] = 2;
                fs::write(&file, bytes).expect("written");
            },
            &["cameras.bin", "SIMPLE_RADIAL", "image_undistorter"],
        ),
        (
            "truncated poses",
            |data| {
                let file = data.join("sparse/0/images.bin");
                let bytes = fs::read(&file).expect("images");
                fs::write(&file, &bytes[..bytes.len() / 2]).expect("written");
            },
            &["images.bin", "at byte"],
        ),
        (
            "no model",
            |data| fs::remove_dir_all(data.join("sparse")).expect("removed"),
            &["no COLMAP model here", "sparse/0"],
        ),
    ];
    for (what, damage, words) in cases {
        let data = copy_of(&shared.data());
        damage(data.path());
        println!("{what}");
        fails(&train(data.path(), &data.path().join("run")), 3, words);
        fails(&["eval", text(&shared.model()), text(data.path())], 3, words);
    }
}

#[test]
fn a_scene_with_one_photograph_is_trained_but_not_scored() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (data, out) = (folder.path().join("one"), folder.path().join("run"));
    generate(&WorldParams { images: 1, max_side: 64, ..WorldParams::default() }, &data, &mut |_| ()).expect("a scene");
    // One photograph makes no points.
    fails(&train(&data, &out), 3, &["no points", "--init"]);

    let start = shared.model();
    let said = works(&[&train(&data, &out)[..], &["--init", text(&start), "--overwrite"]].concat());
    assert!(said.contains("too few to hold any out"), "{said}");
    let metrics = fs::read_to_string(out.join("metrics.json")).expect("metrics");
    let metrics: serde_json::Value = serde_json::from_str(&metrics).expect("JSON");
    assert!(metrics["psnr"].is_null() && metrics["test_images"] == 0 && metrics["train_images"] == 1);
    assert!(out.join("point_cloud.ply").exists() && out.join("report.html").exists());

    fails(&["eval", text(&start), text(&data)], 3, &["none is held out"]);
    let pictures = folder.path().join("pictures");
    let args = ["render", text(&start), "--cameras", text(&data), "--out", text(&pictures), "-q"];
    works(&args);
    fails(&[&args[..], &["--views", "test"]].concat(), 3, &["--views"]);
}

#[test]
fn models_that_are_none_name_the_place() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let whole = fs::read(shared.model()).expect("a model");
    let cut = folder.path().join("cut.ply");
    fs::write(&cut, &whole[..whole.len() - 10]).expect("written");
    let points = folder.path().join("points.ply");
    let header =
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    fs::write(&points, format!("{header}0 0 0\n")).expect("written");
    let other = folder.path().join("other.ply");
    fs::write(&other, "\0\u{1}no model").expect("written");
    let data = shared.data();
    for (file, words) in [
        (&cut, &["cut.ply", "at byte"][..]),
        (&points, &["points.ply", "not a 3D Gaussian model"]),
        (&other, &["other.ply"]),
        (&folder.path().join("none.ply"), &["none.ply", "cannot open"]),
    ] {
        fails(&["eval", text(file), text(&data)], 3, words);
        fails(&["render", text(file), "--cameras", text(&data)], 3, words);
    }
    let taken = folder.path().join("taken");
    fs::write(&taken, "").expect("written");
    let model = shared.model();
    let args = ["render", text(&model), "--cameras", text(&data), "--out"];
    fails(&[&args[..], &[text(&taken.join("x"))]].concat(), 8, &["cannot write"]);
}

#[test]
fn too_little_device_memory_has_its_code() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (data, out) = (shared.data(), folder.path().join("run"));
    let args = [&train(&data, &out)[..], &["--max-device-memory", "100K"]].concat();
    let output = psrgs(&args);
    assert_eq!(output.status.code(), Some(5), "{}", stderr(&output));
    assert!(stderr(&output).contains("out of device memory") && stderr(&output).contains("--max-side"));
}
