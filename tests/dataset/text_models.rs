//! Text models as written by other programs, by editors of all systems, and by hand.

use std::fs;
use std::path::Path;

use psrgs_vk::dataset::lens::Distortion;
use psrgs_vk::dataset::{Dataset, LoadOptions, Warning};
use psrgs_vk::format::{FrameFile, ply, read_transform};
use psrgs_vk::scene::Frame;
use psrgs_vk::train::Settings;

use crate::colmap_folder::Folder;
use crate::formats::{cloud, nerfstudio, opensfm, reconstruction, transforms, turned_ring, write_json};
use crate::{load, without_photographs};

/// Usual names of photographs, some of three words.
const NAMES: [&str; 12] = [
    "my photo 01.png",
    "my photo 02.png",
    "my photo 03.png",
    "04.png",
    "05.png",
    "a b.png",
    "07.png",
    "x 8 9.png",
    "09.png",
    "10.png",
    "11.png",
    "12 12 12.png",
];

fn poses(root: &Path) -> Result<Dataset, String> {
    Dataset::load(root, &without_photographs()).map_err(|e| e.to_string())
}

/// Changes the text of a file of the model.
fn rewrite(root: &Path, name: &str, change: impl Fn(&str) -> String) {
    let file = root.join("sparse/0").join(name);
    let text = fs::read_to_string(&file).expect("text");
    fs::write(&file, change(&text)).expect("written");
}

#[test]
fn poses_without_second_lines_are_all_read_whatever_their_names() {
    let folder = Folder::ring(&NAMES, [0.0; 3]);
    let whole = poses(folder.dataset(true).path()).expect("loads");
    assert_eq!(whole.views.len(), NAMES.len());
    let is_pose = |line: &&str| line.starts_with('#') || line.ends_with(".png");
    let without_keypoints =
        |text: &str| text.lines().filter(is_pose).map(|line| format!("{line}\n")).collect::<String>();
    type Change = fn(&str) -> String;
    let also: [(&str, Change); 3] = [
        ("no second lines", |text| text.to_owned()),
        ("empty lines between them", |text| text.replace('\n', "\n\n")),
        ("no comments", |text| text.lines().filter(|l| !l.starts_with('#')).map(|l| format!("{l}\n")).collect()),
    ];
    for (what, change) in also {
        let root = folder.dataset(true);
        rewrite(root.path(), "images.txt", |text| change(&without_keypoints(text)));
        let found = poses(root.path()).expect(what);
        assert_eq!(found.views, whole.views, "{what}");
        assert!(found.warnings.is_empty(), "{what}: {:?}", found.warnings);
    }
    // Some images have second lines, and an empty line is inserted.
    let root = folder.dataset(true);
    rewrite(root.path(), "images.txt", |text| {
        text.replacen("03.png\n", "03.png\n\n", 1).replacen("1.5 2.25 -1\n", "", 1)
    });
    assert_eq!(poses(root.path()).expect("loads").views, whole.views);
}

#[test]
fn a_line_that_could_be_a_pose_or_keypoints_is_refused() {
    let mut folder = Folder::ring(&["a.png", "12 34 56", "c.png"], [0.0; 3]);
    // All numbers are whole, as they may be in keypoints.
    folder.images[1].translation = [1.0, 2.0, 10.0];
    folder.images.iter_mut().for_each(|image| image.keypoints.clear());
    let root = tempfile::tempdir().expect("a folder");
    folder.write(root.path(), &folder.text());
    assert_eq!(poses(root.path()).expect("with second lines").views.len(), 3);
    rewrite(root.path(), "images.txt", |text| text.replace("\n\n", "\n"));
    let error = poses(root.path()).expect_err("ambiguous");
    assert!(error.contains("images.txt") && error.contains("line 4") && error.contains("could be the pose"), "{error}");
}

