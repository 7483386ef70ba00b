//! Reading COLMAP folders: values, errors, the split, the frame.

#[path = "../colmap_folder/mod.rs"]
mod colmap_folder;
#[path = "../common/mod.rs"]
mod common;
mod depths;
mod formats;
mod frame;
mod georeference;
mod lenses;
mod masks;
mod names;
mod pictures;
mod places;
mod points;
mod poses;
mod poses_by_photographs;
mod records;
mod split_lists;
mod supplies;
mod text_models;

use std::fs;
use std::path::Path;

use colmap_folder::{CameraRow, Folder, SIMPLE_PINHOLE, THIN_PRISM_FISHEYE, write_photograph};
use psrgs_vk::dataset::{Dataset, Error, LoadOptions, Photograph, Role, Split, Warning};

const NAMES: [&str; 3] = ["a.png", "b.png", "c.png"];

fn load(path: &Path) -> Result<Dataset, Error> {
    Dataset::load(path, &LoadOptions::default())
}

fn without_photographs() -> LoadOptions {
    LoadOptions { photographs: false, ..LoadOptions::default() }
}

#[test]
fn binary_and_text_give_the_same_dataset() {
    let mut folder = Folder::ring(&["x/b 2.png", "a.png", "c.png"], [3.0, -4.0, 5.0]);
    // There is no image 4.
    folder.points[11].track = vec![(1, 0), (2, 1), (3, 2), (4, 3)];
    let (binary, text) = (folder.dataset(false), folder.dataset(true));
    let (b, t) = (load(binary.path()).expect("binary"), load(text.path()).expect("text"));
    assert_eq!(b.points, t.points);
    assert_eq!(b.frame, t.frame);
    for (b, t) in b.views.iter().zip(&t.views) {
        assert_eq!((&b.name, &b.camera, b.role, b.size_on_disk), (&t.name, &t.camera, t.role, t.size_on_disk));
    }
    assert_eq!(b.views.iter().map(|v| v.name.as_str()).collect::<Vec<_>>(), ["a.png", "c.png", "x/b 2.png"]);
    let view = &b.views[0];
    assert_eq!((view.camera.fx, view.camera.fy, view.camera.cx, view.camera.cy), (20.5, 21.25, 11.125, 8.75));
    // "a.png" is the second camera of three on the ring.
    let angle = std::f64::consts::TAU / 3.0;
    let center = [3.0 + 2.0 * angle.cos(), -4.0 + 2.0 * angle.sin(), 15.0];
    for (got, want) in view.camera.center().iter().zip(center) {
        assert!((got - want).abs() < 1e-12);
    }
    assert_eq!(view.camera.rotation, [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]);
    assert_eq!(b.points.len(), 12);
    assert!(b.points.windows(2).all(|p| p[0].id < p[1].id), "points are in the order of their ids");
    assert_eq!((b.points[11].colour, b.points[11].track), ([0, 255, 128], 2));
    let unknown =
        |warning: &Warning| matches!(warning, Warning::UnknownObservers { points: 1, point: 89, image: 4, .. });
    assert!(matches!(b.warnings.as_slice(), [one] if unknown(one)), "{:?}", b.warnings);
    // Numbers of images follow the given order: 1 is "x/b 2.png", 2 "a.png", 3 "c.png". There is no image 4.
    assert_eq!(b.tracks, t.tracks);
    assert_eq!([11, 10, 9].map(|p| b.tracks.of(p)), [&[0, 2][..], &[0, 1, 2], &[0, 1, 2]]);
    assert_eq!(b.tracks.of(12), &[] as &[u32]);
}

