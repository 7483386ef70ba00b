//! A few unusable records: reported once and left out, or refused under `--strict`.

use std::fs;
use std::path::{Path, PathBuf};

use psrgs_vk::dataset::{Dataset, LoadOptions};
use psrgs_vk::format::ply;
use psrgs_vk::world::{WorldParams, generate};

use crate::common;
use crate::run::{fails, psrgs, stderr, text, works};

/// A scene of twelve photographs, one of which is missing.
fn scene(folder: &Path) -> PathBuf {
    let data = whole_scene(folder);
    fs::remove_file(data.join("images/view_0005.jpg")).expect("removed");
    data
}

fn whole_scene(folder: &Path) -> PathBuf {
    let data = folder.join("scene");
    let params = WorldParams { images: 12, max_side: 64, pixels_per_point: 16, offpath: 0, ..WorldParams::default() };
    generate(&params, &data, &mut |_| ()).expect("a scene");
    data
}

/// A model of the scene's points with one splat that is not finite.
fn model(data: &Path, folder: &Path) -> PathBuf {
    let dataset = Dataset::load(data, &LoadOptions::default()).expect("a dataset");
    let mut splats = dataset.first_gaussians().expect("splats");
    splats.opacities[3] = f32::NAN;
    let file = folder.join("model.ply");
    ply::save(&file, &splats, &dataset.frame, false).expect("written");
    file
}

/// Checks that `said` has `line` exactly once.
#[track_caller]
fn once(said: &str, line: &str) {
    assert_eq!(said.matches(line).count(), 1, "not once `{line}`: {said}");
}

const MISSING: &str = "1 of 12 photographs cannot be used and is left out, 'view_0005.jpg': there is no such file";
const REFUSED: [&str; 2] = ["1 of 12 photographs is missing", "view_0005.jpg"];

/// Truncates the photograph behind its header.
fn cut(photograph: &Path) {
    let bytes = fs::read(photograph).expect("read");
    fs::write(photograph, &bytes[..bytes.len() * 2 / 3]).expect("written");
}

const CUT: &str = "1 of 12 photographs cannot be used and is left out, 'view_0005.jpg': pixels at byte";

#[test]
fn every_command_leaves_out_a_truncated_photograph() {
    if common::gpu().is_none() {
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let data = whole_scene(folder.path());
    let out = |name: &str| folder.path().join(name);
    let (run, depths, maps) = (out("run"), out("depths"), out("maps"));
    let model = model(&data, folder.path());
    let photograph = data.join("images/view_0005.jpg");
    let whole = fs::read(&photograph).expect("read");
    cut(&photograph);
    let train = ["train", text(&data), "--out", text(&run), "--method", "3dgs", "--iterations", "3", "--overwrite"];
    let stereo = ["stereo", text(&data), "--out", text(&depths), "--max-side", "32", "--iterations", "1"];
    let saliency = ["saliency", text(&data), "--out", text(&maps), "--gate", "gradient", "--side", "32"];
    let check = ["check", text(&data)];
    for args in [&train[..], &stereo, &saliency] {
        let said = works(args);
        once(&said, CUT);
        assert!(!said.contains("every pixel is masked"), "{said}");
    }
    assert!(maps.join("view_0004.map.png").exists() && !maps.join("view_0005.map.png").exists());
    let metrics = fs::read_to_string(run.join("metrics.json")).expect("metrics");
    let metrics: serde_json::Value = serde_json::from_str(&metrics).expect("JSON");
    assert!(metrics["train_images"] == 9 && metrics["test_images"] == 2, "{metrics}");
    let photographs = metrics["training_photographs"].as_array().expect("a list");
    let left_out: Vec<&serde_json::Value> = photographs.iter().filter(|p| p["left_out"].is_string()).collect();
    assert!(left_out.len() == 1 && left_out[0]["name"] == "view_0005.jpg", "{left_out:?}");
    assert!(left_out[0]["left_out"].as_str().is_some_and(|why| why.starts_with("cannot be decoded: pixels at byte")));
    assert!(fs::read_to_string(run.join("report.html")).expect("a report").contains("cannot be decoded: pixels"));

    let output = psrgs(&check);
    let told = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(7), "{told} {}", stderr(&output));
    once(&told, &format!("problem: {}: {CUT}", data.join("images").display()));
    assert!(told.contains("11: 9 to train on, 2 held out"), "{told}");
    for args in [&train[..], &stereo, &saliency, &check] {
        fails(&[args, &["--strict"]].concat(), 3, &["view_0005.jpg", "the file ends before the picture does"]);
    }

    // A held-out photograph, which stereo does not read.
    fs::write(&photograph, whole).expect("written");
    let held_out = data.join("images/view_0008.jpg");
    cut(&held_out);
    let eval = ["eval", text(&model), text(&data)];
    for args in [&train[..], &eval] {
        once(&works(args), &CUT.replace("0005", "0008"));
    }
    fails(&[&train[..], &["--strict"]].concat(), 3, &["view_0008.jpg", "the file ends before the picture does"]);
    let metrics = fs::read_to_string(run.join("metrics.json")).expect("metrics");
    let metrics: serde_json::Value = serde_json::from_str(&metrics).expect("JSON");
    assert!(metrics["train_images"] == 10 && metrics["test_images"] == 1, "{metrics}");

    // More than a tenth is unusable.
    cut(&photograph);
    for args in [&train[..], &saliency, &check] {
        fails(args, 3, &["view_000", "2 of 12 photographs cannot be used, which is more than one of 10"]);
    }
}

