//! Photographs, masks, clouds and maps whose names differ a little from the names in the model.

use std::fs;
use std::path::Path;

use image::{GrayImage, Luma};
use psrgs_vk::dataset::{Dataset, Error, LoadOptions, Warning};
use serde_json::json;

use crate::colmap_folder::{Folder, write_photograph};
use crate::formats::{cloud, nerfstudio, reconstruction, transforms, write_json};
use crate::{NAMES, load};

/// Warnings about names that differ: kind, count, and the whole message.
fn told(dataset: &Dataset) -> Vec<(&'static str, usize, String)> {
    let of = |warning: &Warning| match warning {
        Warning::OtherNames { what, renamed, .. } => Some((*what, renamed.count(), warning.to_string())),
        _ => None,
    };
    dataset.warnings.iter().filter_map(of).collect()
}

/// One dataset in three formats, with `names` in its model and photographs under `files` (relative to `images`).
fn of_each_format(names: &[&str], files: &[&str]) -> Vec<(&'static str, tempfile::TempDir)> {
    let mut folder = Folder::ring(names, [0.0; 3]);
    let fresh = || {
        let root = tempfile::tempdir().expect("temporary folder");
        for (i, file) in files.iter().enumerate() {
            write_photograph(&root.path().join("images").join(file), 24, 16, i as u8);
        }
        root
    };
    let [binary, text, nerf, sfm] = [0; 4].map(|_| fresh());
    folder.write(binary.path(), &folder.binary());
    folder.write(text.path(), &folder.text());
    write_json(&sfm.path().join("reconstruction.json"), &reconstruction(&folder));
    fs::write(nerf.path().join("sparse_pc.ply"), cloud(&folder, false)).expect("points");
    for image in folder.images.iter_mut().filter(|image| !image.name.starts_with(['/', '.'])) {
        image.name = format!("images/{}", image.name);
    }
    let mut value = transforms(&folder);
    for (frame, image) in value["frames"].as_array_mut().expect("frames").iter_mut().zip(&folder.images) {
        frame["file_path"] = json!(image.name);
    }
    write_json(&nerf.path().join("transforms.json"), &value);
    vec![("binary", binary), ("text", text), ("nerfstudio", nerf), ("opensfm", sfm)]
}

fn tints(dataset: &Dataset) -> Vec<u8> {
    dataset.views.iter().map(|view| view.photograph().expect("decodes").rgba8()[0]).collect()
}

#[test]
fn photographs_under_similar_names_are_found_in_every_format() {
    for (names, files, words) in [
        (
            ["a.png", "b.png", "c.png"],
            ["A.png", "b.PNG", "c.png"],
            "2 of 3 photographs have other names than the model says and were found all the same: 2 by letter case",
        ),
        (["a.jpg", "b.jpeg", "c.png"], ["a.png", "b.png", "c.png"], "2 by extension"),
        (["x\\a.png", "x\\b.png", "x\\c.png"], ["x/a.png", "x/b.png", "x/c.png"], "3 by separators"),
        (["old/a.png", "old/b.png", "old/c.png"], ["a.png", "b.png", "c.png"], "3 by folders before the name"),
        (["a.png", "b.png", "c.png"], ["x/a.png", "x/b.png", "y/c.png"], "3 by folders before the name"),
        (["\u{e4}.png", "o\u{308}.png", "u.png"], ["a\u{308}.png", "\u{f6}.png", "u.png"], "2 by Unicode form"),
        (
            ["/home/me/a.png", "/home/me/b.png", "/home/me/c.png"],
            ["a.png", "b.png", "c.png"],
            "3 by a path that leads out of the dataset",
        ),
        (
            ["../other/a.png", "../other/b.png", "../other/c.png"],
            ["x/a.png", "x/b.png", "x/c.png"],
            "leads out of the dataset",
        ),
    ] {
        for (format, root) in of_each_format(&names, &files) {
            let dataset = load(root.path()).unwrap_or_else(|error| panic!("{format}, {names:?}: {error}"));
            let told = told(&dataset);
            // nerfstudio's names have a folder, which is not always part of the name.
            assert_eq!(told.len(), 1, "{format}, {names:?}: {told:?}");
            assert!(told[0].2.contains(words), "{format}: {}", told[0].2);
            let mut sorted = tints(&dataset);
            sorted.sort_unstable();
            assert_eq!(sorted, [0, 1, 2], "{format}, {names:?}");
            assert_eq!(dataset.warnings.len(), 1, "{format}: {:?}", dataset.warnings);
            for view in &dataset.views {
                let inside = Path::new(&view.name).components().all(|c| matches!(c, std::path::Component::Normal(_)));
                assert!(inside, "results are named after '{}'", view.name);
                assert!(view.path.starts_with(root.path()), "{}", view.path.display());
            }
        }
    }
}