/// Equivalent spellings of a text file.
fn spellings(text: &[u8]) -> Vec<(&'static str, Vec<u8>)> {
    let text = std::str::from_utf8(text).expect("text");
    let utf16 = |mark: &[u8], unit: fn(u16) -> [u8; 2]| {
        mark.iter().copied().chain(text.encode_utf16().flat_map(unit)).collect::<Vec<u8>>()
    };
    vec![
        ("no last line end", text.trim_end().into()),
        ("CRLF", text.replace('\n', "\r\n").into()),
        ("CRLF without the last one", text.trim_end().replace('\n', "\r\n").into()),
        ("a byte order mark", format!("\u{feff}{text}").into()),
        ("a byte order mark and CRLF", format!("\u{feff}{}", text.replace('\n', "\r\n")).into()),
        ("UTF-16", utf16(b"\xff\xfe", u16::to_le_bytes)),
        ("UTF-16, big endian", utf16(b"\xfe\xff", u16::to_be_bytes)),
        ("empty lines at the end", format!("{text}\n\n \n").into()),
        ("empty lines at the beginning", format!("\n \n{text}").into()),
        ("blanks at the ends of lines", text.replace('\n', " \t \n").into()),
        ("blanks at the beginnings of lines", text.replace('\n', "\n  ").into()),
    ]
}

/// Further equivalent spellings where `#` begins a comment.
fn spellings_of_lines(text: &[u8]) -> Vec<(&'static str, Vec<u8>)> {
    let text = std::str::from_utf8(text).expect("text");
    let mut all = spellings(text.as_bytes());
    all.push(("comments at the end", format!("{text}# the end\n#\n").into()));
    all.push(("a comment without an end", format!("{text}# the end").into()));
    all.push(("comments between lines", text.replace('\n', "\n# more\n").into()));
    all.push(("empty lines between lines", text.replace('\n', "\n\n").into()));
    all.push(("tabs", text.replace("# ", "#").replace(' ', "\t").into()));
    all.push(("two blanks", text.replace(' ', "  ").into()));
    all
}

#[test]
fn text_models_mean_the_same_in_every_spelling() {
    let folder = Folder::ring(&["a.png", "b.png", "c.png", "d.png"], [1.0, 2.0, 3.0]);
    let root = folder.dataset(true);
    let whole = load(root.path()).expect("loads");
    for (name, bytes) in folder.text() {
        let file = root.path().join("sparse/0").join(name);
        for (what, text) in spellings_of_lines(&bytes) {
            fs::write(&file, text).expect("written");
            let found = load(root.path()).unwrap_or_else(|e| panic!("{name}, {what}: {e}"));
            assert_eq!((&found.views, &found.points), (&whole.views, &whole.points), "{name}, {what}");
            assert_eq!((&found.tracks, &found.warnings), (&whole.tracks, &whole.warnings), "{name}, {what}");
        }
        fs::write(&file, &bytes).expect("put back");
        if name != "images.txt" {
            // Names of images may contain `#`.
            let text = String::from_utf8(bytes.clone()).expect("text");
            let noted = text
                .lines()
                .map(|line| if line.starts_with('#') { format!("{line}\n") } else { format!("{line} # 1 2\n") });
            fs::write(&file, noted.collect::<String>()).expect("written");
            let found = load(root.path()).expect("comments behind the words");
            assert_eq!((found.views, found.points), (whole.views.clone(), whole.points.clone()), "{name}");
            fs::write(&file, bytes).expect("put back");
        }
    }
}

#[test]
fn json_models_mean_the_same_in_every_spelling() {
    let folder = turned_ring([0.0; 3]);
    for (root, name) in [
        (nerfstudio(&folder, true), "transforms.json"),
        (opensfm(&folder, "reconstruction.json"), "reconstruction.json"),
    ] {
        let (file, whole) = (root.path().join(name), load(root.path()).expect("loads"));
        for (what, text) in spellings(&fs::read(&file).expect("read")) {
            fs::write(&file, text).expect("written");
            let found = load(root.path()).unwrap_or_else(|e| panic!("{name}, {what}: {e}"));
            assert_eq!((found.views, found.points), (whole.views.clone(), whole.points.clone()), "{name}, {what}");
        }
    }
}

