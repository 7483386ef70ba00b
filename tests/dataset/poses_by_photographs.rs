//! Poses that contradict the photographs: by the colours of points, and by the content that neighbours share.

use image::{Rgb, RgbImage};
use psrgs_vk::dataset::{
    Convention, Dataset, Error, Format, HostShare, LoadOptions, PoseFault, Role, Split, Supply, Tracks,
};
use psrgs_vk::scene::Camera;

use super::{
    colmap_folder::{CameraRow, Folder, ImageRow, PINHOLE, PointRow},
    common,
    poses::{Matrix, apply, matrix, product, translation, turned_about, written_of},
};

const SIZE: [u32; 2] = [160, 120];
const FOCAL: f64 = 140.0;

/// A number from 0 to 1 for a square of a lattice.
fn noise(x: i64, y: i64, salt: i64) -> f64 {
    let mixed = (x * 73_856_093) ^ (y * 19_349_663) ^ (salt * 83_492_791);
    let mixed = (mixed as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (mixed >> 40) as f64 / f64::from(1 << 24)
}

/// The colour of the ground: fields of many colours with stones on them.
fn ground([x, y]: [f64; 2]) -> [u8; 3] {
    std::array::from_fn(|channel| {
        let at = |scale: f64, salt: i64| noise((x / scale).floor() as i64, (y / scale).floor() as i64, salt);
        (255.0 * (0.7 * at(0.6, channel as i64) + 0.3 * at(0.17, 9))) as u8
    })
}

/// A camera of a flight in three lines of four photographs, 4 above the ground, tilted and turned a little.
fn place(k: u32) -> ([f64; 4], [f64; 3]) {
    let turn = |axis: usize, angle: f64| {
        let mut turn = [(0.5 * angle).cos(), 0.0, 0.0, 0.0];
        turn[1 + axis] = (0.5 * angle).sin();
        turn
    };
    let [a, b] = [0, 1].map(|salt| noise(i64::from(k), 5, salt) - 0.5);
    let down = product(turn(0, 0.25 * a), product(turn(1, 0.25 * b), [0.0, 1.0, 0.0, 0.0]));
    let (line, at) = (k / 4, if (k / 4).is_multiple_of(2) { k % 4 } else { 3 - k % 4 });
    (product(down, turn(2, 0.4 + 0.3 * a)), [1.1 * f64::from(at), 1.1 * f64::from(line), 4.0 + 0.3 * b])
}

/// The flight and points on the ground, each with the images that show it. No image has keypoints.
fn flight() -> Folder {
    let image = |k: u32| {
        let (quaternion, center) = place(k);
        let name = format!("{k:02}.png");
        let translation = translation(quaternion, center);
        ImageRow { id: k + 1, quaternion, translation, camera: 1, name, keypoints: Vec::new() }
    };
    let images: Vec<ImageRow> = (0..12).map(image).collect();
    let point = |i: u32| {
        let position = [f64::from(i % 80) * 0.1 - 2.35, f64::from(i / 80) * 0.1 - 1.9, 0.0];
        let shows = |image: &&ImageRow| {
            let [x, y, z] = apply(&matrix(image.quaternion), position);
            let [x, y, z] = [x + image.translation[0], y + image.translation[1], z + image.translation[2]];
            z > 0.0 && (x / z * FOCAL).abs() < 80.0 && (y / z * FOCAL).abs() < 60.0
        };
        let track = images.iter().filter(shows).map(|image| (image.id, i)).collect();
        PointRow { id: u64::from(i) + 1, position, colour: ground([position[0], position[1]]), error: 0.3, track }
    };
    let points = (0..80 * 60).map(point).collect();
    let params = vec![FOCAL, FOCAL, 80.0, 60.0];
    let camera = CameraRow { id: 1, model: PINHOLE, size: SIZE.map(u64::from), params };
    Folder { cameras: vec![camera], images, points }
}

/// The photograph of an image of the flight from its own pose.
fn photograph(image: &ImageRow) -> RgbImage {
    let back = turned_about(&matrix(image.quaternion));
    let center = apply(&back, image.translation).map(|v| -v);
    RgbImage::from_fn(SIZE[0], SIZE[1], |x, y| {
        let ray = apply(&back, [(f64::from(x) - 79.5) / FOCAL, (f64::from(y) - 59.5) / FOCAL, 1.0]);
        let along = -center[2] / ray[2];
        Rgb(ground([center[0] + along * ray[0], center[1] + along * ray[1]]))
    })
}

fn options(max_side: u32) -> LoadOptions {
    LoadOptions { split: Split::None, max_side: Some(max_side), ..LoadOptions::default() }
}

fn take_in(dataset: &Dataset) -> Vec<Option<Supply>> {
    dataset.take_in(Role::Train, &mut HostShare::unlimited()).unwrap()
}

/// The dataset of a model, with the photographs of the flight.
fn loaded(model: &Folder, text: bool) -> (tempfile::TempDir, Dataset) {
    let root = model.dataset(text);
    for image in flight().images {
        photograph(&image).save(root.path().join("images").join(&image.name)).unwrap();
    }
    let dataset = Dataset::load(root.path(), &options(1600)).unwrap();
    (root, dataset)
}

fn wrong(dataset: &Dataset) -> Vec<(usize, PoseFault)> {
    dataset.poses_against_photographs(Role::Train, &take_in(dataset)).unwrap()
}

fn change_places(model: &mut Folder, [a, b]: [usize; 2]) {
    let pose = |image: &ImageRow| (image.quaternion, image.translation);
    let (first, second) = (pose(&model.images[a]), pose(&model.images[b]));
    (model.images[a].quaternion, model.images[a].translation) = second;
    (model.images[b].quaternion, model.images[b].translation) = first;
}

#[test]
fn colours_reveal_swapped_photographs_without_keypoints() {
    for zeros in [false, true] {
        for text in [false, true] {
            let mut model = flight();
            if zeros {
                // As written by exporters that know the points of a photograph and not their pixels.
                for image in &mut model.images {
                    let shown = model.points.iter().filter(|point| point.track.iter().any(|(id, _)| *id == image.id));
                    image.keypoints = shown.map(|point| (0.0, 0.0, point.id as i64)).collect();
                }
            }
            let (_root, sound) = loaded(&model, text);
            assert!(sound.warnings.is_empty() && sound.views.iter().all(|view| !view.pose_checked));
            assert_eq!(wrong(&sound), []);
            change_places(&mut model, [5, 6]);
            let (_root, dataset) = loaded(&model, text);
            assert_eq!(dataset.warnings, [], "the tracks cannot reveal swapped photographs");
            match wrong(&dataset)[..] {
                [(5, PoseFault::OtherPose { fit, other }), (6, PoseFault::OtherPose { .. })] => {
                    assert!(fit < 0.5 && other > 0.8, "{fit} {other}");
                }
                ref found => panic!("{zeros} {text}: {found:?}"),
            }
        }
    }
}

#[test]
fn names_in_another_order_than_the_poses_are_refused() {
    let mut model = flight();
    model.points.iter_mut().for_each(|point| point.track.clear());
    let poses: Vec<_> = model.images.iter().map(|image| (image.quaternion, image.translation)).collect();
    for (image, pose) in model.images.iter_mut().zip(poses.into_iter().cycle().skip(1)) {
        (image.quaternion, image.translation) = pose;
    }
    let (_root, dataset) = loaded(&model, false);
    match dataset.poses_against_photographs(Role::Train, &take_in(&dataset)) {
        Err(Error::PosesOfOthers { changed, of: 12, .. }) => assert!(changed > 6, "{changed}"),
        other => panic!("{other:?}"),
    }
}

/// A `transforms.json` of the flight without points.
fn transforms(root: &std::path::Path, written: impl Fn((Matrix, [f64; 3])) -> (Matrix, [f64; 3])) -> Dataset {
    std::fs::create_dir_all(root.join("images")).unwrap();
    let frame = |image: ImageRow| {
        photograph(&image).save(root.join("images").join(&image.name)).unwrap();
        let (r, t) = written((matrix(image.quaternion), image.translation));
        let row = |i: usize| format!("[{}, {}, {}, {}]", r[i][0], r[i][1], r[i][2], t[i]);
        let rows = [0, 1, 2].map(row).join(", ");
        format!(r#"{{"file_path": "images/{}", "transform_matrix": [{rows}, [0, 0, 0, 1]]}}"#, image.name)
    };
    let frames: Vec<String> = flight().images.into_iter().map(frame).collect();
    let json = format!(
        r#"{{"camera_model": "PINHOLE", "fl_x": 140, "fl_y": 140, "cx": 80, "cy": 60, "w": 160, "h": 120, "frames": [{}]}}"#,
        frames.join(", ")
    );
    std::fs::write(root.join("transforms.json"), json).unwrap();
    Dataset::load(root, &options(1600)).unwrap()
}

#[test]
fn neighbours_without_points_reveal_the_pose_convention() {
    let root = tempfile::tempdir().unwrap();
    // The convention of the format: camera to world with y up and z backwards.
    let sound = transforms(root.path(), |pose| written_of(pose, Some(Convention::InvertedWithOtherAxes)));
    assert!(sound.points.is_empty());
    assert_eq!(wrong(&sound), []);
    for (file, found) in [
        (Some(Convention::OtherAxes), Convention::Inverted),
        (None, Convention::InvertedWithOtherAxes),
        (Some(Convention::Inverted), Convention::OtherAxes),
    ] {
        let dataset = transforms(root.path(), |pose| written_of(pose, file));
        match dataset.poses_against_photographs(Role::Train, &take_in(&dataset)) {
            Err(Error::PosesInOtherConvention { what, .. }) => {
                assert_eq!((what.format, what.found), (Format::Nerfstudio, found));
            }
            other => panic!("{found:?}: {other:?}"),
        }
    }
}

/// Poses of the flight with a different error each are wrong in every convention.
#[test]
fn poses_wrong_in_every_convention_match_none() {
    let root = tempfile::tempdir().unwrap();
    let mut dataset = transforms(root.path(), |pose| written_of(pose, Some(Convention::InvertedWithOtherAxes)));
    for (k, view) in dataset.views.iter_mut().enumerate() {
        let turn = matrix(product([0.8, 0.6, 0.0, 0.0], place(k as u32 * 7 + 3).0));
        view.camera.rotation = turn;
        view.camera.translation = apply(&turn, [k as f64, (k * k % 7) as f64, 3.0]);
    }
    assert_eq!(wrong(&dataset), []);
}

/// A real scene without the tracks of its points, and its photographs.
fn without_tracks(name: &str) -> Option<(Dataset, Vec<Option<Supply>>)> {
    let mut dataset = Dataset::load(&common::data(name)?, &options(320)).unwrap();
    dataset.tracks = Tracks::default();
    dataset.views.iter_mut().for_each(|view| view.pose_checked = false);
    let photographs = take_in(&dataset);
    Some((dataset, photographs))
}

/// The camera as read from a file in convention `found`.
fn in_convention(camera: &mut Camera, found: Convention) {
    let image = (camera.rotation, camera.translation);
    (camera.rotation, camera.translation) = written_of(image, Some(found));
}

#[test]
fn neighbours_of_real_scenes_reveal_another_pose_convention() {
    for name in ["lund"] {
        let Some((mut dataset, photographs)) = without_tracks(name) else { continue };
        dataset.points.clear();
        assert_eq!(dataset.poses_against_photographs(Role::Train, &photographs).unwrap(), [], "{name}");
        for found in Convention::ALL {
            let mut dataset = dataset.clone();
            dataset.views.iter_mut().for_each(|view| in_convention(&mut view.camera, found));
            match dataset.poses_against_photographs(Role::Train, &photographs) {
                Err(Error::PosesInOtherConvention { what, .. }) => assert_eq!(what.found, found, "{name}"),
                other => panic!("{name} {found:?}: {other:?}"),
            }
        }
    }
}

#[test]
fn photographs_of_real_scenes_bear_their_poses_out() {
    for name in ["copr", "garfield", "lewis", "lund", "seneca"] {
        let Some((mut dataset, photographs)) = without_tracks(name) else { continue };
        assert_eq!(dataset.poses_against_photographs(Role::Train, &photographs).unwrap(), [], "{name}");
        dataset.points.clear();
        assert_eq!(dataset.poses_against_photographs(Role::Train, &photographs).unwrap(), [], "{name}");
    }
}

#[test]
fn colours_reveal_swapped_neighbours_in_real_scenes() {
    for (name, first) in [("fox", 5), ("lund", 10)] {
        let Some((mut dataset, photographs)) = without_tracks(name) else { continue };
        let (a, b) = (dataset.views[first].camera, dataset.views[first + 1].camera);
        (dataset.views[first].camera, dataset.views[first + 1].camera) = (b, a);
        let found = dataset.poses_against_photographs(Role::Train, &photographs).unwrap();
        assert_eq!(found.iter().map(|(at, _)| *at).collect::<Vec<_>>(), [first, first + 1], "{name}");
    }
}

#[test]
fn colours_of_points_tell_wrong_poses_where_there_are_no_tracks() {
    for (name, wrong) in [("ochota", 30), ("caliterra", 20), ("seneca", 0), ("fox", 0), ("garfield", 0)] {
        let Some((mut dataset, photographs)) = without_tracks(name) else { continue };
        let found = |dataset: &Dataset| -> Vec<usize> {
            let found = dataset.poses_against_photographs(Role::Train, &photographs).unwrap();
            found.into_iter().map(|(at, _)| at).collect()
        };
        assert_eq!(found(&dataset), [0; 0], "{name}");
        if wrong > 0 {
            dataset.views[wrong].camera = dataset.views[3].camera;
            assert_eq!(found(&dataset), [wrong], "{name}");
        }
    }
}

#[test]
fn colours_of_points_tell_poses_of_another_convention() {
    let Some((mut dataset, photographs)) = without_tracks("fox") else { return };
    for view in &mut dataset.views {
        let (r, t) = (view.camera.rotation, view.camera.translation);
        view.camera.rotation = turned_about(&r);
        view.camera.translation = apply(&view.camera.rotation, t).map(|v| -v);
    }
    match dataset.poses_against_photographs(Role::Train, &photographs) {
        Err(Error::PosesInOtherConvention { what, .. }) => assert_eq!(what.found, Convention::Inverted),
        other => panic!("{other:?}"),
    }
}
