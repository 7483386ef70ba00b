//! Unusable data: each kind has an exit code and a message with fault and place, and nothing panics.

use std::fs;
use std::path::Path;

use psrgs_vk::world::{WorldParams, generate};

use crate::run::{command, copy_of, fails, psrgs, shared, stderr, text, works};

/// Arguments of a training of a few steps.
fn train<'a>(data: &'a Path, out: &'a Path) -> [&'a str; 7] {
    ["train", text(data), "--out", text(out), "--iterations", "3", "-q"]
}

#[test]
fn damaged_datasets_are_told_apart() {
    let Some(shared) = shared() else { return };
    type Damage = fn(&Path);
    let cases: [(&str, Damage, &[&str]); 7] = [
        (
            "a photograph is missing",
            |data| fs::remove_file(data.join("images/view_0004.jpg")).expect("removed"),
            &["images", "1 of 9 photographs is missing", "view_0004.jpg"],
        ),
        (
            "a photograph of another shape",
            |data| image::RgbImage::new(48, 64).save(data.join("images/view_0002.jpg")).expect("written"),
            &["view_0002.jpg", "48x64", "64x48", "90 degrees"],
        ),
        (
            "a pixel in the place of a photograph",
            |data| image::RgbImage::new(1, 1).save(data.join("images/view_0002.jpg")).expect("written"),
            &["view_0002.jpg", "1x1", "64x48", "too small"],
        ),
        (
            "a file that is no photograph",
            |data| fs::write(data.join("images/view_0001.jpg"), "no picture").expect("written"),
            &["view_0001.jpg"],
        ),
        (
            "a camera of an unknown model",
            |data| {
                // Number of cameras (8 bytes), id of the camera (4), its model (4): 7 is FOV, which has one more
                // parameter.
                let file = data.join("sparse/0/cameras.bin");
                let mut bytes = fs::read(&file).expect("cameras");
                bytes[12] = 7;
                bytes.extend(1.0_f64.to_le_bytes());
                fs::write(&file, bytes).expect("written");
            },
            &["cameras.bin", "FOV", "image_undistorter"],
        ),
        (
            "truncated poses",
            |data| {
                let file = data.join("sparse/0/images.bin");
                let bytes = fs::read(&file).expect("images");
                fs::write(&file, &bytes[..bytes.len() / 2]).expect("written");
            },
            &["images.bin", "at byte"],
        ),
        (
            "no model",
            |data| fs::remove_dir_all(data.join("sparse")).expect("removed"),
            &["no dataset here", "sparse/0"],
        ),
    ];
    for (what, damage, words) in cases {
        let data = copy_of(&shared.data());
        damage(data.path());
        println!("{what}");
        fails(&train(data.path(), &data.path().join("run")), 3, words);
        fails(&["eval", text(&shared.model()), text(data.path())], 3, words);
    }
}

#[test]
fn a_scene_with_one_photograph_is_trained_but_not_scored() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (data, out) = (folder.path().join("one"), folder.path().join("run"));
    generate(&WorldParams { images: 1, max_side: 64, offpath: 0, ..WorldParams::default() }, &data, &mut |_| ())
        .expect("a scene");
    // One photograph makes no points.
    fails(&train(&data, &out), 3, &["no points", "--init"]);

    let start = shared.model();
    let said = works(&[&train(&data, &out)[..], &["--init", text(&start), "--overwrite"]].concat());
    assert!(said.contains("too few to hold any out"), "{said}");
    let metrics = fs::read_to_string(out.join("metrics.json")).expect("metrics");
    let metrics: serde_json::Value = serde_json::from_str(&metrics).expect("JSON");
    assert!(metrics["psnr"].is_null() && metrics["test_images"] == 0 && metrics["train_images"] == 1);
    assert!(out.join("point_cloud.ply").exists() && out.join("report.html").exists());

    fails(&["eval", text(&start), text(&data)], 3, &["none is held out"]);
    let pictures = folder.path().join("pictures");
    let args = ["render", text(&start), "--cameras", text(&data), "--out", text(&pictures), "-q"];
    works(&args);
    fails(&[&args[..], &["--views", "test"]].concat(), 3, &["--views"]);
}

