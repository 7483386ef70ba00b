//! Files of other programs where a training writes.

use std::fs;

use crate::run::{content, copy_of, fails, shared, strs, text, works};

#[test]
fn a_training_never_replaces_files_of_its_dataset() {
    let Some(shared) = shared() else { return };
    let data = copy_of(&shared.data());
    let cloud = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float \
        z\nend_header\n0 0 0\n";
    fs::write(data.path().join("point_cloud.ply"), cloud).expect("written");
    fs::create_dir(data.path().join("model")).expect("a folder");
    fs::write(data.path().join("model/point_cloud.ply"), cloud).expect("written");
    let before = content(data.path());
    for (out, word) in [(".", "that is the dataset"), ("images", "photographs"), ("model", "did not write")] {
        let out = data.path().join(out);
        for more in [&[][..], &["--overwrite"]] {
            let args = ["train", text(data.path()), "--out", text(&out), "--iterations", "2"];
            fails(&[&args[..], more].concat(), 2, &[word, "another"]);
        }
    }
    assert!(content(data.path()) == before, "a file has changed");
}

/// A whole run, with all files that it removes and replaces.
#[test]
fn files_of_others_in_a_run_folder_outlast_the_next_run() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("run");
    let again = || works(&strs(&shared.train_for(3, &out, &["--overwrite", "--checkpoint-every", "1", "-q"])));
    again();
    let theirs = [
        ".editor.tmp",
        ".point_cloud.ply.a1b2c3.tmp",
        "renders/.view.tmp",
        "renders/mine.png",
        "checkpoints/other.ckpt",
    ];
    theirs.iter().for_each(|name| fs::write(out.join(name), "theirs").expect("written"));
    let (left, held) = (out.join(".psrgs-vk-abcdef012345.tmp"), out.join(".lock"));
    fs::write(&left, "left by a run that was killed").expect("written");
    fs::write(&held, "a note").expect("written");
    again();
    for name in theirs {
        assert_eq!(fs::read(out.join(name)).ok().as_deref(), Some(&b"theirs"[..]), "{name}");
    }
    assert!(!left.exists());
    assert_eq!(fs::read(&held).expect("there"), b"a note", "the lock was emptied");
}
