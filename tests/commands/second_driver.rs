//! The commands on a second Vulkan implementation, whose device has fewer features.

use std::fs;

use crate::common::swiftshader::{on_swiftshader, swiftshader};
use crate::run::{command, shared, text, works};

/// PSNR of the held-out photographs in a run's folder.
fn psnr(out: &std::path::Path) -> f64 {
    let metrics = fs::read(out.join("metrics.json")).expect("metrics");
    let metrics: serde_json::Value = serde_json::from_slice(&metrics).expect("JSON");
    metrics["psnr"].as_f64().expect("a number")
}

#[test]
fn a_training_on_swiftshader_scores_as_on_the_other_driver() {
    let (Some(shared), Some(driver)) = (shared(), swiftshader()) else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let cache = folder.path().join("cache");
    let runs = |args: &[&str]| {
        let mut command = command(args);
        command.env("XDG_CACHE_HOME", &cache);
        let (good, said) = on_swiftshader(&driver, &command);
        assert!(good && !said.contains("panicked"), "{args:?}: {said}");
        said
    };
    let data = shared.data();
    for (method, steps) in [("3dgs", "15"), ("psrgs", "4")] {
        let [here, there] = ["here", "there"].map(|name| folder.path().join(format!("{method}-{name}")));
        let args = ["train", text(&data), "--method", method, "--iterations", steps, "--deterministic", "--out"];
        let said = runs(&[&args[..], &[text(&there)]].concat());
        assert!(said.contains("SwiftShader"), "{said}");
        works(&[&args[..], &[text(&here)]].concat());
        let (here, there) = (psnr(&here), psnr(&there));
        assert!((here - there).abs() < 0.1, "{method}: {there} dB on SwiftShader, {here} dB elsewhere");
    }
    let model = folder.path().join("3dgs-there/point_cloud.ply");
    runs(&["render", text(&model), "--cameras", text(&data), "--out", text(&folder.path().join("renders"))]);
}
