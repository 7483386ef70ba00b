//! The command that compares methods.

use std::fs;
use std::process::Stdio;
use std::time::Duration;

use crate::run::{command, fails, shared, text, works};

/// The whole numbers in a column of a table of runs.
fn numbers(runs: &str, name: &str) -> Vec<u64> {
    let column = runs.lines().next().and_then(|head| head.split(',').position(|key| key == name)).expect("a column");
    runs.lines().skip(1).map(|line| line.split(',').nth(column).expect(name).parse().expect("a number")).collect()
}

#[test]
fn methods_are_compared_and_a_stopped_comparison_goes_on() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (data, out) = (shared.data(), folder.path().join("compared"));
    let args = |seeds: &'static str| {
        let mut args =
            vec!["compare", text(&data), "--out", text(&out), "--methods", "3dgs,lean,psrgs", "--seeds", seeds];
        args.extend(["--iterations", "40", "--max-side", "64", "--percent", "50"]);
        args.extend(["--", "--densify-from", "5", "--densify-interval", "10", "--set", "stereo-side=64"]);
        args
    };
    works(&args("1"));
    let read = |name: &str| fs::read_to_string(out.join(name)).expect(name);
    let runs = read("runs.csv");
    // 3dgs, and each of the others with all and with half of its splats.
    assert_eq!(runs.lines().count(), 1 + 6, "{runs}");
    let splats = numbers(&runs, "splats");
    // A run with a limit of splats follows the run without. Reconstructed splats stay, however low the limit.
    for (k, line) in runs.lines().skip(1).enumerate().filter(|(_, line)| line.split(',').nth(2) == Some("50")) {
        assert!(splats[k] <= splats[k - 1], "{line}");
    }
    let table = read("table.md");
    assert!(table.contains("| scene | lean, 50 % of 3dgs | 1 |") && table.contains("Against 3dgs"), "{table}");
    assert!(table.contains("Against 3dgs, 50 % of the splats of 3dgs"), "{table}");
    assert!(table.contains("All rows share: preset standard, iterations 40, max-side 64, split test"), "{table}");
    // Stereo of the held-out photographs judges the depths of every run.
    let head = runs.lines().next().expect("a head").split(',').collect::<Vec<_>>();
    let stereo = head.iter().position(|key| *key == "depth_stereo_error").expect("a column");
    let judged = |line: &str| line.split(',').nth(stereo).is_some_and(|v| v.parse::<f64>().is_ok_and(|v| v < 1.0));
    assert!(runs.lines().skip(1).all(judged), "{runs}");
    assert!(table.contains(" depth\\_stereo\\_error |"), "{table}");
    let page = read("compare.html");
    assert!(page.contains("<svg") && !page.contains("http"), "the page loads something from outside");

    // Results of runs with other options are not reused.
    let other = [&args("1")[..], &["--lr-means", "0.001"]].concat();
    fails(&other, 2, &["scene-3dgs-s0", "other options", "--lr-means 0.001", "another --out"]);
    assert_eq!(runs, read("runs.csv"));

    // A run that was stopped before its end is trained; finished runs are reused.
    let model = out.join("runs/scene-lean-s0/point_cloud.ply");
    let before = fs::metadata(&model).and_then(|m| m.modified()).expect("a model");
    fs::remove_file(out.join("runs/scene-psrgs-s0/metrics.json")).expect("metrics");
    fs::remove_dir_all(out.join("runs/scene-psrgs-s0/checkpoints")).expect("checkpoints");
    works(&args("1"));
    assert!(out.join("runs/scene-psrgs-s0/metrics.json").is_file());
    let judged =
        |run: &str| fs::metadata(out.join(run).join("judged.json")).and_then(|m| m.modified()).expect("scores");
    assert!(judged("runs/scene-psrgs-s0") > judged("runs/scene-lean-s0"), "the new model is not judged");
    assert_eq!(fs::metadata(&model).and_then(|m| m.modified()).expect("a model"), before, "lean was trained again");
}

