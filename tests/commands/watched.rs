//! The whole life of a run under the validation layers: stereo, growth beyond the first allocation, perceptual
//! distance, checkpoints, a resumption, evaluation, rendering, and the end, at which every Vulkan object must be gone.

use std::fs;
use std::path::Path;

use psrgs_vk::world::{WorldParams, generate};

use crate::common;
use crate::kills::OPTIONS;
use crate::run::{command, stderr, text};

/// The whole life with `PSRGS_VALIDATION=mode` and further variables. The program fails on any message.
fn life(mode: &str, variables: &[(&str, &str)]) {
    if common::gpu().is_none() {
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let data = folder.path().join("scene");
    let params = WorldParams { images: 9, max_side: 64, pixels_per_point: 16, offpath: 1, ..WorldParams::default() };
    generate(&params, &data, &mut |_| ()).expect("a scene");
    let works = |args: &[&str]| {
        let mut command = command(args);
        // Guards would extend the buffers against which addresses are checked.
        let guards = if mode == "gpu" { "0" } else { "1" };
        command.env("PSRGS_VALIDATION", mode).env("PSRGS_CANARIES", guards).envs(variables.iter().copied());
        let output = command.output().expect("the command starts");
        assert!(output.status.success(), "{mode}: {args:?}: {}", stderr(&output));
        stderr(&output)
    };
    let out = folder.path().join("run");
    let mut train = vec!["train", text(&data), "--out", text(&out), "-v"];
    // Few checkpoints, so that one from before the last growth is kept.
    let options = OPTIONS.replace("--checkpoint-every 3", "--checkpoint-every 20");
    train.extend(options.split_whitespace());
    let weights = common::weights("lpips_squeeze_v0.1.pth").and_then(|file| Some(file.parent()?.to_owned()));
    if let Some(weights) = &weights {
        train.extend(["--perceptual-weights", text(weights)]);
    }
    let said = works(&train);
    assert!(said.contains("depths from stereo") && said.contains(": sigma "), "{said}");
    let changed = |line: &str| line.contains(" cloned, ") && !line.contains(" 0 split");
    assert!(said.lines().any(changed), "{said}");
    go_back(&out);
    let said = works(&["train", "--resume", text(&out), "-v"]);
    assert!(said.lines().any(changed), "{said}");

    let model = out.join("point_cloud.ply");
    let eval = folder.path().join("eval");
    works(&["eval", text(&model), text(&data), "--out", text(&eval)]);
    let pictures = folder.path().join("pictures");
    works(&["render", text(&model), "--cameras", text(&data), "--out", text(&pictures), "--depth", "--sh-bits", "16"]);
    let maps = folder.path().join("maps");
    works(&["stereo", text(&data), "--out", text(&maps)]);
    assert!(maps.join("fused.ply").exists() && eval.join("report.html").exists());
}

/// Removes the results and all checkpoints but the first.
fn go_back(out: &Path) {
    let mut kept: Vec<_> =
        fs::read_dir(out.join("checkpoints")).expect("checkpoints").map(|entry| entry.expect("one").path()).collect();
    kept.sort();
    assert!(kept.len() > 1, "{kept:?}");
    for checkpoint in &kept[1..] {
        fs::remove_file(checkpoint).or_else(|_| fs::remove_dir_all(checkpoint)).expect("removed");
    }
    for file in ["point_cloud.ply", "metrics.json"] {
        fs::remove_file(out.join(file)).expect(file);
    }
}

#[test]
fn whole_life_of_a_run_leaves_no_message() {
    life("1", &[]);
}

/// LLVM 21's optimizer, under Mesa 26.1 and for vectors of 8, gives the stores of `convolution` by address a mask of
/// all lanes.
const NOT_OPTIMIZED: (&str, &str) = ("GALLIVM_PERF", "nopt");

#[test]
fn whole_life_by_address_uses_none_outside_of_its_buffers() {
    if common::layer_assists() {
        life("gpu", &[NOT_OPTIMIZED, ("PSRGS_ADDRESSES", "always")]);
    }
}

/// The layer also checks accesses through descriptors and texels, and races in shared memory.
#[test]
fn whole_life_by_descriptors_stays_within_them() {
    if common::layer_assists() {
        life("gpu", &[NOT_OPTIMIZED, ("PSRGS_ADDRESSES", "never")]);
    }
}