#[test]
fn a_photograph_is_matched_with_its_own_pose() {
    let mut folder = Folder::ring(&["A.JPG", "b.jpg", "sub/c.jpg"], [0.0; 3]);
    let root = folder.dataset(false);
    let before = load(root.path()).expect("loads");
    folder.images.iter_mut().for_each(|image| image.name = format!("photos/{}", image.name.to_lowercase()));
    folder.write(root.path(), &folder.binary());
    let after = load(root.path()).expect("loads");
    assert_eq!(before.tracks, after.tracks);
    for (a, b) in before.views.iter().zip(&after.views) {
        assert_eq!((&a.path, &a.camera, a.role), (&b.path, &b.camera, b.role));
    }
}

#[test]
fn a_name_that_several_files_could_be_is_refused_with_them() {
    let root = Folder::ring(&NAMES, [0.0; 3]).dataset(false);
    let images = root.path().join("images");
    fs::remove_file(images.join("b.png")).expect("removed");
    write_photograph(&images.join("x/b.png"), 24, 16, 7);
    write_photograph(&images.join("y/b.png"), 24, 16, 8);
    let error = load(root.path()).expect_err("unclear").to_string();
    assert!(error.contains("'x/b.png' and 'y/b.png' are there, and it could be any of them"), "{error}");
    // A file that another pose names is no candidate.
    fs::remove_dir_all(images.join("x")).expect("removed");
    fs::remove_dir_all(images.join("y")).expect("removed");
    let mut folder = Folder::ring(&NAMES, [0.0; 3]);
    folder.images[1].name = "c.jpg".to_owned();
    folder.write(root.path(), &folder.binary());
    let error = load(root.path()).expect_err("taken").to_string();
    assert!(error.contains("'c.jpg'"), "{error}");
    // The folders of a rig hold equal file names.
    let rig = Folder::ring(&["left/1.png", "right/1.png"], [0.0; 3]);
    let root = rig.dataset(false);
    fs::remove_file(root.path().join("images/left/1.png")).expect("removed");
    let error = load(root.path()).expect_err("another camera").to_string();
    assert!(error.contains("1 of 2") && error.contains("left/1.png"), "{error}");
}

#[test]
fn a_name_that_is_not_there_is_told_with_the_nearest() {
    let root = Folder::ring(&["IMG_0001.png", "IMG_0002.png"], [0.0; 3]).dataset(false);
    let images = root.path().join("images");
    fs::rename(images.join("IMG_0002.png"), images.join("IMG_002.png")).expect("renamed");
    fs::write(images.join("._IMG_0002.png"), "left by macOS").expect("written");
    let error = load(root.path()).expect_err("missing").to_string();
    assert!(error.contains("'IMG_0002.png'; the nearest name that is there is 'IMG_002.png'"), "{error}");
}