#[test]
fn rows_of_one_method_differ_in_what_they_set() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (data, out) = (shared.data(), folder.path().join("compared"));
    let with = |more: &[&str]| {
        let rows = "3dgs,3dgs:max-splats=90:exposure=affine:iterations=12";
        let args = ["compare", text(&data), "--out", text(&out), "--methods", rows, "--seeds", "1"];
        let all = ["--iterations", "10", "--max-side", "64", "--", "--exposure", "off"];
        [&args[..], &all, more].concat().into_iter().map(str::to_owned).collect::<Vec<_>>()
    };
    let made = |more: &[&str]| works(&with(more).iter().map(String::as_str).collect::<Vec<_>>());
    made(&[]);
    let read = |name: &str| fs::read_to_string(out.join(name)).expect(name);
    let row = "runs/scene-3dgs+max-splats~90+exposure~affine+iterations~12-s0";
    let settings = read(&format!("{row}/settings.toml"));
    for line in ["max-splats = 90", "exposure = \"affine\"", "iterations = 12"] {
        assert!(settings.contains(line), "{line}: {settings}");
    }
    assert!(read("runs/scene-3dgs-s0/settings.toml").contains("exposure = \"off\""));
    let table = read("table.md");
    let label = "3dgs:max-splats=90:exposure=affine:iterations=12";
    assert!(
        table.contains(&format!("| scene | {label} | 1 |")) && table.contains(&format!("\n| {label} | ")),
        "{table}"
    );
    assert!(table.contains("Against 3dgs:") && table.contains("exposure "), "{table}");
    assert!(table.contains(&format!("({label})")), "{table}");
    let runs = read("runs.csv");
    assert!(numbers(&runs, "first_splats").into_iter().all(|n| n > 0), "{runs}");

    // Finished runs stay. A run of which nothing is left is made anew, with other options too.
    let time =
        |run: &str| fs::metadata(out.join(run).join("metrics.json")).and_then(|m| m.modified()).expect("metrics");
    let before = time(row);
    fs::remove_file(out.join("runs/scene-3dgs-s0/metrics.json")).expect("metrics");
    fs::remove_dir_all(out.join("runs/scene-3dgs-s0/checkpoints")).expect("checkpoints");
    made(&[]);
    assert_eq!(time(row), before, "a finished run was made again");
    fs::remove_file(out.join(row).join("metrics.json")).expect("metrics");
    let others = with(&["--lr-means", "0.001"]);
    let others: Vec<&str> = others.iter().map(String::as_str).collect();
    fails(&others, 2, &["scene-3dgs-s0", "other options"]);
    fs::remove_dir_all(out.join("runs/scene-3dgs-s0/checkpoints")).expect("checkpoints");
    fs::remove_file(out.join("runs/scene-3dgs-s0/metrics.json")).expect("metrics");
    // The other run has a checkpoint of other options.
    fails(&others, 2, &["exposure~affine", "other options"]);
}