#[test]
fn photographs_are_decoded_by_role_and_in_order() {
    let folder = Folder::ring(&NAMES, [0.0; 3]);
    let root = folder.dataset(false);
    // A test photograph is never decoded in training: decoding this one fails, as only its header is whole.
    let file = root.path().join("images/a.png");
    let bytes = fs::read(&file).expect("photograph");
    fs::write(&file, &bytes[..60]).expect("truncated");
    let dataset = load(root.path()).expect("loads");
    let train = dataset.photographs(Role::Train).expect("training photographs");
    assert_eq!(train.iter().map(|p| p.rgba8()[0]).collect::<Vec<_>>(), [1, 2]);
    assert_eq!((train[0].width, train[0].height, train[0].rgba8().len()), (24, 16, 24 * 16 * 4));
    assert_eq!(train[0].rgba8()[4 * (24 + 2)..][..4], [1, 18, 13, 255]);
    let error = dataset.photographs(Role::HeldOut).expect_err("truncated").to_string();
    assert!(error.contains("a.png: pixels at byte"), "{error}");
}

#[test]
fn max_side_reduces_the_photograph_and_its_camera() {
    let folder = Folder::ring(&NAMES, [0.0; 3]);
    let root = folder.dataset(false);
    let options = LoadOptions { max_side: Some(12), ..LoadOptions::default() };
    let dataset = Dataset::load(root.path(), &options).expect("loads");
    let camera = dataset.views[1].camera;
    assert_eq!((camera.width, camera.height), (12, 8));
    assert_eq!((camera.fx, camera.fy, camera.cx, camera.cy), (10.25, 10.625, 5.5625, 4.375));
    let photograph = dataset.views[1].photograph().expect("decodes");
    assert_eq!((photograph.width, photograph.height), (12, 8));
    // A linear ramp of slope 9 becomes a ramp of slope 18, with pixel centres between those of the original.
    for x in 2..10 {
        let green = f64::from(photograph.rgba8()[4 * (3 * 12 + x) + 1]);
        assert!((green - (18.0 * x as f64 + 4.5)).abs() <= 1.0, "{x}: {green}");
    }
    assert!(matches!(
        Dataset::load(root.path(), &LoadOptions { max_side: Some(0), ..LoadOptions::default() }),
        Err(Error::ZeroMaxSide)
    ));
}

#[test]
fn transparent_pixels_do_not_bleed_when_reduced() {
    let folder = Folder::ring(&NAMES, [0.0; 3]);
    let root = folder.dataset(false);
    let file = root.path().join("images/b.png");
    image::RgbaImage::from_fn(24, 16, |x, _| image::Rgba(if x % 2 == 0 { [200, 10, 10, 255] } else { [0, 255, 0, 0] }))
        .save(&file)
        .expect("photograph");
    let options = LoadOptions { max_side: Some(12), ..LoadOptions::default() };
    let photograph = Dataset::load(root.path(), &options).expect("loads").views[1].photograph().expect("decodes");
    for pixel in photograph.rgba8().chunks_exact(4) {
        assert!((100..156).contains(&pixel[3]), "{pixel:?}");
        assert!(pixel[0].abs_diff(200) <= 3 && pixel[1].abs_diff(10) <= 3, "{pixel:?}");
    }
}

#[test]
fn reduced_folders_are_chosen_by_option_and_by_size() {
    let folder = Folder::ring(&NAMES, [0.0; 3]);
    let root = folder.dataset(false);
    for name in NAMES {
        write_photograph(&root.path().join("images_2").join(name), 12, 8, 50);
        write_photograph(&root.path().join("images_3").join(name), 8, 5, 60);
    }
    let chosen = |options: LoadOptions| {
        let dataset = Dataset::load(root.path(), &options).expect("loads");
        let images = dataset.images.expect("photographs");
        (images.reduction, images.automatic, dataset.views[0].camera.width, dataset.views[0].camera.height)
    };
    assert_eq!(chosen(LoadOptions::default()), (1, true, 24, 16));
    assert_eq!(chosen(LoadOptions { max_side: Some(12), ..LoadOptions::default() }), (2, true, 12, 8));
    assert_eq!(chosen(LoadOptions { max_side: Some(13), ..LoadOptions::default() }), (1, true, 13, 9));
    let asked = |name: &str| LoadOptions { images_folder: Some(name.into()), ..LoadOptions::default() };
    assert_eq!(chosen(asked("images_3")), (3, false, 8, 5));
    assert!(matches!(Dataset::load(root.path(), &asked("images_9")), Err(Error::NoPhotographs { .. })));
    // An incomplete folder is not chosen.
    fs::remove_file(root.path().join("images_2/b.png")).expect("removed");
    assert_eq!(chosen(LoadOptions { max_side: Some(12), ..LoadOptions::default() }), (1, true, 12, 8));
}

