//! Host memory of a training.

use std::fs;

use image::{Rgb, RgbImage};

use crate::colmap_folder::{CameraRow, Folder, PINHOLE};
use crate::common;
use crate::run::{fails, psrgs, shared, stderr, text};

const MIB: u64 = 1 << 20;

/// A dataset that does not fit is refused at the start, by `train` and by the other commands.
#[test]
fn a_training_beyond_the_memory_that_may_be_used_is_refused() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("run");
    // Less than the process takes without any photograph.
    let less = ["--host-memory", "1M"].map(str::to_owned);
    let args: Vec<String> = shared.train(&out).into_iter().chain(less).collect();
    let words =
        ["out of host memory", "are needed at the least", "1.0 MiB may be used, as was asked for", "--host-memory"];
    fails(&args.iter().map(String::as_str).collect::<Vec<_>>(), 5, &words);
    assert!(!out.join("point_cloud.ply").exists());
    let (data, depths) = (shared.data(), folder.path().join("depths"));
    fails(&["stereo", text(&data), "--out", text(&depths), "--host-memory", "1M"], 5, &["out of host memory"]);
    // A single photograph that needs more is named.
    for args in [&["check", text(&data)][..], &["eval", text(&shared.model()), text(&data)], &["train", text(&data)]] {
        let words = ["images/view_000", "64x48", "may be used", "--host-memory"];
        fails(&[args, &["--host-memory", "10K"]].concat(), 5, &words);
    }
}

/// Photographs larger than the budget; measured is the peak of the process's resident set.
#[test]
fn the_budget_holds_with_photographs_larger_than_it() {
    if common::gpu().is_none() {
        return;
    }
    const BUDGET: u64 = 800 * MIB;
    let (width, height) = (1600, 1200);
    let names: Vec<String> = (0..112).map(|i| format!("{i:03}.jpg")).collect();
    let mut folder = Folder::ring(&names.iter().map(String::as_str).collect::<Vec<_>>(), [0.0; 3]);
    let params = vec![1500.0, 1500.0, 800.0, 600.0];
    folder.cameras = vec![CameraRow { id: 1, model: PINHOLE, size: [width.into(), height.into()], params }];
    let root = tempfile::tempdir().expect("a temporary folder");
    folder.write(root.path(), &folder.binary());
    let images = root.path().join("images");
    fs::create_dir_all(&images).expect("a folder");
    RgbImage::from_fn(width, height, |x, y| Rgb([(x / 3) as u8, (y / 5) as u8, (x * y / 400) as u8]))
        .save(images.join(&names[0]))
        .expect("a photograph");
    for name in &names[1..] {
        fs::copy(images.join(&names[0]), images.join(name)).expect("copied");
    }
    let decoded = names.len() as u64 * 4 * u64::from(width) * u64::from(height);
    assert!(decoded > BUDGET);
    // The second run begins with depths by stereo, which reads all photographs.
    for (run, more) in [("plain", &[][..]), ("depths", &["--depth-prior", "stereo", "--set", "stereo-side=48"])] {
        let out = root.path().join(run);
        let budget = BUDGET.to_string();
        let ends = ["train", text(root.path()), "--out", text(&out), "--iterations", "3", "--split", "none"];
        let output = psrgs(&[&ends[..], &["--host-memory", &budget, "--max-side", "1600"], more].concat());
        let said = stderr(&output);
        if said.contains("out of host memory") {
            common::left_out(format_args!("this driver alone takes more than {BUDGET} bytes: {said}"));
            return;
        }
        assert!(output.status.success(), "{said}");
        let metrics: serde_json::Value =
            serde_json::from_slice(&fs::read(out.join("metrics.json")).expect("metrics")).expect("JSON");
        let Some(peak) = metrics["peak_host_bytes"].as_u64() else { return };
        println!("{run}: peak {} MiB of {} MiB, {} MiB decoded", peak / MIB, BUDGET / MIB, decoded / MIB);
        assert!(peak <= BUDGET, "{run}: {peak} bytes: {said}");
        assert!(said.contains("kept compressed"), "{said}");
    }
}
