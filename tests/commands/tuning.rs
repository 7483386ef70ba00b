//! `train --tune`: the chosen forms are printed, kept with the run, and used again on resume.

use std::fs;

use crate::run::{command, fails, shared, stderr, text};

#[test]
fn forms_chosen_by_timing_are_told_and_kept_with_the_run() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (out, data) = (folder.path().join("run"), shared.data());
    let train = |args: &[&str]| {
        let output =
            command(args).env("PSRGS_CACHE", folder.path().join("cache")).output().expect("the command starts");
        assert!(output.status.success(), "{}", stderr(&output));
        stderr(&output)
    };
    let said = train(&[
        "train",
        text(&data),
        "--out",
        text(&out),
        "--iterations",
        "4",
        "--checkpoint-every",
        "2",
        "--tune",
        "again",
        "--scale-schedule=false",
    ]);
    assert!(said.contains("variants of the passes: ") && said.contains("timed: "), "{said}");
    assert!(said.contains("device memory: ") && said.contains("B per splat"), "{said}");
    assert!(folder.path().join("cache/forms.json").exists());
    let read = |name: &str| fs::read_to_string(out.join(name)).expect("a file");
    let settings: toml::Table = read("settings.toml").parse().expect("settings");
    let tile = settings["blending"]["tile-shape"].as_str().expect("the shape").to_owned();
    assert!(settings["stepping"].get("gradient-sum").is_some() && settings["run"]["tune"].as_str() == Some("again"));
    assert!(read("report.html").contains("gradient-sum"), "the report has the settings that were trained with");
    let metrics: serde_json::Value = serde_json::from_str(&read("metrics.json")).expect("JSON");
    assert!(metrics["forms"].as_str().is_some_and(|f| f.starts_with(&tile)), "{metrics}");
    // A resumed run keeps its forms and times nothing.
    let said = train(&["train", "--resume", text(&out), "--iterations", "6", "--tune", "again"]);
    assert!(!said.contains("timed: ") && said.contains("going on after step"), "{said}");
    fails(&["train", text(&data), "--tune", "perhaps"], 2, &["auto, off or again"]);
}