#[test]
fn sizes_of_cameras_and_photographs_may_differ() {
    let mut folder = Folder::ring(&NAMES, [0.0; 3]);
    folder.cameras.push(CameraRow { id: 9, model: SIMPLE_PINHOLE, size: [30, 40], params: vec![33.0, 14.0, 21.0] });
    folder.images[2].camera = 9;
    let root = folder.dataset(true);
    write_photograph(&root.path().join("images/b.png"), 48, 32, 7);
    let dataset = load(root.path()).expect("loads");
    let sizes: Vec<_> = dataset.views.iter().map(|v| (v.camera.width, v.camera.height)).collect();
    assert_eq!(sizes, [(24, 16), (48, 32), (30, 40)]);
    assert_eq!((dataset.views[1].camera.fx, dataset.views[1].camera.cy), (41.0, 17.5));
    assert_eq!(
        (dataset.views[2].camera.fx, dataset.views[2].camera.fy, dataset.views[2].camera.cy),
        (33.0, 33.0, 21.0)
    );

    write_photograph(&root.path().join("images/b.png"), 24, 24, 7);
    let error = load(root.path()).expect_err("another aspect").to_string();
    assert!(error.contains("b.png") && error.contains("24x24") && error.contains("24x16"), "{error}");
    write_photograph(&root.path().join("images/b.png"), 16, 24, 7);
    let error = load(root.path()).expect_err("turned").to_string();
    assert!(error.contains("turned by 90 degrees"), "{error}");
}

#[test]
fn cameras_of_other_models_are_refused_with_the_remedy() {
    let mut folder = Folder::ring(&NAMES, [0.0; 3]);
    folder.cameras.push(CameraRow { id: 5, model: THIN_PRISM_FISHEYE, size: [24, 16], params: vec![20.0; 12] });
    for text in [false, true] {
        // A camera that no image uses does no harm.
        load(folder.dataset(text).path()).expect("loads");
    }
    folder.images[1].camera = 5;
    for text in [false, true] {
        let root = folder.dataset(text);
        let error = load(root.path()).expect_err("not known");
        assert!(matches!(error, Error::UnsupportedCamera { camera: 5, model: "THIN_PRISM_FISHEYE", .. }));
        let message = error.to_string();
        assert!(message.contains("cameras.") && message.contains("image_undistorter"), "{message}");
        assert!(message.contains("not supported (SIMPLE_PINHOLE,") && !message.contains("FOV"), "{message}");
    }
}

#[test]
fn missing_photographs_are_named() {
    let folder = Folder::ring(&NAMES, [0.0; 3]);
    let root = folder.dataset(false);
    fs::remove_file(root.path().join("images/c.png")).expect("removed");
    fs::remove_file(root.path().join("images/b.png")).expect("removed");
    let error = load(root.path()).expect_err("missing");
    assert!(
        matches!(&error, Error::MissingPhotographs { count: 2, total: 3, first, .. } if first == "b.png"),
        "{error}"
    );
    // Poses alone are enough where no photograph is needed.
    let dataset = Dataset::load(root.path(), &without_photographs()).expect("poses");
    assert_eq!((dataset.views.len(), dataset.views[2].camera.width), (3, 24));
    fs::remove_dir_all(root.path().join("images")).expect("removed");
    assert!(matches!(load(root.path()), Err(Error::NoPhotographs { .. })));
}