#[test]
fn hidden_files_are_no_photographs() {
    let root = Folder::ring(&NAMES, [0.0; 3]).dataset(false);
    for name in ["._a.png", ".DS_Store", ".thumbnails/a.png", "._d.jpg"] {
        let file = root.path().join("images").join(name);
        fs::create_dir_all(file.parent().expect("parent")).expect("folder");
        fs::write(file, "no picture").expect("written");
    }
    let dataset = load(root.path()).expect("loads");
    assert!(dataset.warnings.is_empty(), "{:?}", dataset.warnings);
}

#[test]
fn photographs_outside_of_the_dataset_are_never_read() {
    let elsewhere = tempfile::tempdir().expect("temporary folder");
    write_photograph(&elsewhere.path().join("a.png"), 24, 16, 9);
    let path = elsewhere.path().join("a.png");
    let up = format!("../../{}/a.png", elsewhere.path().file_name().expect("name").to_string_lossy());
    for name in [path.to_str().expect("text"), up.as_str()] {
        for (format, root) in of_each_format(&[name, "b.png"], &["b.png", "c.png"]) {
            let error = load(root.path()).expect_err("outside").to_string();
            assert!(error.contains("leads out of the folder of photographs and is not followed"), "{format}: {error}");
            // Where only poses are needed, the names of results stay inside the folder.
            let poses = Dataset::load(root.path(), &LoadOptions { photographs: false, ..LoadOptions::default() });
            let poses = poses.expect("poses");
            assert!(
                poses.views.iter().all(|view| !view.name.starts_with('/') && !view.name.contains("..")),
                "{format}"
            );
        }
    }
}

/// Symbolic links in the dataset are followed.
#[cfg(unix)]
#[test]
fn linked_photographs_are_read() {
    use std::os::unix::fs::symlink;
    let root = Folder::ring(&NAMES, [0.0; 3]).dataset(false);
    let elsewhere = tempfile::tempdir().expect("temporary folder");
    let images = root.path().join("images");
    fs::rename(images.join("a.png"), elsewhere.path().join("1.png")).expect("moved");
    symlink(elsewhere.path().join("1.png"), images.join("a.png")).expect("linked");
    assert!(load(root.path()).expect("loads").warnings.is_empty());
    fs::rename(&images, elsewhere.path().join("all")).expect("moved");
    symlink(elsewhere.path().join("all"), &images).expect("linked");
    assert!(load(root.path()).expect("loads").warnings.is_empty());
}

#[test]
fn paths_of_masks_and_points_stay_inside_of_the_dataset() {
    let folder = Folder::ring(&NAMES, [0.0; 3]);
    let elsewhere = tempfile::tempdir().expect("temporary folder");
    let (mask, points) = (elsewhere.path().join("m.png"), elsewhere.path().join("p.ply"));
    GrayImage::from_pixel(24, 16, Luma([0])).save(&mask).expect("mask");
    fs::write(&points, cloud(&folder, false)).expect("points");
    let set = |root: &Path, mask: &str, points: &str| {
        let mut value = transforms(&folder);
        value["frames"][0]["mask_path"] = json!(mask);
        value["ply_file_path"] = json!(points);
        write_json(&root.join("transforms.json"), &value);
    };
    let root = nerfstudio(&folder, false);
    let up = |file: &Path| {
        let folder = elsewhere.path().file_name().expect("name").to_string_lossy().into_owned();
        format!("../{folder}/{}", file.file_name().expect("name").to_string_lossy())
    };
    for (mask, points) in
        [(mask.to_str().expect("text").to_owned(), points.to_str().expect("text").to_owned()), (up(&mask), up(&points))]
    {
        set(root.path(), "images/../masks/m.png", &points);
        let error = load(root.path()).expect_err("points outside").to_string();
        assert!(
            error.contains("transforms.json: ply_file_path") && error.contains("leads out of the dataset"),
            "{error}"
        );
        set(root.path(), &mask, "sparse_pc.ply");
        let error = load(root.path()).expect_err("a mask outside").to_string();
        assert!(error.contains("mask_path of frame 'a.png'") && error.contains("leads out of the dataset"), "{error}");
        // Inside the dataset the last part of the path is enough, with a warning.
        GrayImage::from_fn(24, 16, |x, _| Luma([if x < 8 { 255 } else { 0 }]))
            .save(root.path().join("m.png"))
            .expect("mask");
        fs::write(root.path().join("p.ply"), cloud(&folder, true)).expect("points");
        set(root.path(), &mask, &points);
        let dataset = load(root.path()).expect("found inside");
        assert_eq!(dataset.views[0].mask.as_deref(), Some(root.path().join("m.png").as_path()));
        assert_eq!((dataset.points.len(), told(&dataset).len()), (12, 2), "{:?}", dataset.warnings);
        fs::remove_file(root.path().join("m.png")).expect("removed");
        fs::remove_file(root.path().join("p.ply")).expect("removed");
    }
}