#[test]
fn clouds_and_models_as_text_mean_the_same_in_every_spelling() {
    let root = tempfile::tempdir().expect("a folder");
    let file = root.path().join("points.ply");
    let text = cloud(&turned_ring([0.0; 3]), true);
    fs::write(&file, &text).expect("written");
    let whole = ply::Cloud::read(&file).expect("a cloud");
    // A PLY header is 8-bit text and begins with `ply`.
    let fits = |what: &str| !what.starts_with("UTF-16") && what != "empty lines at the beginning";
    for (what, bytes) in spellings(&text).into_iter().filter(|(what, _)| fits(what)) {
        fs::write(&file, bytes).expect("written");
        let found = ply::Cloud::read(&file).unwrap_or_else(|e| panic!("{what}: {e}"));
        assert_eq!(found, whole, "{what}");
    }
    let between = String::from_utf8(text).expect("text").replace("end_header\n", "end_header\n\n");
    fs::write(&file, between.replace("\n-", "\n\n-")).expect("written");
    assert_eq!(ply::Cloud::read(&file).expect("empty lines between rows"), whole);
}

#[test]
fn readers_of_settings_and_frames_skip_byte_order_marks() {
    let root = tempfile::tempdir().expect("a folder");
    let with_mark = |name: &str, text: &str| {
        let file = root.path().join(name);
        fs::write(&file, format!("\u{feff}{text}")).expect("written");
        file
    };
    let frame = FrameFile::new(Frame::IDENTITY, None);
    frame.write(&root.path().join("frame.json")).expect("written");
    let text = fs::read_to_string(root.path().join("frame.json")).expect("text");
    assert_eq!(FrameFile::read(&with_mark("frame.json", &text)).expect("a frame"), frame);
    let rows = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]";
    read_transform(&with_mark("transform.json", rows)).expect("a transform");
    let settings = Settings::default();
    let file = with_mark("settings.toml", &settings.to_toml().expect("text"));
    assert_eq!(Settings::read(&file).expect("settings"), settings);
    assert!(Settings::keys(&file).expect("keys").contains(&"iterations".to_owned()));
    let exposures = with_mark("exposures.json", r#"{"a.jpg": [[1,0,0,0],[0,1,0,0],[0,0,1,0]]}"#);
    assert_eq!(psrgs_vk::format::ExposureFile::read(&exposures).expect("exposures").photographs.len(), 1);
}

#[test]
fn a_comment_that_counts_wrong_is_a_warning() {
    let folder = Folder::ring(&NAMES, [0.0; 3]);
    let whole = poses(folder.dataset(true).path()).expect("loads");
    for (name, what, found) in
        [("cameras.txt", "cameras", 1), ("images.txt", "images", 12), ("points3D.txt", "points", 12)]
    {
        for announced in [found + 40, found - 1] {
            let root = folder.dataset(true);
            let from = format!("Number of {what}: {found}");
            rewrite(root.path(), name, |text| text.replace(&from, &format!("Number of {what}: {announced}")));
            let dataset = poses(root.path()).expect(name);
            let file = root.path().join("sparse/0").join(name);
            assert_eq!(dataset.warnings, [Warning::CountDiffers { file: file.clone(), what, announced, found }]);
            assert_eq!((dataset.views, dataset.points), (whole.views.clone(), whole.points.clone()));
            // A file that also ends within a line was cut, unless almost nothing is missing.
            let text = fs::read_to_string(&file).expect("text");
            fs::write(&file, text.trim_end()).expect("written");
            assert_eq!(poses(root.path()).is_ok(), announced < found, "{name} announces {announced}");
            let strict = LoadOptions { strict: true, ..without_photographs() };
            fs::write(&file, text).expect("written");
            assert_eq!(Dataset::load(root.path(), &strict).is_ok(), announced < found, "{name} announces {announced}");
        }
    }
}