/// Folders without permission are an error, not empty folders.
#[cfg(unix)]
#[test]
fn folders_that_may_not_be_looked_into_are_not_taken_for_empty() {
    use std::os::unix::fs::PermissionsExt as _;
    let root = Folder::ring(&NAMES, [0.0; 3]).dataset(false);
    for folder in ["images", "sparse", "sparse/0", ""] {
        let closed = root.path().join(folder);
        let set = |mode: u32| fs::set_permissions(&closed, fs::Permissions::from_mode(mode)).expect("permissions");
        // Mode 600 allows listing, mode 0 does not. Neither allows entering.
        for mode in [0o600, 0] {
            set(mode);
            let (found, anyone) = (load(root.path()), fs::metadata(closed.join(".")).is_ok());
            set(0o755);
            if anyone {
                return common::left_out("this user may read every folder");
            }
            let error = found.expect_err("closed").to_string();
            assert!(error.contains("Permission denied") && error.contains(folder), "{folder} {mode:o}: {error}");
        }
    }
    load(root.path()).expect("open again");
}

#[test]
fn grey_photographs_are_read_and_foreign_files_are_refused() {
    let folder = Folder::ring(&NAMES, [0.0; 3]);
    let root = folder.dataset(false);
    let file = root.path().join("images/b.png");
    image::GrayImage::from_pixel(24, 16, image::Luma([77])).save(&file).expect("grey photograph");
    let grey = load(root.path()).expect("loads").views[1].photograph().expect("decodes");
    assert_eq!(grey.rgba8()[..4], [77, 77, 77, 255]);
    fs::write(&file, b"not a picture at all").expect("written");
    let error = load(root.path()).expect_err("foreign").to_string();
    assert!(error.contains("b.png: header at byte"), "{error}");
    for (bytes, words) in [
        (&b""[..], "the file is empty"),
        (b"GIF89a\x01\0\x01\0\0\0\0;", "GIF; JPEG, PNG, TIFF, WebP and OpenEXR are read"),
        (b"BM\x1e\0\0\0\0\0\0\0\x1a\0\0\0", "BMP; JPEG, PNG"),
        (b"not a picture at all", "no known format; JPEG, PNG"),
    ] {
        fs::write(&file, bytes).expect("written");
        for error in
            [load(root.path()).map(|_| ()).expect_err(words), Photograph::read(&file).map(|_| ()).expect_err(words)]
        {
            let error = error.to_string();
            assert!(error.contains("b.png: ") && error.contains(words), "{error}");
        }
    }
}

/// TIFF is common for surveys, WebP for pictures from the web.
#[test]
fn tiff_and_webp_photographs_are_those_they_were_made_of() {
    let names = ["a.png", "b.tif", "c.webp"];
    let root = Folder::ring(&names, [0.0; 3]).dataset(false);
    let picture = image::RgbImage::from_fn(24, 16, |x, y| image::Rgb([10 * x as u8, 15 * y as u8, (x * y) as u8]));
    for name in names {
        picture.save(root.path().join("images").join(name)).expect("photograph");
    }
    let dataset = load(root.path()).expect("loads");
    let [a, b, c] = [0, 1, 2].map(|k| dataset.views[k].photograph().expect("decodes"));
    assert_eq!(a.rgba8()[4 * 25..4 * 25 + 4], [10, 15, 1, 255]);
    assert!(a == b && a == c);
    let deep = image::ImageBuffer::from_fn(24, 16, |x, _| image::Rgb([2000 * x as u16, 7, 65535]));
    image::DynamicImage::ImageRgb16(deep).save(root.path().join("images/b.tif")).expect("photograph");
    let deep = load(root.path()).expect("loads").views[1].photograph().expect("decodes");
    assert!(matches!(&deep.pixels, psrgs_vk::dataset::Pixels::Rgba16(v) if v[4..8] == [2000, 7, 65535, 65535]));
}

