//! `train`: files, repetition, interruption.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use psrgs_vk::format::ply;
use psrgs_vk::train::Settings;

#[cfg(unix)]
use crate::run::Running;
use crate::run::{OPTIONS, STEPS, Shared, fails, psrgs, shared, stderr, text, works};
use crate::{common, train_example};

const KEYS: &str = "method iterations scene train_images test_images width height seed device forms psnr psnr_seen seen psnr_cc ssim \
                    gmsd psnr_high_frequency psnr_training ssim_training splats first_splats bytes seconds seconds_stereo seconds_saliency \
                    seconds_per_iteration peak_device_bytes peak_host_bytes images training_photographs psnr_offpath \
                    depth_median_error depth_within_0_5_percent depth_within_2_percent depth_coverage \
                    depth_median_error_offpath depth_of_median_error depth_of_median_error_offpath depth_points_error depth_points_error_expected floaters_front \
                    floaters_behind floaters_front_offpath floaters_behind_offpath normal_median_degrees floaters";

#[test]
fn a_training_leaves_every_file_that_is_promised() {
    let Some(shared) = shared() else { return };
    let run = shared.run();
    for file in "point_cloud.ply frame.json metrics.json settings.toml report.html renders/view_0000.render.png \
                 renders/view_0000.photograph.png renders/view_0000.depth.exr renders/view_0008.normal.exr"
        .split_whitespace()
    {
        assert!(fs::metadata(run.join(file)).is_ok_and(|m| m.len() > 0), "no {file}");
    }
    let metrics = fs::read_to_string(run.join("metrics.json")).expect("metrics");
    let metrics: serde_json::Value = serde_json::from_str(&metrics).expect("JSON");
    let keys: BTreeSet<&str> = metrics.as_object().expect("an object").keys().map(String::as_str).collect();
    assert_eq!(keys, KEYS.split_whitespace().collect());
    assert_eq!(metrics["iterations"], STEPS);
    assert_eq!((&metrics["train_images"], &metrics["test_images"]), (&7.into(), &2.into()));
    assert_eq!((&metrics["width"], &metrics["height"]), (&64.into(), &48.into()));
    assert_eq!(metrics["bytes"], fs::metadata(shared.model()).expect("a model").len());
    assert!(metrics["seconds"].as_f64() > Some(0.0) && metrics["seconds_per_iteration"].as_f64() > Some(0.0));
    let images = metrics["images"].as_array().expect("images");
    assert_eq!(images.len(), 2);
    let mean = images.iter().map(|i| i["psnr"].as_f64().expect("a number")).sum::<f64>() / 2.0;
    assert!((mean - metrics["psnr"].as_f64().expect("a number")).abs() < 1e-9);
    let of_images = |key: &str| images.iter().map(|i| i[key].as_f64().expect("a number")).sum::<f64>() / 2.0;
    for key in ["psnr_seen", "seen"] {
        assert!((of_images(key) - metrics[key].as_f64().expect("a number")).abs() < 1e-9, "{key}");
    }
    assert!(metrics["seen"].as_f64().is_some_and(|share| share > 0.2 && share < 1.0), "{}", metrics["seen"]);
    assert!(images.iter().all(|i| i["psnr_cc"].as_f64() >= i["psnr"].as_f64()), "a colour fit never costs");
    assert!(!run.join("exposures.json").exists(), "exposures are off unless asked for");
}

/// Compares the model in `out` with the shared one.
#[track_caller]
pub fn same_model(shared: &Shared, out: &Path, what: &str) {
    let read = |file: &Path| fs::read(file).expect("a model");
    assert!(read(&shared.model()) == read(&out.join("point_cloud.ply")), "{what}: the models differ");
}

