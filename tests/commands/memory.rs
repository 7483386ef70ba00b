//! What a training takes of the host's memory.

use std::fs;

use image::{Rgb, RgbImage};

use crate::colmap_folder::{CameraRow, Folder, PINHOLE};
use crate::common;
use crate::run::{psrgs, shared, stderr, text, works};

const MIB: u64 = 1 << 20;

#[test]
fn photographs_that_may_not_stay_in_memory_train_to_the_same_model() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("run");
    let mut args = shared.train(&out);
    // Less than the process takes without a single photograph: nothing is kept, and that is said.
    args.extend(["--host-memory", "1M", "-v"].map(str::to_owned));
    let said = works(&args.iter().map(String::as_str).collect::<Vec<_>>());
    assert!(said.contains("host memory: of the 1.0 MiB") && said.contains("the least that works"), "{said}");
    let model = |run: &std::path::Path| fs::read(run.join("point_cloud.ply")).expect("a model");
    assert!(model(&out) == model(&shared.run()), "the models differ");
    // Where the device's memory is not the host's, they are all on it.
    if said.contains("device: llvmpipe") {
        assert!(said.contains("150 uploaded in their steps"), "{said}");
    }
}

/// Photographs that take more than the budget, and the largest resident set that the process had.
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
    // Depths are found of them first, which looks at all of them.
    for (run, more) in [("plain", &[][..]), ("depths", &["--depth-prior", "stereo", "--stereo-side", "48"])] {
        let out = root.path().join(run);
        let budget = BUDGET.to_string();
        let ends = ["train", text(root.path()), "--out", text(&out), "--iterations", "3", "--split", "none"];
        let output = psrgs(&[&ends[..], &["--host-memory", &budget, "--max-side", "1600"], more].concat());
        let said = stderr(&output);
        assert!(output.status.success(), "{said}");
        if said.contains("the least that works") {
            common::left_out(format_args!("this driver alone takes more than {BUDGET} bytes: {said}"));
            return;
        }
        let metrics: serde_json::Value =
            serde_json::from_slice(&fs::read(out.join("metrics.json")).expect("metrics")).expect("JSON");
        let Some(peak) = metrics["peak_host_bytes"].as_u64() else { return };
        println!("{run}: peak {} MiB of {} MiB, {} MiB decoded", peak / MIB, BUDGET / MIB, decoded / MIB);
        assert!(peak <= BUDGET, "{run}: {peak} bytes: {said}");
        assert!(said.contains("kept compressed"), "{said}");
    }
}
