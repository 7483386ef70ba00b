//! A few records that cannot be used: told once, left out, and refused where that is asked for.

use std::fs;
use std::path::{Path, PathBuf};

use psrgs_vk::dataset::{Dataset, LoadOptions};
use psrgs_vk::format::ply;
use psrgs_vk::world::{WorldParams, generate};

use crate::common;
use crate::run::{fails, psrgs, stderr, text, works};

/// A scene of twelve photographs, of which one is not there.
fn scene(folder: &Path) -> PathBuf {
    let data = folder.join("scene");
    let params = WorldParams { images: 12, max_side: 64, pixels_per_point: 16, offpath: 0, ..WorldParams::default() };
    generate(&params, &data, &mut |_| ()).expect("a scene");
    fs::remove_file(data.join("images/view_0005.jpg")).expect("removed");
    data
}

/// A model of the scene's points, one of whose splats is not finite.
fn model(data: &Path, folder: &Path) -> PathBuf {
    let dataset = Dataset::load(data, &LoadOptions::default()).expect("a dataset");
    let mut splats = dataset.first_gaussians().expect("splats");
    splats.opacities[3] = f32::NAN;
    let file = folder.join("model.ply");
    ply::save(&file, &splats, &dataset.frame, false).expect("written");
    file
}

/// Says the line once.
#[track_caller]
fn once(said: &str, line: &str) {
    assert_eq!(said.matches(line).count(), 1, "not once `{line}`: {said}");
}

const MISSING: &str = "1 of 12 photographs cannot be used and is left out, 'view_0005.jpg': there is no such file";
const REFUSED: [&str; 2] = ["1 of 12 photographs is missing", "view_0005.jpg"];

#[test]
fn every_command_leaves_out_a_record_of_many_and_refuses_it_strictly() {
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

    // A splat: of the model, where photographs are not needed.
    let splat = "splats cannot be used and is left out, vertex 3: opacity of vertex 3";
    let render = ["render", text(&model), "--cameras", text(&data), "--out", text(&pictures), "--max-side", "32"];
    for args in [&render[..], &eval] {
        once(&works(args), splat);
        fails(&[args, &["--strict"]].concat(), 3, &["model.ply: opacity of vertex 3", "is NaN"]);
    }
    once(&works(&[&train[..], &["--init", text(&model)]].concat()), splat);

    // A pose: told by who needs poses alone.
    let file = data.join("sparse/0/images.bin");
    let mut bytes = fs::read(&file).expect("poses");
    // Number of images (8 bytes), the first image's number (4), its quaternion.
    bytes[12..20].copy_from_slice(&f64::NAN.to_le_bytes());
    fs::write(&file, bytes).expect("written");
    once(&works(&render), "1 of 12 images cannot be used and is left out, 'view_0000.jpg': qw of image");
    fails(&[&render[..], &["--strict"]].concat(), 3, &["model.ply"]);
}
