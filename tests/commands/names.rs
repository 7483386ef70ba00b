//! Photographs with long names, and photographs whose names differ in the extension alone.

use std::fs;
use std::path::Path;

use crate::run::{copy_of, shared, strs, text, works};

/// Gives a photograph of a copied dataset another name.
fn rename(data: &Path, from: &str, to: &str) {
    let model = data.join("sparse/0/images.bin");
    let bytes = fs::read(&model).expect("a model");
    let old = [from.as_bytes(), &[0]].concat();
    let at = bytes.windows(old.len()).position(|window| window == old).expect("its name");
    let new = [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat();
    fs::write(&model, new).expect("written");
    let file = data.join("images").join(to);
    fs::create_dir_all(file.parent().expect("a folder")).expect("a folder");
    fs::rename(data.join("images").join(from), file).expect("renamed");
}

/// Names of files in `folder` that end with `end`.
fn ending(folder: &Path, end: &str) -> Vec<String> {
    let names = fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").file_name());
    names.filter_map(|name| name.into_string().ok()).filter(|name| name.ends_with(end)).collect()
}

#[test]
fn held_out_photographs_with_the_longest_names_are_scored() {
    let Some(shared) = shared() else { return };
    let data = copy_of(&shared.data());
    let (long, part) = (format!("{}.jpg", "n".repeat(241)), "p".repeat(200));
    rename(data.path(), "view_0000.jpg", &format!("{part}/{part}/{part}/x.jpg"));
    rename(data.path(), "view_0008.jpg", &long);
    let out = data.path().join("run");
    let mut args = shared.train_for(3, &out, &["--split", "every:8"]);
    args[1] = text(data.path()).to_owned();
    works(&strs(&args));
    assert!(out.join("metrics.json").exists() && out.join("report.html").exists());
    let metrics: serde_json::Value =
        serde_json::from_slice(&fs::read(out.join("metrics.json")).expect("metrics")).expect("JSON");
    let scored = metrics["images"].as_array().expect("a list").len();
    assert!(scored == 2 && ending(&out.join("renders"), ".render.png").len() == 2, "{metrics}");
}

#[test]
fn photographs_of_one_name_keep_separate_renders_and_depths() {
    let Some(shared) = shared() else { return };
    let data = copy_of(&shared.data());
    for (from, to) in [("view_0001.jpg", "a.jpg"), ("view_0002.jpg", "a.jpeg"), ("view_0003.jpg", "A-1.jpg")] {
        rename(data.path(), from, to);
    }
    let (renders, depths) = (data.path().join("renders"), data.path().join("stereo"));
    let (model, folder) = (shared.model(), text(data.path()));
    works(&["render", text(&model), "--cameras", folder, "--out", text(&renders)]);
    assert_eq!(ending(&renders, ".png").len(), 9);
    works(&["stereo", folder, "--out", text(&depths), "--split", "none", "--max-side", "32"]);
    for kind in ["depth", "normal", "confidence"] {
        let names = ending(&depths.join(kind), ".exr");
        let mut folded: Vec<String> = names.iter().map(|name| name.to_lowercase()).collect();
        folded.sort();
        folded.dedup();
        assert_eq!(folded.len(), 9, "{names:?}");
    }
}
