//! Mistakes of newcomers: each has its exit code and a message with place and remedy.

use std::fs;
use std::path::Path;

use psrgs_vk::world::{WorldParams, generate};

use crate::common;
use crate::run::{command, content, copy_of, fails, shared, text, works};

#[test]
fn wrong_folders_are_told_with_the_right_one() {
    let Some(shared) = shared() else { return };
    let root = tempfile::tempdir().expect("a temporary folder");
    let out = root.path().join("run");
    let (data, above) = (shared.data(), shared.data().parent().expect("a folder").to_owned());
    let without_cameras = copy_of(&data);
    fs::remove_dir_all(without_cameras.path().join("sparse")).expect("removed");
    let without_photographs = copy_of(&data);
    fs::remove_dir_all(without_photographs.path().join("images")).expect("removed");
    let empty = tempfile::tempdir().expect("a temporary folder");
    for (folder, words) in [
        (root.path().join("nowhere"), &["nowhere", "no such folder"][..]),
        (data.join("images"), &["the dataset is the folder above it", text(&data)]),
        (data.join("sparse/0"), &["the dataset is two folders above it", text(&data)]),
        (above, &["there is one in", text(&data)]),
        (data.join("images/view_0001.jpg"), &["view_0001.jpg", "it is a file"]),
        (without_cameras.path().to_owned(), &["sparse/0", "nothing says where they were taken from", "COLMAP"]),
        (without_photographs.path().to_owned(), &["no folder of photographs", "images_N", "--images"]),
        (empty.path().to_owned(), &["no dataset here", "docs/GUIDE.md"]),
    ] {
        fails(&["train", text(&folder), "--out", text(&out), "--iterations", "2"], 3, words);
        fails(&["stereo", text(&folder), "--out", text(&out)], 3, &words[..1]);
    }
    assert!(!out.exists(), "a dataset that cannot be loaded leaves nothing behind");
}

#[test]
fn hints_lead_to_the_dataset_and_are_of_the_format_asked_for() {
    let Some(shared) = shared() else { return };
    let data = shared.data();
    let (real, above) = (data.canonicalize().expect("a folder"), data.parent().expect("a folder"));
    // From inside the dataset, which lies below `..` and above `images`.
    for (folder, words) in [("..", "there is one in"), ("images", "the dataset is the folder above it")] {
        let output = command(&["train", folder, "--out", "none"]).current_dir(&data).output().expect("a process");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(3), "{said}");
        assert!(said.contains(words) && said.contains(text(&real)), "{folder}: {said}");
    }
    assert!(!data.join("none").exists());
    let out = above.join("none");
    let train = |folder: &Path| {
        let args = ["train", text(folder), "--format", "opensfm", "--out", text(&out)];
        let output = command(&args).output().expect("a process");
        assert_eq!(output.status.code(), Some(3));
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let said = train(&data);
    assert!(
        said.contains("reconstruction.json") && said.contains("there is a colmap dataset: set no --format"),
        "{said}"
    );
    for folder in [above.to_owned(), data.join("images"), data.join("sparse/0")] {
        let said = train(&folder);
        assert!(!said.contains("there is one in") && !said.contains("above it"), "{said}");
    }
}