#[test]
fn whole_numbers_may_be_written_as_floating_point_ones() {
    let folder = turned_ring([0.0; 3]);
    let root = folder.dataset(true);
    let whole = load(root.path()).expect("loads");
    rewrite(root.path(), "cameras.txt", |text| text.replace("1 PINHOLE 24 16", "1.0 PINHOLE 24.0 1.6e1"));
    let float_words = |line: &str, wanted: &[usize]| -> String {
        let word =
            |(i, word): (usize, &str)| if wanted.contains(&i) { format!("{word}.0 ") } else { format!("{word} ") };
        line.split(' ').enumerate().map(word).collect::<String>().trim_end().to_owned() + "\n"
    };
    rewrite(root.path(), "images.txt", |text| {
        text.lines().map(|l| if l.ends_with(".png") { float_words(l, &[0, 8]) } else { format!("{l}\n") }).collect()
    });
    rewrite(root.path(), "points3D.txt", |text| {
        let line =
            |l: &str| if l.starts_with('#') { format!("{l}\n") } else { float_words(l, &[0, 4, 5, 6, 8, 9, 10, 11]) };
        text.lines().map(line).collect()
    });
    let found = load(root.path()).expect("loads");
    assert_eq!((found.views, found.points, found.tracks), (whole.views, whole.points, whole.tracks));

    let root = nerfstudio(&folder, true);
    let whole = load(root.path()).expect("loads");
    let mut value = transforms(&folder);
    (value["w"], value["h"]) = (24.0.into(), 16.0.into());
    write_json(&root.path().join("transforms.json"), &value);
    assert_eq!(load(root.path()).expect("loads").views, whole.views);
    let root = opensfm(&folder, "reconstruction.json");
    let whole = load(root.path()).expect("loads");
    let mut value = reconstruction(&folder);
    let camera = &mut value[0]["cameras"]["v2 dji 24 16 brown 0.85"];
    (camera["width"], camera["height"]) = (24.0.into(), 16.0.into());
    write_json(&root.path().join("reconstruction.json"), &value);
    assert_eq!(load(root.path()).expect("loads").views, whole.views);
    value[0]["cameras"]["v2 dji 24 16 brown 0.85"]["width"] = 24.5.into();
    write_json(&root.path().join("reconstruction.json"), &value);
    assert!(load(root.path()).expect_err("half a pixel").to_string().contains("width of camera"));
}

#[test]
fn camera_models_are_known_in_every_usual_spelling() {
    let folder = turned_ring([0.0; 3]);
    for name in ["pinhole", "Pinhole", "PERSPECTIVE", "perspective"] {
        let root = folder.dataset(true);
        rewrite(root.path(), "cameras.txt", |text| text.replace("PINHOLE", name));
        let found = load(root.path()).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!((found.views[0].camera.fx, found.views[0].model.as_str()), (20.5, "PINHOLE"));
    }
    let root = folder.dataset(true);
    rewrite(root.path(), "cameras.txt", |text| text.replace("PINHOLE 24 16 20.5 21.25", "Perspective 24 16 20.5"));
    assert_eq!(load(root.path()).expect("loads").views[0].model, "SIMPLE_PINHOLE");
    let root = folder.dataset(true);
    rewrite(root.path(), "cameras.txt", |text| {
        text.replace("PINHOLE", "opencv-fisheye").replace("8.75", "8.75 0 0 0 0.001")
    });
    assert_eq!(load(root.path()).expect("loads").views[0].model, "OPENCV_FISHEYE");

    let root = nerfstudio(&folder, true);
    let mut value = transforms(&folder);
    for (name, known, fisheye) in [
        ("opencv", "OPENCV", false),
        ("PERSPECTIVE", "OPENCV", false),
        ("perspective", "OPENCV", false),
        ("Simple Pinhole", "SIMPLE_PINHOLE", false),
        ("simple_radial", "SIMPLE_RADIAL", false),
        ("opencv_fisheye", "OPENCV_FISHEYE", true),
        ("FISHEYE", "OPENCV_FISHEYE", true),
    ] {
        value["camera_model"] = name.into();
        value["k1"] = 0.01.into();
        write_json(&root.path().join("transforms.json"), &value);
        let view = &load(root.path()).unwrap_or_else(|e| panic!("{name}: {e}")).views[0];
        assert_eq!(view.model, known, "{name}");
        let is_fisheye = matches!(view.lens.map(|lens| lens.distortion), Some(Distortion::Fisheye { .. }));
        assert_eq!(is_fisheye, fisheye, "{name}");
    }
    for name in ["EQUIRECTANGULAR", "equirectangular", "spherical"] {
        value["camera_model"] = name.into();
        write_json(&root.path().join("transforms.json"), &value);
        let error = load(root.path()).expect_err(name).to_string();
        assert!(error.contains(name) && error.contains("panorama"), "{error}");
    }

    let root = opensfm(&folder, "reconstruction.json");
    let mut value = reconstruction(&folder);
    for (name, known) in [("BROWN", true), ("Brown", true), ("spherical", false), ("equirectangular", false)] {
        value[0]["cameras"]["v2 dji 24 16 brown 0.85"]["projection_type"] = name.into();
        write_json(&root.path().join("reconstruction.json"), &value);
        match load(root.path()) {
            Ok(found) => assert!(known && found.views[0].model == "brown", "{name}"),
            Err(error) => assert!(!known && error.to_string().contains("panorama"), "{name}: {error}"),
        }
    }
}