#[test]
fn models_that_are_none_name_the_place() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let whole = fs::read(shared.model()).expect("a model");
    let cut = folder.path().join("cut.ply");
    fs::write(&cut, &whole[..whole.len() - 10]).expect("written");
    let points = folder.path().join("points.ply");
    let header =
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    fs::write(&points, format!("{header}0 0 0\n")).expect("written");
    let other = folder.path().join("other.ply");
    fs::write(&other, "\0\u{1}no model").expect("written");
    let data = shared.data();
    for (file, words) in [
        (&cut, &["cut.ply", "at byte"][..]),
        (&points, &["points.ply", "not a 3D Gaussian model"]),
        (&other, &["other.ply"]),
        (&folder.path().join("none.ply"), &["none.ply", "cannot open"]),
    ] {
        fails(&["eval", text(file), text(&data)], 3, words);
        fails(&["render", text(file), "--cameras", text(&data)], 3, words);
    }
    let taken = folder.path().join("taken");
    fs::write(&taken, "").expect("written");
    let model = shared.model();
    let args = ["render", text(&model), "--cameras", text(&data), "--out"];
    fails(&[&args[..], &[text(&taken.join("x"))]].concat(), 8, &["cannot write"]);
}

#[test]
fn too_little_device_memory_has_its_code() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (data, out) = (shared.data(), folder.path().join("run"));
    let args = [&train(&data, &out)[..], &["--max-device-memory", "100K"]].concat();
    let output = psrgs(&args);
    assert_eq!(output.status.code(), Some(5), "{}", stderr(&output));
    assert!(stderr(&output).contains("out of device memory") && stderr(&output).contains("--max-side"));
    // The environment variable has the form of the option.
    let limited = command(&train(&data, &out)).env("PSRGS_MAX_DEVICE_MEMORY", "100KiB").output().expect("a process");
    assert_eq!(limited.status.code(), Some(5), "{}", stderr(&limited));
}

#[test]
fn masks_are_counted_and_a_wholly_masked_photograph_is_left_out() {
    let Some(shared) = shared() else { return };
    let data = copy_of(&shared.data());
    let masks = data.path().join("masks");
    fs::create_dir_all(&masks).expect("a folder");
    image::GrayImage::new(64, 48).save(masks.join("view_0001.jpg.png")).expect("a mask");
    let half = image::GrayImage::from_fn(64, 48, |x, _| image::Luma([if x < 32 { 255 } else { 0 }]));
    half.save(masks.join("view_0002.png")).expect("a mask");
    let out = data.path().join("run");
    let said = works(&[&train(data.path(), &out)[..6], &["--overwrite"]].concat());
    assert!(said.contains("masks: 2 of 9"), "{said}");
    assert!(said.contains("'view_0001.jpg': every pixel is masked"), "{said}");
    let said = works(&[&train(data.path(), &out)[..6], &["--overwrite", "--mask-ignores", "white"]].concat());
    assert!(said.contains("masks: 2 of 9") && !said.contains("every pixel"), "{said}");
    let other = image::GrayImage::from_fn(64, 48, |x, _| image::Luma([if x < 16 { 255 } else { 0 }]));
    other.save(masks.join("view_0002.png")).expect("a mask");
    fails(&["train", "--resume", text(&out)], 3, &["view_0002.jpg", "its mask has changed"]);
    image::GrayImage::new(48, 48).save(masks.join("view_0002.png")).expect("a mask");
    let again = [&train(data.path(), &out)[..], &["--overwrite"]].concat();
    fails(&again, 3, &["view_0002.png", "the mask is 48x48"]);
}

#[test]
fn without_points_training_starts_from_random_ones_and_says_so() {
    let Some(shared) = shared() else { return };
    let data = copy_of(&shared.data());
    fs::remove_file(data.path().join("sparse/0/points3D.bin")).expect("removed");
    let said = works(&train(data.path(), &data.path().join("run"))[..6]);
    assert!(said.contains("random points") && said.contains("lower quality"), "{said}");
    // The message names the format, and says that the preset follows from the CPU device.
    assert!(said.contains(": colmap dataset, 7 photographs to train on, 2 held out"), "{said}");
    assert_eq!(
        said.contains("preset quick, because this is a CPU device: 640 px, 3 steps"),
        said.contains("(CPU)"),
        "{said}"
    );
    // Commands that do not train do not say how a training would begin.
    let (model, depths) = (shared.model(), data.path().join("depths"));
    for args in [&["eval", text(&model), text(data.path())][..], &["stereo", text(data.path()), "--out", text(&depths)]]
    {
        let said = works(args);
        assert!(!said.contains("--init") && !said.contains("random points"), "{args:?}: {said}");
    }
}

