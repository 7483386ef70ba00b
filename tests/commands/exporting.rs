//! `export`: files in the formats of viewers, what they lose, and the commands that read them.

use std::fs;
use std::path::Path;

use psrgs_vk::format::{ply, splats};

use crate::run::{fails, psrgs, shared, stderr, strs, text, works};
use crate::viewing::json;

/// The mean PSNR that `eval` finds.
fn psnr(model: &Path, data: &Path) -> f64 {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scores = folder.path().join("scores.json");
    works(&["eval", text(model), text(data), "--json", text(&scores)]);
    json(&scores)["psnr"].as_f64().expect("a number")
}

#[test]
fn every_format_is_written_read_again_and_scored() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (out, file) = (folder.path().join("formats"), folder.path().join("losses.json"));
    let (model, data) = (shared.model(), shared.data());
    let args = ["export", text(&model), "--out", text(&out), "--format", "all", "--cameras", text(&data)];
    let output = psrgs(&[&args[..], &["--json", text(&file)]].concat());
    let (said, table) = (stderr(&output), String::from_utf8_lossy(&output.stdout).into_owned());
    assert!(output.status.success(), "{said}");
    let told = json(&file);
    let rows = told["files"].as_array().expect("files");
    let formats: Vec<&str> = rows.iter().map(|row| row["format"].as_str().expect("a name")).collect();
    assert_eq!(formats, ["ply", "compressed.ply", "spz 4", "sog", "splat", "glb"]);
    let splats = json(&shared.run().join("metrics.json"))["splats"].as_u64().expect("a count");
    let own = psnr(&model, &data);
    for (row, format) in rows.iter().zip(formats) {
        let written = Path::new(row["file"].as_str().expect("a name"));
        assert_eq!(row["bytes"].as_u64(), Some(fs::metadata(written).expect("a file").len()), "{format}");
        assert_eq!(row["splats"].as_u64(), Some(splats), "{format}");
        assert!(said.contains(text(written)) && table.lines().any(|line| line.starts_with(format)), "{said}{table}");
        let (lost, left) = (row["psnr_lost"].as_f64().expect("a loss"), row["psnr"].as_f64().expect("a score"));
        assert!((own - lost - left).abs() < 1e-6, "{format}: {own} less {lost} is not {left}");
        assert!(lost.abs() < if ["ply", "glb"].contains(&format) { 1e-3 } else { 6.0 }, "{format}: {lost}");
        assert!(row["seconds_write"].is_number() && row["seconds_read"].is_number() && row["ssim_lost"].is_number());
        // Other commands read the file too.
        let again = psnr(written, &data);
        assert!((again - left).abs() < 1e-6, "{format}: {again} is not {left}");
    }
}

#[test]
fn a_turned_and_centred_model_is_scored_as_it_was() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (model, data) = (shared.model(), shared.data());
    let own = psnr(&model, &data);
    for (name, up) in [("a.glb", "z"), ("a.ply", "-x"), ("b.ply", "auto")] {
        let out = folder.path().join(name);
        let args = ["export", text(&model), "--out", text(&out), "--center", "--up", up];
        works(&[&args[..], &["--cameras", text(&data)]].concat());
        let found = psnr(&out, &data);
        // Means, rotations and harmonics are rounded to f32 once more.
        assert!((found - own).abs() < 0.01, "{name}, up {up}: {found} was {own}");
        // Without the file beside it the model is somewhere else.
        fs::remove_file(folder.path().join(format!("{name}.frame.json"))).expect("the file beside");
        let elsewhere = psnr(&out, &data);
        assert!((elsewhere - own).abs() > 0.1, "{name}: {elsewhere} is as {own}");
    }
}

#[test]
fn exported_splats_are_those_asked_for_and_begin_a_training() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (model, file) = (shared.model(), folder.path().join("few.spz"));
    let all = ply::read(&model).expect("the model");
    let most = all.gaussians.len() / 2;
    let count = most.to_string();
    let args = ["export", text(&model), "--out", text(&file), "--max-splats", &count, "--sh-degree", "1"];
    works(&[&args[..], &["--spz-version", "2"]].concat());
    let few = splats::read(&file, true).expect("read");
    assert_eq!((few.gaussians.len(), few.sh_degree), (most, 1));
    assert_eq!(fs::read(&file).expect("file")[..2], [0x1f, 0x8b], "version 2 is packed by gzip");
    let run = folder.path().join("run");
    works(&strs(&shared.train_for(2, &run, &["--init", text(&file)])));
    assert!(run.join("point_cloud.ply").is_file());
    let x: Vec<f32> = all.gaussians.means.iter().copied().step_by(3).collect();
    let middle = x.iter().sum::<f32>() / x.len() as f32;
    let crop = format!("{middle},-1e9,-1e9,1e9,1e9,1e9");
    let opacity = |logit: f32| 1.0 / (1.0 + (-f64::from(logit)).exp());
    let least = all.gaussians.opacities.iter().map(|o| opacity(*o)).sum::<f64>() / x.len() as f64;
    let file = folder.path().join("half.sog");
    let least_word = least.to_string();
    works(&["export", text(&model), "--out", text(&file), "--crop", &crop, "--keep-opacity", &least_word]);
    let half = splats::read(&file, true).expect("read").gaussians;
    let kept = x.iter().zip(&all.gaussians.opacities).filter(|(x, o)| **x >= middle && opacity(**o) >= least).count();
    assert!(kept > 10 && kept < x.len());
    assert_eq!(half.len(), kept);
}

#[test]
fn exports_that_make_no_sense_say_why_and_write_nothing() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (model, out) = (shared.model(), folder.path().join("a.sog"));
    let export = |out: &Path, more: &[&str], code: i32, words: &[&str]| {
        fails(&[&["export", text(&model), "--out", text(out)], more].concat(), code, words);
        assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 0, "{more:?}");
    };
    export(&folder.path().join("a.xyz"), &[], 2, &["a.xyz", "the ending names no format", ".spz"]);
    export(&out, &["--crop", "0,0,0,0,0,0"], 2, &["none of", "--crop", "--keep-opacity"]);
    export(&out, &["--crop", "1,2"], 2, &["six numbers"]);
    export(&out, &["--keep-opacity", "2"], 2, &["from 0 to 1"]);
    export(&out, &["--up", "auto"], 2, &["--cameras"]);
    export(&out, &["--cameras", text(folder.path())], 3, &[text(folder.path())]);
    export(&folder.path().join("none/a.sog"), &[], 8, &["none/a.sog"]);
    export(&model, &[], 2, &["that is the model itself"]);
}