#[test]
fn split_counts_names_sorted_bytewise() {
    // Bytewise: digits before capitals before small letters, "10" before "2", no natural order.
    let names = [
        "z.png",
        "IMG_2.png",
        "img_10.png",
        "img_2.png",
        "b/1.png",
        "a-b.png",
        "a.png",
        "a_b.png",
        "é.png",
        "0.png",
        "01.png",
        "1.png",
        "00.png",
        "IMG_10.png",
        "B.png",
        "aa.png",
        "A.png",
    ];
    let sorted = [
        "0.png",
        "00.png",
        "01.png",
        "1.png",
        "A.png",
        "B.png",
        "IMG_10.png",
        "IMG_2.png",
        "a-b.png",
        "a.png",
        "a_b.png",
        "aa.png",
        "b/1.png",
        "img_10.png",
        "img_2.png",
        "z.png",
        "é.png",
    ];
    let root = Folder::ring(&names, [0.0; 3]).dataset(false);
    let of = |split, role| {
        let dataset = Dataset::load(root.path(), &LoadOptions { split, ..LoadOptions::default() }).expect("loads");
        assert_eq!(dataset.views.iter().map(|v| v.name.as_str()).collect::<Vec<_>>(), sorted);
        dataset.views_of(role).map(|(_, v)| v.name.clone()).collect::<Vec<_>>()
    };
    assert_eq!(of(Split::Test, Role::HeldOut), ["0.png", "a-b.png", "é.png"]);
    assert_eq!(of(Split::Test, Role::Train).len(), 14);
    assert_eq!(of(Split::Val, Role::HeldOut), ["A.png", "b/1.png"]);
    assert_eq!(of(Split::Val, Role::Unused), ["0.png", "a-b.png", "é.png"]);
    assert_eq!(of(Split::Val, Role::Train).len(), 12);
    assert_eq!(of(Split::None, Role::Train).len(), 17);
}

#[test]
fn a_model_without_points_or_images_says_so() {
    let mut folder = Folder::ring(&NAMES, [0.0; 3]);
    let root = folder.dataset(false);
    fs::remove_file(root.path().join("sparse/0/points3D.bin")).expect("removed");
    let dataset = load(root.path()).expect("loads");
    assert!(dataset.points.is_empty() && dataset.warnings.contains(&Warning::NoPoints { file: None }));
    assert!(dataset.first_gaussians().expect_err("nothing to begin with").to_string().contains("`init`"));
    folder.images.clear();
    assert!(matches!(load(folder.dataset(false).path()), Err(Error::NoImages { .. })));
    let empty = tempfile::tempdir().expect("temporary folder");
    assert!(matches!(load(empty.path()), Err(Error::NoModel { .. })));
}

#[test]
fn names_that_repeat_or_leave_the_folder_are_refused() {
    let folder = Folder::ring(&["a.png", "b.png", "a.png"], [0.0; 3]);
    assert!(matches!(load(folder.dataset(false).path()), Err(Error::DuplicateName { name, .. }) if name == "a.png"));
    let mut folder = Folder::ring(&NAMES, [0.0; 3]);
    let root = folder.dataset(false);
    for name in ["../..", "/"] {
        folder.images[0].name = name.to_owned();
        folder.write(root.path(), &folder.binary());
        assert!(matches!(load(root.path()), Err(Error::NameOutside { .. })), "results could not be named after it");
    }
    folder.images[0].name = "../b.png".to_owned();
    folder.write(root.path(), &folder.binary());
    assert!(matches!(load(root.path()), Err(Error::NameOutside { .. })), "another photograph has the name");
}

#[test]
fn a_model_directly_in_sparse_is_found_and_binary_comes_first() {
    let folder = Folder::ring(&NAMES, [0.0; 3]);
    let root = folder.dataset(true);
    let mut other = folder.clone();
    other.points.truncate(5);
    other.write(root.path(), &other.binary());
    assert_eq!(load(root.path()).expect("loads").points.len(), 5);
    let sparse = root.path().join("sparse");
    for entry in fs::read_dir(sparse.join("0")).expect("folder") {
        let path = entry.expect("entry").path();
        fs::rename(&path, sparse.join(path.file_name().expect("name"))).expect("moved");
    }
    assert_eq!(load(root.path()).expect("loads").points.len(), 5);
}

