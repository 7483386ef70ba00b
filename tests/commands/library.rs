//! The same training through the library.

use std::fs;

use psrgs_vk::format::ply;
use psrgs_vk::train::Settings;

use crate::run::{STEPS, shared};
use crate::{common, train_example};

#[test]
fn the_library_trains_the_model_that_the_command_trains() {
    let Some(shared) = shared() else { return };
    let Some(gpu) = common::gpu() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let model = folder.path().join("model.ply");
    let settings = Settings::read(&shared.run().join("settings.toml")).expect("settings");
    let outcome = train_example::train(&gpu, &shared.data(), &model, &settings).expect("a training");
    assert_eq!(outcome.steps, STEPS);
    assert!(fs::read(&model).ok() == fs::read(shared.model()).ok(), "the models differ");
    assert_eq!(outcome.splats, ply::read(&model).expect("a model").gaussians.len());
    let metrics = fs::read_to_string(shared.run().join("metrics.json")).expect("metrics");
    let metrics: serde_json::Value = serde_json::from_str(&metrics).expect("JSON");
    assert_eq!(outcome.psnr, metrics["psnr"].as_f64());
}