#[test]
fn a_comparison_that_cannot_be_made_says_why() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (data, out) = (shared.data(), folder.path().join("compared"));
    let ends = ["compare", text(&data), "--out", text(&out), "--iterations", "5"];
    let with = |more: &[&'static str]| [&ends[..], more].concat();
    fails(&with(&["--methods", "lean", "--percent", "50"]), 2, &["--percent", "3dgs"]);
    fails(&with(&["--methods", "gsplat", "--seeds", "1"]), 2, &["--methods", "gsplat", "psrgs-paper"]);
    let row = "3dgs:start=moon";
    fails(&with(&["--methods", row]), 2, &["--methods 3dgs:start=moon", "start", "sfm or stereo"]);
    // Each setting is one that there is, but the two cannot be trained together.
    let row = "psrgs-paper:gate=off:sigma-learning=composite";
    fails(&with(&["--methods", row]), 2, &["--methods psrgs-paper:gate=off", "sigma-learning"]);
    fails(&with(&["--methods", "3dgs,3dgs:max-splats=9", "--percent", "50"]), 2, &["max-splats", "--percent"]);
    fails(&with(&["--methods", "3dgs:start=stereo", "--percent", "50"]), 2, &["--percent", "3dgs", "first"]);
    fails(&with(&["--methods", "3dgs,3dgs"]), 2, &["--methods 3dgs", "twice"]);
    fails(&with(&["--seeds", "0"]), 2, &["--seeds"]);
    fails(&with(&["--percent", "0"]), 2, &["--percent"]);
    fails(&with(&["--split", "none"]), 2, &["--split none", "held out"]);
    fails(&with(&["/nowhere/scene"]), 3, &["/nowhere/scene"]);
    // Runs are named after folders: two folders of one name are an error before any training.
    let other = folder.path().join("other/scene");
    fs::create_dir_all(&other).expect("a folder");
    fails(&with(&[text(&other).to_owned().leak()]), 2, &[text(&data), text(&other), "rename"]);
    assert!(!out.exists());
    // The exit code is that of the failed training.
    fails(&with(&["--methods", "3dgs", "--", "--lambda-dssim", "7"]), 2, &["lambda-dssim", "scene-3dgs-s0"]);
    fails(&with(&["--methods", "lean", "--ablate", "psrgs"]), 2, &["--ablate"]);
    fails(&with(&["--ablate", "gsplat"]), 2, &["--ablate", "gsplat", "psrgs-paper"]);
}

#[test]
fn rsgs_takes_the_scan_of_the_dataset_or_says_that_it_had_none() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let data = shared.data();
    let table = |out: &str, more: &[&str]| {
        let out = folder.path().join(out);
        let ends =
            ["compare", text(&data), "--out", text(&out), "--seeds", "1", "--iterations", "25", "--max-side", "64"];
        works(&[&ends[..], more, &["--", "--set", "stereo-side=64", "--set", "propagate-from=0"]].concat());
        assert!(out.join("runs/scene-rsgs-s0/metrics.json").is_file());
        fs::read_to_string(out.join("table.md")).expect("a table")
    };
    let both = table("scan", &["--methods", "rsgs,gspro"]);
    assert!(both.contains("| scene | rsgs | 1 |") && both.contains("| scene | gspro | 1 |"), "{both}");
    let made = table("made", &["--methods", "rsgs", "--lidar", "mvs"]);
    assert!(made.contains("| scene | rsgs (MVS cloud, no LiDAR) | 1 |"), "{made}");
}

/// A stop reaches the training. The comparison waits until the training has saved.
#[cfg(unix)]
#[test]
fn a_comparison_that_is_stopped_leaves_no_training_behind() {
    use rustix::process::{Pid, Signal, kill_process};
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (data, out) = (shared.data(), folder.path().join("compared"));
    let args = [
        "compare",
        text(&data),
        "--out",
        text(&out),
        "--methods",
        "3dgs",
        "--iterations",
        "1000000",
        "--max-side",
        "64",
        "--",
        "--checkpoint-every",
        "20",
    ];
    let child = command(&args).stderr(Stdio::piped()).spawn().expect("it starts");
    let run = out.join("runs/scene-3dgs-s0");
    let saved = || fs::read_dir(run.join("checkpoints")).is_ok_and(|mut files| files.next().is_some());
    while !saved() {
        std::thread::sleep(Duration::from_millis(20));
    }
    kill_process(Pid::from_raw(child.id() as i32).expect("a process"), Signal::TERM).expect("told to stop");
    let output = child.wait_with_output().expect("an end");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{said}");
    assert!(said.contains("stopped; the same command goes on from here"), "{said}");
    assert!(saved(), "no checkpoint was saved");
    // No process holds the lock of the run.
    fails(&["train", "--resume", text(&run), "--iterations", "1"], 2, &["--iterations"]);
}