#[test]
fn other_mistakes_are_told_with_what_to_do() {
    let Some(shared) = shared() else { return };
    let (data, run) = (shared.data(), shared.run());
    let folder = tempfile::tempdir().expect("a temporary folder");
    let taken = folder.path().join("taken");
    fs::write(&taken, "").expect("written");
    let (data, run_text) = (text(&data), text(&run));
    let (out, picture) = (folder.path().join("out"), folder.path().join("picture.svg"));
    for (args, code, words) in [
        (&["train", data, "--iteration", "2"][..], 2, &["--iteration", "--iterations"][..]),
        (&["trian", data], 2, &["train"]),
        (&["train", data, "--method", "gaussian"], 2, &["gaussian", "3dgs, absgs"]),
        (&["train", data, "--iterations", "ten"], 2, &["--iterations", "ten"]),
        (&["train", data, "--max-side", "0", "--out", text(&out)], 2, &["max-side", "at least 16"]),
        (&["train", data, "--set", "bands=0", "--out", text(&out)], 2, &["bands", "from 1 to 64"]),
        (&["train", data, "--out", text(&taken), "--iterations", "2"], 8, &["taken", "another --out"]),
        (&["train", data, "--out", run_text, "--iterations", "2"], 2, &["--resume", "--overwrite", "another --out"]),
        (&["train", "--resume", data], 3, &["no run to resume", "settings.toml"]),
        (&["train", "--resume", run_text, "--iterations", "149"], 2, &["--iterations 149", "step 150 already"]),
        (&["stereo", data, "--out", data], 2, &["that is the dataset", "another folder"]),
        (&["render", run_text, "--cameras", data, "--out", text(&out)], 3, &["a folder", "point_cloud.ply"]),
        (&["eval", run_text, data], 3, &["a folder", "point_cloud.ply"]),
        (&["eval", "none.ply", data, "--json", text(&out.join("scores.json"))], 8, &["scores.json", "beside it"]),
        (&["eval", "none.ply", data, "--json", run_text], 8, &[run_text, "cannot write"]),
        (&["bench", "--plot", text(&taken), text(&out.join("none.json"))], 2, &["taken", ".svg"]),
        (&["bench", "--plot", text(&picture), text(&out.join("none.json"))], 3, &["none.json", "bench --json"]),
    ] {
        fails(args, code, words);
    }
    let empty = folder.path().join("empty.ply");
    let header = [
        "ply",
        "format ascii 1.0",
        "element vertex 0",
        "property float x",
        "property float y",
        "property float z",
        "end_header",
        "",
    ];
    fs::write(&empty, header.join("\n")).expect("written");
    let args = ["train", data, "--out", text(&out), "--iterations", "2", "--init", text(&empty)];
    fails(&args, 3, &["empty.ply", "to begin with", "--init"]);
    let misnamed = copy_of(&shared.data());
    fs::create_dir(misnamed.path().join("masks")).expect("a folder");
    image::GrayImage::new(64, 48).save(misnamed.path().join("masks/mask1.png")).expect("written");
    let said = works(&["train", text(misnamed.path()), "--out", text(&out), "--iterations", "2", "--max-side", "64"]);
    assert!(said.contains("masks: no mask has the name of a photograph (a.jpg.png or a.png for a.jpg)"), "{said}");
}

/// Renders are named after photographs: written into the folder of the photographs, they would replace them.
#[test]
fn results_do_not_replace_what_they_are_made_from() {
    let Some(shared) = shared() else { return };
    let data = copy_of(&shared.data());
    fs::create_dir(data.path().join("masks")).expect("a folder");
    let before = content(data.path());
    let model = shared.model();
    let (model, data_text) = (text(&model), text(data.path()));
    for folder in ["", "images", "sparse/../images", "masks"] {
        let out = data.path().join(folder);
        let out = text(&out);
        for args in [
            &["render", model, "--cameras", data_text, "--out", out][..],
            &["eval", model, data_text, "--out", out],
            &["saliency", data_text, "--out", out],
            &["stereo", data_text, "--out", out],
        ] {
            fails(args, 2, &["--out", "the dataset", "another folder"]);
        }
    }
    assert!(content(data.path()) == before, "a refused command has changed a file");
}