#[test]
fn of_several_models_the_one_with_the_most_images_is_read() {
    let whole = Folder::ring(&NAMES, [0.0; 3]);
    let mut part = whole.clone();
    part.images.truncate(2);
    for text in [false, true] {
        let files = |folder: &Folder| if text { folder.text() } else { folder.binary() };
        let root = whole.dataset(text);
        let sparse = root.path().join("sparse");
        // A single model is read under any number.
        fs::rename(sparse.join("0"), sparse.join("10")).expect("moved");
        let alone = load(root.path()).expect("loads");
        assert_eq!((alone.views.len(), alone.warnings.as_slice()), (3, &[][..]));
        // The largest model is first neither by number nor by name.
        part.write(root.path(), &files(&part));
        fs::rename(sparse.join("0"), sparse.join("9")).expect("moved");
        part.write(root.path(), &files(&part));
        fs::create_dir_all(sparse.join("11")).expect("a folder without a model");
        let several = load(root.path()).expect("loads");
        let others = vec![("sparse/0".to_owned(), 2), ("sparse/9".to_owned(), 2)];
        let warning = Warning::OtherModels { used: "sparse/10".to_owned(), images: 3, others };
        assert_eq!((several.views.len(), several.warnings.as_slice()), (3, &[warning][..]));
        let said = several.warnings[0].to_string();
        for words in ["3 parts", "sparse/10 (3 images), is used", "sparse/0 (2 images), sparse/9 (2 images) are not"] {
            assert!(said.contains(words), "{said}");
        }
        // Of equally large models, the first.
        whole.write(root.path(), &files(&whole));
        let equal = load(root.path()).expect("loads");
        assert!(matches!(&equal.warnings[0], Warning::OtherModels { used, .. } if used == "sparse/0"));
        if !text {
            // A model whose images cannot be counted might be the largest: an error.
            fs::write(sparse.join("9/images.bin"), [1, 0, 0]).expect("written");
            let error = load(root.path()).expect_err("cut").to_string();
            assert!(error.contains("9/images.bin: number of images at byte 0"), "{error}");
        }
    }
}

#[test]
fn unposed_photographs_are_counted() {
    let root = Folder::ring(&NAMES, [0.0; 3]).dataset(false);
    write_photograph(&root.path().join("images/more/d.JPG.png"), 24, 16, 0);
    let dataset = load(root.path()).expect("loads");
    assert_eq!(dataset.warnings, [Warning::PhotographsWithoutPose { photographs: 1 }]);
}

#[test]
fn the_real_scenes_load() {
    for (name, images, points, size) in
        [("caliterra", 75, 20_639, (640, 480)), ("copr", 38, 14_897, (640, 427)), ("fox", 50, 11_967, (360, 640))]
    {
        let Some(folder) = common::data(name) else { continue };
        let dataset = load(&folder).expect(name);
        assert_eq!((dataset.views.len(), dataset.points.len()), (images, points), "{name}");
        assert!(dataset.views.iter().all(|v| (v.camera.width, v.camera.height) == size && v.size_on_disk == size));
        assert_eq!(dataset.views_of(Role::HeldOut).count(), images.div_ceil(8));
        assert!(dataset.warnings.is_empty(), "{name}: {:?}", dataset.warnings);
        // The poses fit the points: nearly all points of a reconstruction lie before the cameras.
        let camera = dataset.scene_camera(0).expect("camera");
        let before = dataset.points.iter().filter(|p| {
            let p = dataset.frame.to_scene(p.position);
            (0..3).map(|j| camera.rotation[2][j] * p[j]).sum::<f64>() + camera.translation[2] > 0.0
        });
        assert!(before.count() * 10 > points * 9, "{name}");
        println!("{name}: extent {} of the dataset's units", dataset.extent);
    }
    let Some(folder) = common::data("fox") else { return };
    let fox = load(&folder).expect("fox");
    // As rounded in the description of the scene: 184.85 and 321.76.
    assert!((fox.views[0].camera.cx - 184.85).abs() < 0.005 && (fox.views[0].camera.cy - 321.76).abs() < 0.005);
    assert_eq!(fox.views_of(Role::Train).count(), 43);
    assert_eq!(fox.photographs(Role::HeldOut).expect("decodes").len(), 7);
}