#[test]
fn settings_repeat_a_run_bit_for_bit() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("again");
    works(&["train", "--config", text(&shared.run().join("settings.toml")), "--out", text(&out), "-q"]);
    same_model(shared, &out, "repeated from settings.toml");
    // The comparison can fail: another seed and exposures give another model.
    let other = folder.path().join("other");
    works(&[
        "train",
        "--config",
        text(&shared.run().join("settings.toml")),
        "--out",
        text(&other),
        "-q",
        "--seed",
        "4",
        "--exposure",
        "affine",
    ]);
    assert!(fs::read(shared.model()).ok() != fs::read(other.join("point_cloud.ply")).ok());
    let exposures = fs::read_to_string(other.join("exposures.json")).expect("exposures");
    let exposures: BTreeMap<String, [[f64; 4]; 3]> = serde_json::from_str(&exposures).expect("a matrix each");
    assert_eq!(exposures.len(), 7, "not one exposure for each training photograph");

    // A later scoring finds the exposures beside the model, or ignores them.
    let (model, data, file) = (other.join("point_cloud.ply"), shared.data(), folder.path().join("scores.json"));
    let json = |file: &Path| -> serde_json::Value {
        serde_json::from_str(&fs::read_to_string(file).expect("scores")).expect("JSON")
    };
    let scores = |options: &[&str]| {
        works(&[&["eval", text(&model), text(&data), "--json", text(&file), "-q"], options].concat());
        json(&file)
    };
    let same = |a: &serde_json::Value, b: &serde_json::Value| {
        let [a, b] = [a, b].map(|v| v.as_f64().expect("a number"));
        assert!((a - b).abs() < 0.01, "{a} and {b}");
    };
    let metrics = json(&other.join("metrics.json"));
    let (found, own) = (scores(&[]), scores(&["--own-colours"]));
    same(&found["psnr"], &metrics["psnr"]);
    for key in ["follows_order", "follows_place"] {
        same(&found["exposures"][key], &metrics["exposures"][key]);
    }
    same(&own["psnr"], &metrics["exposures"]["psnr_own_colours"]);
    assert!(own.get("exposures").is_none());
    let moved = folder.path().join("moved.json");
    fs::rename(other.join("exposures.json"), &moved).expect("moved");
    same(&scores(&[])["psnr"], &own["psnr"]);
    same(&scores(&["--exposures", text(&moved)])["psnr"], &found["psnr"]);
    // Exposures of other photographs, a broken file, and a missing file.
    let eval = |file: &Path, words: &[&str]| {
        fails(&["eval", text(&model), text(&data), "--exposures", text(file)], 3, words);
    };
    let identity = "[[1,0,0,0],[0,1,0,0],[0,0,1,0]]";
    fs::write(&moved, format!("{{\"other.jpg\": {identity}}}")).expect("written");
    eval(&moved, &["moved.json", "none of its photographs", "the model's training"]);
    fs::copy(&moved, other.join("exposures.json")).expect("copied");
    same(&scores(&[])["psnr"], &own["psnr"]);
    fs::write(&moved, "{\"a.jpg\": [[1,0],[0,1]]}").expect("written");
    eval(&moved, &["moved.json", "exposures"]);
    eval(&folder.path().join("none.json"), &["none.json"]);
}

/// Steps by need are told, written down and scaled to; a run that goes on, or is repeated from its settings, has them.
#[test]
fn steps_by_need_are_told_and_kept() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = |name: &str| folder.path().join(name);
    let config = out("asked.toml");
    fs::write(&config, "[run]\nlooks = 200\niterations = 40\ndeterministic = true\ncheckpoint-every = 20\n")
        .expect("written");
    let (data, begun) = (shared.data(), out("begun"));
    let begin = |to: &Path, more: &[&str]| {
        let asked = ["train", text(&data), "--config", text(&config), "--method", "lean", "--out", text(to)];
        psrgs(&[&asked[..], more].concat())
    };
    let whole = begin(&out("whole"), &[]);
    let line = "40 steps, as many as the settings allow; --iterations 2000 would be 7 photographs, 286 looks each";
    assert!(stderr(&whole).contains(line), "{}", stderr(&whole));
    let chosen = |run: &Path| Settings::read(&run.join("settings.toml")).expect("settings").run;
    let run = chosen(&out("whole"));
    assert_eq!((run.iterations, run.looks, run.scale_schedule), (40, None, true));
    let report = fs::read_to_string(out("whole").join("report.html")).expect("a report");
    assert!(report.contains("40 steps: 7 photographs, 5.7 looks each"), "no line in the report");
    // Interrupted and gone on.
    let stopped = begin(&begun, &["--lose-device-at", "25"]);
    assert!(!stopped.status.success());
    assert_eq!(chosen(&begun), run);
    let said = works(&["train", "--resume", text(&begun)]);
    assert!(said.contains("40 steps") && !said.contains("looks each"), "chosen again: {said}");
    let read = |run: &Path| fs::read(run.join("point_cloud.ply")).expect("a model");
    assert!(read(&begun) == read(&out("whole")), "the resumed model differs");
    // Repeated from its settings.
    let repeated =
        ["train", "--config", &out("whole").join("settings.toml").display().to_string(), "--out"].map(str::to_owned);
    let again = out("again");
    let said = works(&[&repeated.each_ref().map(String::as_str)[..], &[text(&again)]].concat());
    assert!(!said.contains("looks each") && read(&again) == read(&out("whole")), "{said}");
}