#[test]
fn uniformly_scaled_rotations_are_read_and_others_are_named() {
    let folder = turned_ring([0.0; 3]);
    let root = nerfstudio(&folder, true);
    let file = root.path().join("transforms.json");
    let whole = load(root.path()).expect("loads");
    type Factor = fn(usize, usize) -> f64;
    let scaled = |factor: Factor| {
        let mut value = transforms(&folder);
        for frame in value["frames"].as_array_mut().expect("frames") {
            for (i, j) in (0..9).map(|k| (k / 3, k % 3)) {
                let entry = &mut frame["transform_matrix"][i][j];
                *entry = (entry.as_f64().expect("a number") * factor(i, j)).into();
            }
        }
        value
    };
    for factor in [(|_, _| 2.5) as Factor, |_, _| 0.01, |_, _| 1000.0] {
        write_json(&file, &scaled(factor));
        let found = load(root.path()).expect("loads");
        for (a, b) in found.views.iter().zip(&whole.views) {
            let values = |v: &psrgs_vk::dataset::View| v.camera.rotation.as_flattened().to_vec();
            assert!(values(a).iter().zip(values(b)).all(|(x, y)| (x - y).abs() < 1e-12), "{a:?}");
            let apart = a.camera.center().iter().zip(b.camera.center()).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
            assert!(apart < 1e-9, "{apart}");
        }
    }
    let stretched: Factor = |_, j| if j == 0 { 2.0 } else { 1.0 };
    let mirrored: Factor = |_, j| if j == 0 { -1.0 } else { 1.0 };
    for (factor, words) in [(stretched, "scaled apart"), (mirrored, "reflection")] {
        write_json(&file, &scaled(factor));
        let error = load(root.path()).expect_err(words).to_string();
        assert!(error.contains("transform_matrix of frame './images/a.png'") && error.contains(words), "{error}");
    }
    let mut value = transforms(&folder);
    value["frames"][0]["transform_matrix"][3] = serde_json::json!([1.0, 2.0, 10.0, 1.0]);
    write_json(&file, &value);
    let error = load(root.path()).expect_err("transposed").to_string();
    assert!(error.contains("may be transposed"), "{error}");
    // OpenSfM writes a vector; a matrix in its place may also have a scale.
    let root = opensfm(&folder, "reconstruction.json");
    let whole = load(root.path()).expect("loads");
    let mut value = reconstruction(&folder);
    for view in &whole.views {
        value[0]["shots"][&view.name]["rotation"] =
            serde_json::json!(view.camera.rotation.map(|row| row.map(|v| 3.0 * v)));
    }
    write_json(&root.path().join("reconstruction.json"), &value);
    for (a, b) in load(root.path()).expect("loads").views.iter().zip(&whole.views) {
        let pairs = a.camera.rotation.as_flattened().iter().zip(b.camera.rotation.as_flattened());
        assert!(pairs.into_iter().all(|(x, y)| (x - y).abs() < 1e-12));
    }
}