#[test]
fn every_command_skips_a_bad_record_and_strict_refuses_it() {
    if common::gpu().is_none() {
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let data = scene(folder.path());
    let out = |name: &str| folder.path().join(name);
    let (run, depths, maps, pictures) = (out("run"), out("depths"), out("maps"), out("pictures"));
    let model = model(&data, folder.path());
    let train = ["train", text(&data), "--out", text(&run), "--method", "3dgs", "--iterations", "3", "--overwrite"];
    let stereo = ["stereo", text(&data), "--out", text(&depths), "--max-side", "32", "--iterations", "1"];
    let saliency = ["saliency", text(&data), "--out", text(&maps), "--gate", "gradient", "--side", "32"];
    let eval = ["eval", text(&model), text(&data)];
    for args in [&train[..], &stereo, &saliency, &eval] {
        once(&works(args), MISSING);
    }
    for args in [&train[..], &stereo, &saliency] {
        fails(&[args, &["--strict"]].concat(), 3, &REFUSED);
    }
    let settings = fs::read_to_string(run.join("settings.toml")).expect("settings");
    assert!(settings.contains("strict = false"), "{settings}");

    let output = psrgs(&["check", text(&data)]);
    let told = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(7), "{}", stderr(&output));
    once(&told, &format!("problem: {}: {MISSING}", data.join("images").display()));
    fails(&["check", text(&data), "--strict"], 3, &REFUSED);
    let compared = out("compared");
    let compare = ["compare", text(&data), "--out", text(&compared), "--methods", "3dgs", "--iterations", "2"];
    fails(&[&compare[..], &["--seeds", "1", "--strict"]].concat(), 3, &REFUSED);

    // A splat of the model, in a command without photographs.
    let splat = "splats cannot be used and is left out, vertex 3: opacity of vertex 3";
    let render = ["render", text(&model), "--cameras", text(&data), "--out", text(&pictures), "--max-side", "32"];
    for args in [&render[..], &eval] {
        once(&works(args), splat);
        fails(&[args, &["--strict"]].concat(), 3, &["model.ply: opacity of vertex 3", "is NaN"]);
    }
    once(&works(&[&train[..], &["--init", text(&model)]].concat()), splat);

    // A pose, in a command that needs only poses.
    let file = data.join("sparse/0/images.bin");
    let mut bytes = fs::read(&file).expect("poses");
    // Number of images (8 bytes), the first image's number (4), its quaternion.
    bytes[12..20].copy_from_slice(&f64::NAN.to_le_bytes());
    fs::write(&file, bytes).expect("written");
    once(&works(&render), "1 of 12 images cannot be used and is left out, 'view_0000.jpg': qw of image");
    fails(&[&render[..], &["--strict"]].concat(), 3, &["model.ply"]);
}