/// Starts a training and sends `signal` after a line with `word`; gives exit code and standard error.
#[cfg(unix)]
fn stopped(args: &[String], word: &str, signal: &str) -> (Option<i32>, String) {
    let mut running = Running::new(&args.iter().map(String::as_str).collect::<Vec<_>>());
    running.until(word);
    running.signal(signal);
    running.end()
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_saves_and_resumes_to_the_same_model() {
    let Some(shared) = shared() else { return };
    for signal in ["-INT", "-TERM"] {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let out = folder.path().join("run");
        let (code, said) = stopped(&shared.train(&out), "step 1/", signal);
        assert_eq!(code, Some(130), "{said}");
        assert!(said.contains(&format!("psrgs-vk train --resume {}", out.display())), "{said}");
        assert!(!said.contains("panicked") && !out.join("point_cloud.ply").exists(), "{said}");
        let saved = fs::read_dir(out.join("checkpoints")).expect("a folder").count();
        assert_eq!(saved, 1, "{said}");
        let said = works(&["train", "--resume", text(&out)]);
        assert!(said.contains("going on after step"), "{said}");
        same_model(shared, &out, &format!("{signal}, resumed"));
    }
}

/// Before the first step there is nothing to save: the training ends without waiting for depths or tuning.
#[cfg(unix)]
#[test]
fn an_interruption_before_the_first_step_ends_it_at_once() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("run");
    let (code, said) = stopped(&shared.train(&out), "to train on", "-INT");
    assert_eq!(code, Some(130), "{said}");
    assert!(said.contains("nothing to save") && !said.contains("step 1/"), "{said}");
    assert!(works(&["train", "--resume", text(&out)]).contains("starting from the beginning"));
    same_model(shared, &out, "interrupted before it began");
}

/// `nohup` makes a process ignore the loss of its terminal.
#[cfg(target_os = "linux")]
#[test]
fn a_hang_up_that_is_ignored_stays_ignored() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (ignored, ends) in [("trap '' HUP; ", Some(0)), ("", Some(130))] {
        let out = folder.path().join(format!("run{}", ignored.len()));
        let args = shared.train(&out);
        let line = format!("{ignored}exec \"$0\" \"$@\"");
        let mut running = Running::of(
            std::process::Command::new("sh").args(["-c", &line, env!("CARGO_BIN_EXE_psrgs-vk")]).args(&args),
        );
        running.until("step 1/");
        running.signal("-HUP");
        let (code, said) = running.end();
        assert_eq!(code, ends, "{ignored}{said}");
    }
}

#[cfg(unix)]
#[test]
fn a_killed_run_resumes_to_the_same_model() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("run");
    let mut args = shared.train(&out);
    args.extend(["--checkpoint-every", "15", "-v"].map(str::to_owned));
    let (code, said) = stopped(&args, "step 30: saved", "-KILL");
    assert_eq!(code, None, "{said}");
    let resumed = works(&["train", "--resume", text(&out)]);
    let step = resumed.split("going on after step ").nth(1).and_then(|rest| rest.split(' ').next()).expect("a step");
    assert!(step.parse::<u32>().is_ok_and(|s| s >= 30 && s.is_multiple_of(15)), "{resumed}");
    same_model(shared, &out, "killed and resumed");
    // The report has the curves of the whole run.
    let report = fs::read_to_string(out.join("report.html")).expect("a report");
    assert!(report.contains("Loss"));
    // At its end a resumed run only writes the last files.
    assert!(psrgs(&["train", "--resume", text(&out), "-q"]).status.success());
    same_model(shared, &out, "resumed at the end");
}

#[test]
fn test_photographs_do_not_touch_the_model() {
    let Some(shared) = shared() else { return };
    let data = crate::run::copy_of(&shared.data());
    for (name, seed) in [("view_0000.jpg", 1), ("view_0008.jpg", 2)] {
        common::noise(seed, 64, 48).save(data.path().join("images").join(name)).expect("written");
    }
    let out = data.path().join("run");
    let ends = ["train", text(data.path()), "--out", text(&out), "-q"];
    let args: Vec<&str> = ends.into_iter().chain(OPTIONS).collect();
    let output = psrgs(&args);
    assert!(output.status.success(), "{}", stderr(&output));
    same_model(shared, &out, "test photographs of noise");
    let read = |run: &Path| fs::read_to_string(run.join("metrics.json")).expect("metrics");
    let psnr = |text: String| serde_json::from_str::<serde_json::Value>(&text).expect("JSON")["psnr"].as_f64();
    let (noise, scene) = (psnr(read(&out)).expect("a number"), psnr(read(&shared.run())).expect("a number"));
    assert!((noise - scene).abs() > 0.01, "the score does not depend on the photographs: {noise} and {scene} dB");
}

/// The same training through the library.
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

/// What the photographs decide stands in the settings, and a run that goes on does not decide again.
#[test]
fn a_resumed_run_keeps_what_photographs_decided_of_exposures() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("run");
    let (data, out) = (shared.data(), text(&out));
    let told = |said: &str| said.lines().filter(|line| line.contains("are learned: ")).count();
    let begin = ["train", text(&data), "--out", out, "--method=3dgs", "--iterations=3", "--exposure=auto"];
    assert_eq!(told(&works(&begin)), 1);
    let settings = || Settings::read(&Path::new(out).join("settings.toml")).expect("settings").optimiser.exposure;
    let decided = settings();
    assert_ne!(decided, psrgs_vk::train::settings::Exposure::Auto);
    let said = works(&["train", "--resume", out, "--iterations=5"]);
    assert_eq!((told(&said), settings()), (0, decided), "{said}");
}
