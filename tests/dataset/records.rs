//! Unusable records: a few of many are left out with a warning, more are an error. In strict mode the first is an
//! error.

use std::fs;
use std::io::Cursor;
use std::path::Path;

use image::ImageFormat;
use psrgs_vk::dataset::{Dataset, Error, HostShare, LoadOptions, Role, Warning};
use psrgs_vk::format::{LeftOut, ply};
use psrgs_vk::scene::{Frame, Gaussians};
use psrgs_vk::train::prepare;

use crate::colmap_folder::{CameraRow, Folder, ImageRow, PINHOLE, PointRow};
use crate::formats::{cloud, nerfstudio, opensfm, reconstruction, transforms, turned, write_json};
use crate::{common, load};

fn many() -> Vec<String> {
    (0..20).map(|i| format!("{i:02}.png")).collect()
}

fn ring() -> Folder {
    let names = many();
    let mut folder = Folder::ring(&names.iter().map(String::as_str).collect::<Vec<_>>(), [0.0; 3]);
    // The images of each point's track lie before, among and after those that are left out.
    for (point, first) in folder.points.iter_mut().zip(1..) {
        point.track = (first..first + 6).map(|image| (image, 0)).collect();
    }
    folder
}

fn strictly(root: &Path) -> Result<Dataset, Error> {
    Dataset::load(root, &LoadOptions { strict: true, ..LoadOptions::default() })
}

/// The warnings about records that were left out.
fn left_out(dataset: &Dataset) -> Vec<&LeftOut> {
    dataset
        .warnings
        .iter()
        .filter_map(|w| if let Warning::LeftOut(left_out) = w { Some(left_out) } else { None })
        .collect()
}

/// Checks that the dataset is read without the records and warns with `words`, and that strict mode fails with the last
/// of the words.
#[track_caller]
fn leaves_out(root: &Path, what: &str, count: usize, of: usize, words: &[&str]) -> Dataset {
    let dataset = load(root).expect(what);
    let told = left_out(&dataset);
    assert_eq!(told.len(), 1, "{:?}", dataset.warnings);
    assert_eq!((told[0].what, told[0].count, told[0].of), (what, count, of), "{told:?}");
    let said = told[0].to_string();
    words.iter().for_each(|word| assert!(said.contains(word), "does not say {word}: {said}"));
    let error = strictly(root).expect_err("strict").to_string();
    words.last().iter().for_each(|word| assert!(error.contains(**word), "does not say {word}: {error}"));
    dataset
}

fn names(dataset: &Dataset) -> Vec<&str> {
    dataset.views.iter().map(|view| view.name.as_str()).collect()
}

type Change = fn(&mut Folder);

#[test]
fn poses_of_colmap_that_cannot_be_used_are_left_out() {
    let cases: [(&str, Change, &str); 7] = [
        ("a NaN", |f| f.images[7].translation[1] = f64::NAN, "ty of image '07.png'"),
        ("an infinity", |f| f.images[7].quaternion[0] = f64::INFINITY, "qw of image '07.png'"),
        ("a quaternion of zeros", |f| f.images[7].quaternion = [0.0; 4], "the quaternion is zero"),
        ("an absurd quaternion", |f| f.images[7].quaternion[2] = 1e300, "beyond all range"),
        ("an absurd place", |f| f.images[7].translation = [1e308; 3], "the camera of '07.png' cannot be used"),
        ("a place beyond the scene", |f| f.images[7].translation[0] = 1e60, "too far from the others"),
        ("no such camera", |f| f.images[7].camera = 77, "there is no camera 77"),
    ];
    let whole = load(ring().dataset(false).path()).expect("loads");
    for (what, change, words) in cases {
        for text in [false, true] {
            let root = ring().dataset(text);
            let mut folder = ring();
            change(&mut folder);
            folder.write(root.path(), &if text { folder.text() } else { folder.binary() });
            println!("{what}, text: {text}");
            let dataset = leaves_out(root.path(), "images", 1, 20, &["images.", "'07.png'", words]);
            let mut want = names(&whole);
            want.remove(7);
            assert_eq!(names(&dataset), want);
            // Tracks name the remaining views.
            assert_eq!(dataset.points, whole.points);
            let seen = |dataset: &Dataset, point| -> Vec<String> {
                dataset.tracks.of(point).iter().map(|view| dataset.views[*view as usize].name.clone()).collect()
            };
            for point in 0..12 {
                let mut want = seen(&whole, point);
                want.retain(|name| name != "07.png");
                assert_eq!(seen(&dataset, point), want, "point {point}");
            }
        }
    }
}

