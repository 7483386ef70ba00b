//! `psrgs-vk saliency`.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use psrgs_vk::format::image_out::{read_depth, write_png};
use psrgs_vk::world::{WorldParams, generate};

fn run(args: &[&str]) -> Output {
    let output = Command::new(env!("CARGO_BIN_EXE_psrgs-vk")).arg("saliency").args(args).output().expect("it starts");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!said.contains("panicked"), "{args:?}: {said}");
    output
}

fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(folder)
        .expect("a folder")
        .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn a_photograph_gets_its_map_and_mask() {
    let folder = tempfile::tempdir().expect("a folder");
    let (picture, out) = (folder.path().join("a.b.png"), folder.path().join("out"));
    let rgb: Vec<u8> = (0..90 * 60 * 3).map(|i| if i % 270 < 100 { 90 } else { (i * i % 251) as u8 }).collect();
    write_png(&picture, 90, 60, &rgb).expect("a picture");
    let done = run(&[text(&picture), "--out", text(&out), "--side", "30", "--share", "0.2", "--split"]);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let want = ["a.b.high.png", "a.b.low.png", "a.b.map.exr", "a.b.map.png", "a.b.mask.exr", "a.b.mask.png"];
    assert_eq!(names(&out), want);
    let mean = |name: &str| {
        let plane = read_depth(&out.join(name)).expect("an EXR");
        assert_eq!((plane.width, plane.height), (45, 30));
        plane.values.iter().map(|v| f64::from(*v)).sum::<f64>() / plane.values.len() as f64
    };
    assert!((mean("a.b.map.exr") - 1.0).abs() < 1e-5);
    assert!((mean("a.b.mask.exr") - 0.2).abs() < 1e-5);
    let mask = image::open(out.join("a.b.mask.png")).expect("a PNG").to_luma8();
    let exr = read_depth(&out.join("a.b.mask.exr")).expect("an EXR").values;
    assert!(mask.pixels().zip(&exr).all(|(p, v)| (f32::from(p.0[0]) / 255.0 - v).abs() <= 0.51 / 255.0));
    let high = image::open(out.join("a.b.high.png")).expect("a PNG");
    assert_eq!((high.width(), high.height()), (90, 60));
}

#[test]
fn every_photograph_of_a_dataset_gets_its_own() {
    let folder = tempfile::tempdir().expect("a folder");
    let (data, out) = (folder.path().join("scene"), folder.path().join("out"));
    let params = WorldParams { images: 2, max_side: 48, pixels_per_point: 16, offpath: 0, ..WorldParams::default() };
    generate(&params, &data, &mut |_| ()).expect("a scene");
    for gate in ["spectral", "gradient"] {
        let done = run(&[text(&data), "--out", text(&out), "--gate", gate, "--sigma", "6", "-q"]);
        assert!(done.status.success() && done.stderr.is_empty(), "{}", String::from_utf8_lossy(&done.stderr));
        assert_eq!(names(&out).len(), 8);
    }
}

#[test]
fn what_cannot_be_used_has_its_code() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let none = folder.path().join("none.png");
    let bad = folder.path().join("bad.png");
    fs::write(&bad, "no picture").expect("a file");
    let picture = folder.path().join("good.png");
    write_png(&picture, 8, 8, &[7; 192]).expect("a picture");
    for (args, code, word) in [
        (vec![text(&none)], 3, "none.png"),
        (vec![text(&bad)], 3, "bad.png"),
        (vec![text(folder.path())], 3, ""),
        (vec![text(&picture), "--sigma=-1"], 2, "sigma"),
        (vec![text(&picture), "--sigma", "NaN"], 2, "sigma"),
        (vec![text(&picture), "--share", "1.5"], 2, "share"),
        (vec![text(&picture), "--side", "0"], 2, "side"),
        (vec![text(&picture), "--gate", "sharp"], 2, "sharp"),
        (vec![text(&picture), "--out", text(&bad)], 8, "bad.png"),
    ] {
        let args: Vec<&str> = if args.contains(&"--out") { args } else { [args, vec!["--out", text(&out)]].concat() };
        let done = run(&args);
        let said = String::from_utf8_lossy(&done.stderr);
        assert_eq!(done.status.code(), Some(code), "{args:?}: {said}");
        assert!(said.contains(word), "{args:?}: {said}");
    }
}