#[test]
fn masks_and_maps_are_found_as_photographs_are() {
    let folder = Folder::ring(&["a.jpg", "b.jpg", "c.jpg"], [0.0; 3]);
    let root = folder.dataset(false);
    let masks = root.path().join("masks");
    fs::create_dir_all(masks.join("more")).expect("folder");
    for name in ["A.JPG.png", "B.PNG", "more/c.png", "._a.png"] {
        GrayImage::from_fn(24, 16, |x, _| Luma([if x < 8 { 255 } else { 0 }])).save(masks.join(name)).expect("mask");
    }
    let dataset = load(root.path()).expect("loads");
    let found: Vec<_> = dataset.views.iter().map(|view| view.mask.clone().expect("a mask")).collect();
    assert_eq!(found, ["A.JPG.png", "B.PNG", "more/c.png"].map(|name| masks.join(name)));
    let told = told(&dataset);
    assert_eq!((told.len(), told[0].0, told[0].1), (1, "masks", 3), "{told:?}");
}

#[test]
fn a_folder_that_is_nearly_that_of_masks_is_told() {
    for name in ["mask", "mask_images", "Masks", "segmentation", "images_mask"] {
        let root = Folder::ring(&NAMES, [0.0; 3]).dataset(false);
        write_photograph(&root.path().join(name).join("a.png"), 24, 16, 0);
        let dataset = load(root.path()).expect("loads");
        assert_eq!(dataset.warnings, [Warning::UnreadMasks { folder: name.to_owned() }]);
        fs::rename(root.path().join(name), root.path().join("masks")).expect("renamed");
        assert!(load(root.path()).expect("loads").warnings.is_empty());
    }
    // A folder without pictures is no folder of masks.
    let root = Folder::ring(&NAMES, [0.0; 3]).dataset(false);
    fs::create_dir_all(root.path().join("mask")).expect("folder");
    assert!(load(root.path()).expect("loads").warnings.is_empty());
}

#[test]
fn reduced_copies_and_maps_do_not_stand_in_for_photographs() {
    // Without the usual folder, the whole dataset is searched.
    let folder = Folder::ring(&NAMES, [0.0; 3]);
    let root = nerfstudio(&folder, false);
    let mut value = transforms(&folder);
    for (i, frame) in value["frames"].as_array_mut().expect("frames").iter_mut().enumerate() {
        frame["file_path"] = json!(format!("C:\\work\\{}", NAMES[i]));
    }
    write_json(&root.path().join("transforms.json"), &value);
    for other in ["images_2", "masks", "depth"] {
        folder.write_photographs(&root.path().join(other));
    }
    let dataset = load(root.path()).expect("loads");
    for (view, name) in dataset.views.iter().zip(NAMES) {
        assert_eq!(view.path, root.path().join("images").join(name));
    }
    let error = |error: Error| error.to_string();
    fs::remove_dir_all(root.path().join("images")).expect("removed");
    let said = error(load(root.path()).expect_err("no photographs"));
    assert!(said.contains("3 of 3 photographs are missing"), "{said}");
}
