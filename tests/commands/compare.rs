//! Methods against one another.

use std::fs;

use crate::run::{fails, shared, text, works};

#[test]
fn methods_are_compared_and_a_stopped_comparison_goes_on() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (data, out) = (shared.data(), folder.path().join("compared"));
    let args = |seeds: &'static str| {
        let mut args =
            vec!["compare", text(&data), "--out", text(&out), "--methods", "3dgs,lean,psrgs", "--seeds", seeds];
        args.extend(["--iterations", "40", "--max-side", "64", "--percent", "50"]);
        args.extend(["--", "--densify-from", "5", "--densify-interval", "10", "--stereo-side", "64"]);
        args
    };
    works(&args("1"));
    let read = |name: &str| fs::read_to_string(out.join(name)).expect(name);
    let runs = read("runs.csv");
    // 3dgs, and each of the others with all and with half of its splats.
    assert_eq!(runs.lines().count(), 1 + 6, "{runs}");
    let splats: Vec<u64> =
        runs.lines().skip(1).map(|line| line.split(',').nth(10).expect("splats").parse().expect("a number")).collect();
    // A run with a limit follows the one without. What is reconstructed stays, however low the limit.
    for (k, line) in runs.lines().skip(1).enumerate().filter(|(_, line)| line.split(',').nth(2) == Some("50")) {
        assert!(splats[k] <= splats[k - 1], "{line}");
    }
    let table = read("table.md");
    assert!(table.contains("| scene | lean, 50 % of 3dgs | 1 |") && table.contains("Against 3dgs"), "{table}");
    assert!(table.contains("Against lean"), "{table}");
    let page = read("compare.html");
    assert!(page.contains("<svg") && !page.contains("http"), "the page asks for nothing from outside");

    // One that was stopped before its end is trained, the others are taken as they are.
    let model = out.join("runs/scene-lean-s0/point_cloud.ply");
    let before = fs::metadata(&model).and_then(|m| m.modified()).expect("a model");
    fs::remove_file(out.join("runs/scene-psrgs-s0/metrics.json")).expect("metrics");
    fs::remove_dir_all(out.join("runs/scene-psrgs-s0/checkpoints")).expect("checkpoints");
    works(&args("1"));
    assert!(out.join("runs/scene-psrgs-s0/metrics.json").is_file());
    assert_eq!(fs::metadata(&model).and_then(|m| m.modified()).expect("a model"), before, "lean was trained again");
}

#[test]
fn a_comparison_that_cannot_be_made_says_why() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (data, out) = (shared.data(), folder.path().join("compared"));
    let ends = ["compare", text(&data), "--out", text(&out), "--iterations", "5"];
    let with = |more: &[&'static str]| [&ends[..], more].concat();
    fails(&with(&["--methods", "lean", "--percent", "50"]), 2, &["--percent", "3dgs"]);
    fails(&with(&["--methods", "gsplat", "--seeds", "1"]), 7, &["gsplat", "psrgs-paper"]);
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
        works(&[&ends[..], more, &["--", "--stereo-side", "64", "--propagate-from", "0"]].concat());
        assert!(out.join("runs/scene-rsgs-s0/metrics.json").is_file());
        fs::read_to_string(out.join("table.md")).expect("a table")
    };
    let both = table("scan", &["--methods", "rsgs,gspro"]);
    assert!(both.contains("| scene | rsgs | 1 |") && both.contains("| scene | gspro | 1 |"), "{both}");
    let made = table("made", &["--methods", "rsgs", "--lidar", "mvs"]);
    assert!(made.contains("| scene | rsgs (MVS cloud, no LiDAR) | 1 |"), "{made}");
}