#[test]
fn a_dataset_is_checked_before_it_is_trained() {
    let Some(shared) = shared() else { return };
    let data = copy_of(&shared.data());
    let checked = |code: i32| {
        let output = psrgs(&["check", text(data.path()), "--json"]);
        assert_eq!(output.status.code(), Some(code), "{}", stderr(&output));
        serde_json::from_slice::<serde_json::Value>(&output.stdout).expect("JSON")
    };
    let found = checked(0);
    assert_eq!((&found["format"], &found["photographs"], &found["held_out"]), (&"colmap".into(), &9.into(), &2.into()));
    assert_eq!(found["cameras"][0]["size"], serde_json::json!([64, 48]));
    let overlap = found["overlap"].as_f64().expect("a number");
    assert!((0.3..=1.0).contains(&overlap) && found["extent"].as_f64().expect("a number") > 0.0, "{found}");
    assert_eq!(found["photograph_bytes"], 7 * 4 * 64 * 48);
    let training = &found["training"];
    assert!(training["device_bytes"].as_u64() > Some(7 * 4 * 64 * 48), "{training}");
    assert_eq!((&training["host_short_by"], &training["photographs"]), (&0.into(), &"Resident".into()), "{training}");
    // The steps of the preset with a time estimate, in JSON and in words.
    let estimate = &training["estimate"];
    assert_eq!(estimate["steps"], found["iterations"]);
    assert!(estimate["seconds_per_step"].as_f64().is_some_and(|s| s > 0.0 && s.is_finite()), "{estimate}");
    let output = psrgs(&["check", text(data.path()), "--preset", "standard", "--iterations", "70", "-q"]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    for row in ["preset        standard, 70 steps", "device memory ", "host memory   of the ", "time          about "] {
        assert!(said.contains(row), "{row}: {said}");
    }
    // Of the default method, which also begins with splats of stereo.
    assert!(said.contains("method        psrgs\n"), "{said}");
    let output = psrgs(&["check", text(data.path()), "--method", "3dgs", "--json"]);
    let plain: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!((&found["method"], &plain["method"]), (&"psrgs".into(), &"3dgs".into()));
    let splats = |of: &serde_json::Value| of["training"]["estimate"]["splats"].as_u64().expect("a number");
    assert!(splats(&found) > splats(&plain), "{} of {}", splats(&found), splats(&plain));
    assert!(found["training"]["device_bytes"].as_u64() > plain["training"]["device_bytes"].as_u64());
    let output = psrgs(&["check", text(data.path()), "--max-splats", "1000", "--json"]);
    let limited: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(splats(&limited), 1000);
    assert!(limited["training"]["device_bytes"].as_u64() < found["training"]["device_bytes"].as_u64());
    // Too little memory is reported as a problem before training.
    let output = psrgs(&["check", text(data.path()), "--host-memory", "1M", "--json"]);
    assert_eq!(output.status.code(), Some(5), "{}", stderr(&output));
    let tight: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert!(tight["problems"][0].as_str().is_some_and(|p| p.contains("out of host memory")), "{tight}");
    // A photograph without a pose, then a pose that looks away, then a pose without a photograph.
    fs::copy(data.path().join("images/view_0001.jpg"), data.path().join("images/extra.jpg")).expect("copied");
    let problems = checked(7)["problems"].clone();
    assert!(problems[0].as_str().expect("text").contains("1 photograph has no pose"), "{problems}");
    fs::remove_file(data.path().join("images/extra.jpg")).expect("removed");
    let file = data.path().join("sparse/0/images.bin");
    let whole = fs::read(&file).expect("images");
    let mut bytes = whole.clone();
    // Number of images (8 bytes), the first image's number (4), then its quaternion:
    // half a turn about the camera's x axis.
    let q: Vec<f64> =
        (0..4).map(|k| f64::from_le_bytes(bytes[12 + 8 * k..20 + 8 * k].try_into().expect("8"))).collect();
    for (k, v) in [-q[1], q[0], -q[3], q[2]].iter().enumerate() {
        bytes[12 + 8 * k..20 + 8 * k].copy_from_slice(&v.to_le_bytes());
    }
    // Negated y and z of the translation: the camera keeps its centre.
    for at in [52, 60] {
        bytes[at + 7] ^= 0x80;
    }
    fs::write(&file, &bytes).expect("written");
    let problems = checked(7)["problems"].clone();
    assert!(problems[0].as_str().expect("text").contains("the pose of 'view_0000.jpg' is wrong"), "{problems}");
    fs::write(&file, &whole).expect("written");
    fs::remove_file(data.path().join("images/view_0003.jpg")).expect("removed");
    fails(&["check", text(data.path())], 3, &["1 of 9 photographs is missing", "view_0003.jpg"]);
}

/// `check` reports what `train` refuses to begin with.
#[test]
fn photographs_that_nothing_can_be_trained_on_are_told_by_check() {
    let Some(shared) = shared() else { return };
    let data = copy_of(&shared.data());
    let photograph = data.path().join("images/view_0005.jpg");
    let whole = fs::read(&photograph).expect("read");
    fs::write(&photograph, &whole[..whole.len() / 2]).expect("written");
    fails(&["check", text(data.path())], 3, &["view_0005.jpg", "the file ends before the picture does"]);
    fs::write(&photograph, whole).expect("written");
    let masks = data.path().join("masks");
    fs::create_dir_all(&masks).expect("a folder");
    for k in 0..9 {
        image::GrayImage::new(64, 48).save(masks.join(format!("view_{k:04}.jpg.png"))).expect("a mask");
    }
    let out = data.path().join("run");
    for args in [&["check", text(data.path())][..], &train(data.path(), &out)] {
        fails(args, 3, &["every photograph to train on is masked all over", "--mask-ignores"]);
    } // No photograph would be scored: an error in place of an empty table.
    let model = shared.run().join("point_cloud.ply");
    fails(
        &["eval", text(&model), text(data.path())],
        3,
        &["every held-out photograph is masked all over", "--mask-ignores"],
    );
}

/// A picture whose header claims more pixels than memory holds.
#[test]
fn a_picture_beyond_the_memory_ends_no_process() {
    let Some(shared) = shared() else { return };
    let data = copy_of(&shared.data());
    let photograph = data.path().join("images/view_0005.jpg");
    let mut bytes = fs::read(&photograph).expect("read");
    let frame = bytes.windows(2).position(|w| w == [0xff, 0xc0]).expect("a frame");
    bytes[frame + 5..frame + 9].copy_from_slice(&[0xea, 0x60, 0xea, 0x60]);
    bytes.resize(3_400_000, 0);
    fs::write(&photograph, bytes).expect("written");
    let (out, model) = (data.path().join("run"), shared.model());
    for args in [
        &["check", text(data.path())][..],
        &["train", text(data.path()), "--out", text(&out)],
        &["stereo", text(data.path()), "--out", text(&out)],
        &["eval", text(&model), text(data.path())],
    ] {
        let args = [args, &["--host-memory", "1GiB"]].concat();
        fails(&args, 5, &["view_0005.jpg", "60000x60000", "1.00 GiB may be used", "--host-memory"]);
    }
    fails(&["saliency", text(data.path()), "--out", text(&out)], 3, &["view_0005.jpg"]);
    fails(&["saliency", text(&photograph), "--out", text(&out)], 3, &["view_0005.jpg"]);
}

/// Files of other formats, and answers of servers, in place of a model.
#[test]
fn a_model_of_another_format_is_told_as_what_it_is() {
    let root = tempfile::tempdir().expect("a temporary folder");
    for (name, bytes, words) in [
        ("x.spz", &b"\x1f\x8b\x08\0"[..], ["gzip stream at byte 0", "export the file again"]),
        ("y.spz", b"NGSP\x04\0\0\0", ["header at byte 8", "export the file again"]),
        ("x.sog", b"PK\x03\x04", ["zip archive at byte 0", "export the file again"]),
        ("meta.json", b"{\"version\": 1}", ["version of meta.json", "version 2"]),
        ("x.splat", &[7; 65], ["length at byte 64", "export the file again"]),
        ("x.glb", b"glTF\x01\0\0\0", ["magic at byte 0", "convert the file"]),
        ("x.ksplat", &[7; 64], ["format KSPLAT", "convert it to a PLY"]),
        ("y.zip", b"PK\x03\x04", ["a ZIP archive", "unpack it"]),
        ("lfs.splat", b"version https://git-lfs.github.com/spec/v1\n", ["Git LFS", "git lfs pull"]),
        ("lfs.ply", b"version https://git-lfs.github.com/spec/v1\n", ["Git LFS", "git lfs pull"]),
        ("page.ply", b"\n<!doctype HTML>\n<p>gone", ["web page", "download"]),
        ("empty.ply", b"", ["empty", "again"]),
        ("a.jpg", b"\xff\xd8\xff\xe0", ["JPEG", "magic at byte 0"]),
    ] {
        let model = root.path().join(name);
        fs::write(&model, bytes).expect("written");
        let cameras = root.path().join("none");
        fails(&["render", text(&model), "--cameras", text(&cameras)], 3, &[name, words[0], words[1]]);
    }
}

/// Position of an image's translation in `images.bin`.
fn translation_of(name: &str, images: &[u8]) -> usize {
    let number = |at: usize| u64::from_le_bytes(images[at..at + 8].try_into().expect("8 bytes")) as usize;
    let mut at = 8;
    for _ in 0..number(0) {
        // Number, quaternion, translation and camera come before the name, the keypoints after it.
        let end = at + 64 + images[at + 64..].iter().position(|byte| *byte == 0).expect("end of a name");
        if &images[at + 64..end] == name.as_bytes() {
            return at + 4 + 32;
        }
        at = end + 1 + 8 + 24 * number(end + 1);
    }
    panic!("no {name}");
}

#[test]
fn a_photograph_with_a_wrong_pose_is_left_out_named_and_listed() {
    let Some(shared) = shared() else { return };
    let data = copy_of(&shared.data());
    let data = data.path();
    let file = data.join("sparse/0/images.bin");
    let mut images = fs::read(&file).expect("images");
    let at = translation_of("view_0003.jpg", &images);
    images[at..at + 8].copy_from_slice(&700_f64.to_le_bytes());
    fs::write(&file, images).expect("written");
    let line = "'view_0003.jpg' is left out of training, as its pose is wrong";

    let checked = psrgs(&["check", text(data), "--max-side", "48"]);
    let told = String::from_utf8_lossy(&checked.stdout).into_owned();
    assert_eq!(checked.status.code(), Some(7), "{told}");
    assert_eq!(told.matches(line).count(), 1, "{told}");
    assert!(told.contains("9: 6 to train on, 2 held out"), "{told}");

    let out = tempfile::tempdir().expect("temporary folder");
    let out = out.path().join("out");
    let told = works(&["train", text(data), "--out", text(&out), "--iterations", "14", "--max-side", "48"]);
    assert!(told.contains(line), "{told}");
    let json: serde_json::Value =
        serde_json::from_slice(&fs::read(out.join("metrics.json")).expect("metrics")).expect("JSON");
    let listed = json["training_photographs"].as_array().expect("a list");
    assert_eq!(listed.len(), 7, "{listed:?}");
    let losses: Vec<f64> = listed.iter().filter_map(|p| p["loss"].as_f64()).collect();
    assert_eq!(losses.len(), 6, "{listed:?}");
    assert!(losses.windows(2).all(|pair| pair[0] >= pair[1]), "{losses:?}");
    let left_out: Vec<_> = listed.iter().filter(|p| p["left_out"].is_string()).map(|p| &p["name"]).collect();
    assert_eq!(left_out, ["view_0003.jpg"]);
    let report = fs::read_to_string(out.join("report.html")).expect("report");
    assert!(report.contains("Each photograph trained on") && report.contains("left out: wrong pose"), "{report}");
}

#[test]
fn an_error_of_check_is_said_once() {
    let Some(shared) = shared() else { return };
    let data = copy_of(&shared.data());
    fs::write(data.path().join("images/view_0001.jpg"), "no picture").expect("written");
    let output = psrgs(&["check", text(data.path())]);
    assert!(!output.status.success());
    let said = String::from_utf8_lossy(&output.stdout).into_owned() + &stderr(&output);
    let error = said.lines().find_map(|line| line.split_once("view_0001.jpg").map(|(_, error)| error));
    let error = error.unwrap_or_else(|| panic!("no line names the file: {said}"));
    assert!(error.len() > 10, "the error has no reason: {said}");
    assert_eq!(said.matches(error).count(), 1, "{said}");
}