/// The dataset's folder holds another dataset, with photographs of the same names.
#[test]
fn a_run_does_not_go_on_with_another_dataset() {
    if common::gpu().is_none() {
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (data, out) = (folder.path().join("scene"), folder.path().join("run"));
    let scene = |seed: u64, images: u32| {
        let _ = fs::remove_dir_all(&data);
        let params =
            WorldParams { images, max_side: 64, seed, offpath: 0, pixels_per_point: 16, ..WorldParams::default() };
        generate(&params, &data, &mut |_| ()).expect("a scene");
    };
    scene(1, 9);
    let begin = ["train", text(&data), "--out", text(&out), "--iterations", "4", "--checkpoint-every", "2"];
    works(&[&begin[..], &["--scale-schedule=false"]].concat());
    let go_on = ["train", "--resume", text(&out), "--iterations", "6"];
    scene(2, 9);
    fails(&go_on, 3, &["not the one that the run was trained on", "camera of 'view_0001.jpg'", "another folder"]);
    scene(1, 10);
    fails(&go_on, 3, &["8 photographs to train on, and the run had 7"]);
    scene(1, 9);
    works(&go_on);
}

/// A training photograph that is missing or can no longer be decoded stops a resumption; a held-out one does not.
#[test]
fn a_run_does_not_resume_without_one_of_its_photographs() {
    if common::gpu().is_none() {
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (data, out) = (folder.path().join("scene"), folder.path().join("run"));
    let params = WorldParams { images: 12, max_side: 64, offpath: 0, pixels_per_point: 16, ..WorldParams::default() };
    generate(&params, &data, &mut |_| ()).expect("a scene");
    let begin = ["train", text(&data), "--out", text(&out), "--iterations", "2", "--checkpoint-every", "1"];
    works(&[&begin[..], &["--scale-schedule=false"]].concat());
    let resumed = |iterations: &'static str| ["train", "--resume", text(&out), "--iterations", iterations];
    let damages: [fn(&Path); 2] = [
        |file| fs::remove_file(file).expect("removed"),
        |file| {
            let bytes = fs::read(file).expect("read");
            fs::write(file, &bytes[..bytes.len() / 2]).expect("written");
        },
    ];
    let photograph = data.join("images/view_0005.jpg");
    let whole = fs::read(&photograph).expect("read");
    for (damage, why) in damages.into_iter().zip(["there is no such file", "the file ends before the picture does"]) {
        damage(&photograph);
        let words = ["not the one that the run was trained on", "'view_0005.jpg' is not to be trained on any more"];
        fails(&resumed("3"), 3, &[&words[..], &["missing, unusable or held out", "Put back", why]].concat());
        fs::write(&photograph, &whole).expect("written");
    }
    let held_out = data.join("images/view_0008.jpg");
    let whole = fs::read(&held_out).expect("read");
    for (damage, iterations) in damages.into_iter().zip(["3", "4"]) {
        damage(&held_out);
        let said = works(&resumed(iterations));
        assert!(said.contains("1 of 12 photographs cannot be used and is left out, 'view_0008.jpg'"), "{said}");
        fs::write(&held_out, &whole).expect("written");
    }
}

/// Stages are shares of a training's steps. A finished stage does not begin again when steps are added.
#[test]
fn a_stage_that_is_over_does_not_begin_again() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (data, out) = (shared.data(), folder.path().join("run"));
    works(&[
        "train",
        text(&data),
        "--out",
        text(&out),
        "--method",
        "lean",
        "--iterations",
        "20",
        "--set",
        "coarse-steps=0.5",
        "--max-side",
        "64",
        "--scale-schedule=false",
    ]);
    let go_on = |iterations| ["train", "--resume", text(&out), "--iterations", iterations];
    fails(&go_on("42"), 2, &["--iterations 42", "step 20", "coarse photographs", "--init"]);
    works(&go_on("30"));
}

#[cfg(unix)]
#[test]
fn a_name_that_settings_cannot_hold_is_refused() {
    use std::os::unix::ffi::OsStrExt as _;
    let name = std::ffi::OsStr::from_bytes(b"fox-\xff");
    for before in [&["train"][..], &["train", "fox", "--init"]] {
        let output = command(before).arg(name).output().expect("a process");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(2) && said.contains("not UTF-8"), "{before:?}: {said}");
    }
}