#[test]
fn more_than_a_tenth_that_cannot_be_used_are_refused() {
    for (bad, read) in [(2, true), (3, false)] {
        for text in [false, true] {
            let root = ring().dataset(text);
            let mut folder = ring();
            folder.images.iter_mut().take(bad).for_each(|image| image.translation[0] = f64::NAN);
            folder.write(root.path(), &if text { folder.text() } else { folder.binary() });
            match load(root.path()) {
                Ok(dataset) => assert!(read && left_out(&dataset)[0].count == bad),
                Err(error) => {
                    let error = error.to_string();
                    assert!(
                        !read && error.contains("tx of image '00.png'") && error.contains("3 of 20 images"),
                        "{error}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_photograph_with_two_poses_has_the_first_and_ids_may_repeat() {
    for text in [false, true] {
        let root = ring().dataset(text);
        let mut folder = ring();
        let twice = ImageRow { id: 21, translation: [9.0; 3], ..folder.images[3].clone() };
        folder.images.push(twice);
        folder.write(root.path(), &if text { folder.text() } else { folder.binary() });
        let dataset = leaves_out(root.path(), "images", 1, 21, &["'03.png'", "two images are named '03.png'"]);
        assert_eq!(
            dataset.views,
            load(ring().dataset(text).path())
                .expect("loads")
                .views
                .iter()
                .zip(&dataset.views)
                .map(|(view, here)| psrgs_vk::dataset::View { path: here.path.clone(), ..view.clone() })
                .collect::<Vec<_>>()
        );
        // Two images of one number: only the tracks of that number are unknown.
        let mut folder = ring();
        folder.images[3].id = 2;
        folder.write(root.path(), &if text { folder.text() } else { folder.binary() });
        let dataset = load(root.path()).expect("loads");
        assert_eq!(dataset.views.len(), 20);
        assert_eq!(dataset.warnings[0], Warning::SharedNumber { number: 2, images: 1 });
        assert!((0..12).all(|point| !dataset.tracks.of(point).contains(&1)), "image 2 was '01.png'");
    }
}

#[test]
fn points_of_colmap_that_cannot_be_used_are_left_out() {
    type Change = fn(&mut PointRow);
    let cases: [(&str, Change, &str); 4] = [
        ("a NaN", |p| p.position[2] = f64::NAN, "z of point 93"),
        ("an infinity", |p| p.position[0] = f64::NEG_INFINITY, "x of point 93"),
        ("an absurd place", |p| p.position[0] = 1e60, "too far from the cameras"),
        ("a place that is far off", |p| p.position[0] = -1e18, "too far from the cameras"),
    ];
    let whole = load(ring().dataset(false).path()).expect("loads");
    for (what, change, words) in cases {
        for text in [false, true] {
            let root = ring().dataset(text);
            let mut folder = ring();
            change(&mut folder.points[7]);
            folder.write(root.path(), &if text { folder.text() } else { folder.binary() });
            println!("{what}, text: {text}");
            let dataset = leaves_out(root.path(), "points", 1, 12, &["points3D.", "point 93", words]);
            let mut want = whole.points.clone();
            let gone = want.iter().position(|p| p.id == 93).expect("there");
            want.remove(gone);
            assert_eq!(dataset.points, want);
            assert_eq!(dataset.tracks.of(gone), whole.tracks.of(gone + 1));
        }
    }
}

#[test]
fn lines_of_text_that_cannot_be_read_are_left_out() {
    let root = ring().dataset(true);
    let rewritten = |name: &str, from: &str, to: &str| {
        ring().write(root.path(), &ring().text());
        let file = root.path().join("sparse/0").join(name);
        let text = fs::read_to_string(&file).expect("text");
        assert!(text.contains(from), "{name} has {from}");
        fs::write(&file, text.replacen(from, to, 1)).expect("written");
    };
    rewritten("points3D.txt", "\n95 ", "\nwhat is this 95 ");
    leaves_out(root.path(), "points", 1, 12, &["point what", "'what' is not a number"]);
    rewritten("points3D.txt", "255 128", "256 128");
    leaves_out(root.path(), "points", 1, 12, &["colour of point 100"]);
    rewritten("images.txt", " 1 08.png", " one 08.png");
    leaves_out(root.path(), "images", 1, 20, &["'08.png'", "camera of image '08.png'"]);
    // Keypoints are not used: only the line is reported.
    rewritten("images.txt", "1.5 2.25 -1\n", "1.5 2.25\n");
    let dataset = leaves_out(root.path(), "lines of keypoints", 1, 20, &["are not a multiple of three"]);
    assert_eq!(dataset.views.len(), 20);
}

#[test]
fn cameras_that_no_image_uses_need_not_be_readable() {
    let odd: [(&str, CameraRow, &str); 4] = [
        (
            "an unknown model",
            CameraRow { id: 9, model: ("LIGHTFIELD", 99), size: [24, 16], params: vec![1.0; 7] },
            "unknown",
        ),
        ("no size", CameraRow { id: 9, model: PINHOLE, size: [0, 16], params: vec![20.0; 4] }, "size of camera 9"),
        (
            "a focal length below zero",
            CameraRow { id: 9, model: PINHOLE, size: [24, 16], params: vec![-2.0; 4] },
            "is -2",
        ),
        (
            "a NaN",
            CameraRow { id: 9, model: PINHOLE, size: [24, 16], params: vec![f64::NAN; 4] },
            "parameter 0 of camera 9",
        ),
    ];
    for (what, camera, words) in odd {
        for text in [false, true] {
            // Before and after the camera that is used.
            for at in [0, 1] {
                let root = ring().dataset(text);
                let mut folder = ring();
                folder.cameras.insert(at, camera.clone());
                folder.write(root.path(), &if text { folder.text() } else { folder.binary() });
                println!("{what}, text: {text}, at {at}");
                let dataset = leaves_out(root.path(), "cameras", 1, 2, &["cameras.", "camera 9", words]);
                assert_eq!(dataset.views.len(), 20);
                // A few images with an unusable camera are left out.
                folder.images[4].camera = 9;
                folder.write(root.path(), &if text { folder.text() } else { folder.binary() });
                leaves_out(root.path(), "images", 1, 20, &["'04.png'", words]);
                folder.images.iter_mut().for_each(|image| image.camera = 9);
                folder.write(root.path(), &if text { folder.text() } else { folder.binary() });
                let error = load(root.path()).expect_err("all").to_string();
                assert!(error.contains("cameras.") && error.contains(words), "{error}");
            }
        }
    }
}

#[test]
fn a_camera_that_occurs_twice_is_one_where_both_are_alike() {
    for text in [false, true] {
        let root = ring().dataset(text);
        let mut folder = ring();
        folder.cameras.push(folder.cameras[0].clone());
        folder.write(root.path(), &if text { folder.text() } else { folder.binary() });
        leaves_out(root.path(), "cameras", 1, 2, &["camera 1", "the number 1 occurs twice"]);
        folder.cameras[1].params[0] += 1.0;
        folder.write(root.path(), &if text { folder.text() } else { folder.binary() });
        let error = load(root.path()).expect_err("two different cameras of one number").to_string();
        assert!(error.contains("the number 1 occurs twice"), "{error}");
    }
}

#[test]
fn photographs_that_are_missing_or_none_are_left_out() {
    for (damage, words) in [
        ((|file| fs::remove_file(file).expect("removed")) as fn(&Path), "missing"),
        (|file| fs::write(file, "").expect("written"), "the file is empty"),
        (|file| fs::write(file, "no picture at all").expect("written"), "no known format"),
        (|file| image::RgbImage::new(16, 24).save(file).expect("written"), "16x24"),
    ] {
        let root = ring().dataset(false);
        damage(&root.path().join("images/05.png"));
        let dataset = load(root.path()).expect(words);
        let told = left_out(&dataset);
        assert!(told.len() == 1 && told[0].count == 1 && told[0].of == 20 && told[0].first == "'05.png'", "{told:?}");
        assert!(dataset.views.len() == 19 && !names(&dataset).contains(&"05.png"));
        assert!(dataset.warnings.len() == 1, "{:?}", dataset.warnings);
        let error = strictly(root.path()).expect_err("strict").to_string();
        assert!(error.contains("05.png") && error.contains(words), "{error}");
        (6..8).for_each(|k| damage(&root.path().join(format!("images/{k:02}.png"))));
        let error = load(root.path()).expect_err("three of twenty").to_string();
        assert!(error.contains("05.png") && error.contains(words), "{error}");
    }
}

/// A file of noise in the size of the ring's photographs.
fn noise(format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    common::noise(1, 24, 16).write_to(&mut bytes, format).expect("a picture");
    bytes.into_inner()
}

/// Pictures with a sound header whose pixels cannot be decoded.
fn without_pixels() -> Vec<(&'static str, Vec<u8>)> {
    let cut = |format| {
        let bytes = noise(format);
        bytes[..bytes.len() * 2 / 3].to_vec()
    };
    let mut flipped = noise(ImageFormat::Png);
    let middle = flipped.len() / 2;
    flipped[middle] ^= 0x55;
    // The offset of the strip of pixels lies beyond the end of the file: tag 273, a LONG, count 1.
    let mut beyond = noise(ImageFormat::Tiff);
    let strip = [0x11, 1, 4, 0, 1, 0, 0, 0];
    let at = beyond.windows(8).position(|bytes| bytes == strip).expect("a strip") + 8;
    beyond[at..at + 4].copy_from_slice(&0x00ff_ffff_u32.to_le_bytes());
    vec![
        ("a JPEG cut off", cut(ImageFormat::Jpeg)),
        ("a PNG cut off", cut(ImageFormat::Png)),
        ("a WebP cut off", cut(ImageFormat::WebP)),
        ("a PNG with a wrong byte", flipped),
        ("a TIFF without its strip", beyond),
    ]
}

/// The dataset decoded for a training that keeps `keep` bytes of photographs.
fn decoded(root: &Path, strict: bool, keep: u64) -> Result<psrgs_vk::train::Input, String> {
    let dataset = Dataset::load(root, &LoadOptions { strict, ..LoadOptions::default() }).expect("sound headers");
    assert_eq!((dataset.views.len(), left_out(&dataset).len()), (20, 0));
    let initial = dataset.first_gaussians().expect("splats");
    let share = HostShare { keep, ..HostShare::unlimited() };
    prepare::input_within(&dataset, initial, share).map_err(|error| error.to_string())
}

#[test]
fn photographs_whose_pixels_cannot_be_decoded_are_left_out() {
    for (what, bytes) in without_pixels() {
        // A held-out photograph, then a training photograph.
        for (k, role) in [(8, Role::HeldOut), (5, Role::Train)] {
            println!("{what}, {role:?}");
            let root = ring().dataset(false);
            let (name, file) = (format!("{k:02}.png"), |k: i32| root.path().join(format!("images/{k:02}.png")));
            let whole = fs::read(file(k)).expect("read");
            fs::write(file(k), &bytes).expect("written");
            for keep in [0, 3000, u64::MAX] {
                let input = decoded(root.path(), false, keep).expect("one of twenty");
                let views: Vec<&str> = input.train.iter().chain(&input.held_out).map(|v| v.name.as_str()).collect();
                assert!(views.len() == 19 && !views.contains(&name.as_str()), "{views:?}");
                let [Warning::LeftOut(told)] = &input.optional.left_out[..] else {
                    panic!("{:?}", input.optional.left_out)
                };
                assert_eq!((told.what, told.count, told.of), ("photographs", 1, 20));
                assert!(told.first == format!("'{name}'") && told.problem.contains("pixels at byte"), "{told}");
                let [undecodable] = &input.optional.undecoded.photographs[..] else { panic!("one") };
                assert_eq!((&undecodable.name, undecodable.role), (&name, role));
                // Everything else equals the dataset with the photograph.
                let mut dataset = load(root.path()).expect("loads");
                let before = dataset.clone();
                dataset.leave_out(&input.optional.undecoded);
                assert!(dataset.views.len() == 19 && dataset.frame == before.frame);
                let seen = |dataset: &Dataset, point| -> Vec<String> {
                    dataset.tracks.of(point).iter().map(|v| dataset.views[*v as usize].name.clone()).collect()
                };
                for point in 0..12 {
                    let mut want = seen(&before, point);
                    want.retain(|seen| *seen != name);
                    assert_eq!(seen(&dataset, point), want);
                }
            }
            let error = decoded(root.path(), true, u64::MAX).expect_err("strict");
            assert!(error.contains(&name) && error.contains("pixels at byte"), "{error}");
            // Counted among all photographs: two are a tenth of twenty, and more than a tenth of the held-out ones.
            fs::write(file(if k == 8 { 16 } else { 6 }), &bytes).expect("written");
            assert_eq!(decoded(root.path(), false, u64::MAX).expect("a tenth").optional.undecoded.photographs.len(), 2);
            fs::write(file(1), &bytes).expect("written");
            let error = decoded(root.path(), false, u64::MAX).expect_err("three of twenty");
            assert!(error.contains("3 of 20 photographs cannot be used") && error.contains("01.png"), "{error}");
            fs::write(file(k), whole).expect("written");
        }
    }
}

#[test]
fn a_photograph_whose_mask_cannot_be_decoded_is_left_out() {
    let root = ring().dataset(false);
    let masks = root.path().join("masks");
    fs::create_dir_all(&masks).expect("a folder");
    for name in many() {
        fs::write(masks.join(format!("{name}.png")), noise(ImageFormat::Png)).expect("written");
    }
    let bytes = noise(ImageFormat::Png);
    fs::write(masks.join("05.png.png"), &bytes[..bytes.len() / 2]).expect("written");
    let input = decoded(root.path(), false, u64::MAX).expect("one of twenty");
    let said: Vec<String> = input.optional.left_out.iter().map(ToString::to_string).collect();
    let want = ["1 of 20 photographs cannot be used and is left out, '05.png'", "05.png.png: pixels at byte"];
    assert!(said.len() == 1 && want.iter().all(|want| said[0].contains(want)), "{said:?}");
    let error = decoded(root.path(), true, u64::MAX).expect_err("strict");
    assert!(error.contains("05.png.png: pixels at byte"), "{error}");
}

/// The split counts missing photographs: the others keep their roles.
#[test]
fn a_missing_photograph_changes_no_other_ones_role() {
    let root = ring().dataset(false);
    let whole = load(root.path()).expect("loads");
    fs::remove_file(root.path().join("images/05.png")).expect("removed");
    let dataset = load(root.path()).expect("loads");
    let roles = |dataset: &Dataset| -> Vec<(String, Role)> {
        dataset.views.iter().filter(|v| v.name != "05.png").map(|v| (v.name.clone(), v.role)).collect()
    };
    assert_eq!((dataset.views.len(), roles(&dataset)), (19, roles(&whole)));
}

#[test]
fn frames_and_shots_that_cannot_be_used_are_left_out() {
    let folder = turned(&many(), [0.0; 3]);
    let root = nerfstudio(&folder, true);
    let whole = load(root.path()).expect("loads");
    let text = serde_json::to_string_pretty(&transforms(&folder)).expect("JSON");
    let changed = |change: &dyn Fn(&mut serde_json::Value)| {
        let mut value = transforms(&folder);
        change(&mut value["frames"][6]);
        serde_json::to_string_pretty(&value).expect("JSON")
    };
    let nan = changed(&|frame| frame["transform_matrix"][1][3] = "NUMBER".into());
    for (text, words) in [
        (nan.replace("\"NUMBER\"", "NaN"), "NaN"),
        (nan.replace("\"NUMBER\"", "-Infinity"), "-Infinity"),
        (nan.replace("\"NUMBER\"", "null"), "null"),
        (nan.replace("\"NUMBER\"", "1e60"), "too far from the others"),
        (changed(&|frame| frame["transform_matrix"] = serde_json::json!([[1, 2]])), "is not a matrix"),
        (changed(&|frame| frame["transform_matrix"][0][0] = 70.into()), "no rotation"),
        (changed(&|frame| drop(frame.as_object_mut().map(|f| f.remove("transform_matrix")))), "missing field"),
        (changed(&|frame| frame["camera_model"] = "EUCLID".into()), "EUCLID"),
        (changed(&|frame| frame["fl_x"] = (-3).into()), "fl_x of frame './images/06.png'"),
        (changed(&|frame| *frame = 7.into()), "invalid type"),
    ] {
        fs::write(root.path().join("transforms.json"), text).expect("written");
        let dataset = load(root.path()).unwrap_or_else(|e| panic!("{words}: {e}"));
        let told = left_out(&dataset);
        assert!(told.len() == 1 && told[0].count == 1 && told[0].of == 20, "{told:?}");
        assert!(told[0].to_string().contains(words) && told[0].first.contains('6'), "{words}: {}", told[0]);
        assert!(dataset.views.len() == 19 && !names(&dataset).contains(&"06.png"));
        let error = strictly(root.path()).expect_err("strict").to_string();
        assert!(error.contains("transforms.json") && error.contains(words), "{error}");
    }
    fs::write(root.path().join("transforms.json"), text).expect("written");
    assert_eq!(load(root.path()).expect("loads").views, whole.views);

    let root = opensfm(&folder, "reconstruction.json");
    let shot = |change: &dyn Fn(&mut serde_json::Value)| {
        let mut value = reconstruction(&folder);
        change(&mut value[0]["shots"]["06.png"]);
        serde_json::to_string(&value).expect("JSON")
    };
    let nan = shot(&|shot| shot["translation"][1] = "NUMBER".into());
    for (text, words) in [
        (nan.replace("\"NUMBER\"", "NaN"), "NaN"),
        (nan.replace("\"NUMBER\"", "1e60"), "too far from the others"),
        (shot(&|shot| shot["camera"] = "other".into()), "there is no camera 'other'"),
        (shot(&|shot| shot["rotation"] = serde_json::json!([1, 2])), "a rotation is a vector of 3 numbers"),
        (shot(&|shot| shot["rotation"] = serde_json::json!([1e300, 1e300, 0])), "beyond all range"),
    ] {
        fs::write(root.path().join("reconstruction.json"), text).expect("written");
        let dataset = load(root.path()).unwrap_or_else(|e| panic!("{words}: {e}"));
        let told = left_out(&dataset);
        assert!(
            told.len() == 1 && told[0].first == "'06.png'" && told[0].to_string().contains(words),
            "{words}: {told:?}"
        );
        assert_eq!(dataset.views.len(), 19);
        assert!(strictly(root.path()).expect_err("strict").to_string().contains(words));
    }
    // A camera of no shot, and a point.
    let mut value = reconstruction(&folder);
    value[0]["cameras"]["another"] = serde_json::json!({"projection_type": "dual", "width": 24, "height": 16});
    write_json(&root.path().join("reconstruction.json"), &value);
    leaves_out(root.path(), "cameras", 1, 2, &["camera 'another'", "dual"]);
    let mut value = reconstruction(&folder);
    value[0]["points"]["93"]["coordinates"][0] = serde_json::Value::Null;
    write_json(&root.path().join("reconstruction.json"), &value);
    let dataset = leaves_out(root.path(), "points", 1, 12, &["point 93", "null"]);
    assert_eq!(dataset.points.len(), 11);
    // Two poses of one photograph.
    let text = serde_json::to_string(&reconstruction(&folder)).expect("JSON").replace("\"07.png\"", "\"06.png\"");
    fs::write(root.path().join("reconstruction.json"), text).expect("written");
    leaves_out(root.path(), "images", 1, 20, &["'06.png'", "two images are named '06.png'"]);
}

#[test]
fn points_of_a_cloud_that_are_not_finite_are_left_out() {
    let folder = turned(&many(), [0.0; 3]);
    for text in [true, false] {
        let root = nerfstudio(&folder, text);
        let file = root.path().join("sparse_pc.ply");
        let mut bad = turned(&many(), [0.0; 3]);
        bad.points[5].position[1] = f64::NAN;
        fs::write(&file, cloud(&bad, text)).expect("written");
        let dataset = leaves_out(root.path(), "points", 1, 12, &["sparse_pc.ply", "vertex 5", "is not finite"]);
        assert_eq!(dataset.points.len(), 11);
        bad.points[6].position[1] = f64::INFINITY;
        fs::write(&file, cloud(&bad, text)).expect("written");
        let error = load(root.path()).expect_err("two of twelve").to_string();
        assert!(error.contains("y of vertex 5"), "{error}");
    }
}

/// A model whose opacities are the indices of the splats.
fn splats(n: usize) -> Gaussians {
    let mut splats = Gaussians::zeros(n);
    (0..n).for_each(|i| splats.opacities[i] = i as f32);
    splats
}

#[test]
fn splats_that_are_not_finite_are_left_out_of_a_model() {
    let root = tempfile::tempdir().expect("a folder");
    let file = root.path().join("point_cloud.ply");
    let mut model = splats(20);
    model.means[3 * 4 + 1] = f32::NAN;
    model.sh[2][12 * 11 + 5] = f32::INFINITY;
    ply::save_staged(&file, &model, &Frame::IDENTITY, false, Some(10)).expect("written");
    let read = ply::read(&file).expect("a model");
    let kept: Vec<f32> = (0..20).filter(|i| ![4, 11].contains(i)).map(|i| i as f32).collect();
    assert_eq!((read.gaussians.opacities.as_slice(), read.constrained), (kept.as_slice(), Some(9)));
    assert_eq!(read.gaussians.ids, (0..18).collect::<Vec<u32>>());
    let told = read.left_out.expect("some");
    assert_eq!((told.what, told.count, told.of, told.first.as_str()), ("splats", 2, 20, "vertex 4"));
    assert!(told.to_string().contains("y of vertex 4 at byte"), "{told}");
    let error = ply::read_with(&file, true).map(|m| m.gaussians.len()).expect_err("strict").to_string();
    assert!(error.contains("y of vertex 4 at byte"), "{error}");
    model.scales[0] = f32::NAN;
    ply::save(&file, &model, &Frame::IDENTITY, false).expect("written");
    let error = ply::read(&file).map(|m| m.gaussians.len()).expect_err("three of twenty").to_string();
    assert!(error.contains("scale_0 of vertex 0"), "{error}");
}
