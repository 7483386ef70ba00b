//! Poses that contradict the points of the reconstruction.

use psrgs_vk::dataset::{Convention, Dataset, Error, Format, LoadOptions, PoseFault, Role, Split, Warning};

use super::{
    colmap_folder::{CameraRow, Folder, ImageRow, PINHOLE, PointRow},
    common,
};

const VIEWS: u32 = 12;
const SIZE: [u64; 2] = [96, 64];
const FOCAL: f64 = 80.0;

pub(super) type Matrix = [[f64; 3]; 3];

pub(super) fn apply(m: &Matrix, v: [f64; 3]) -> [f64; 3] {
    m.map(|row| (0..3).map(|k| row[k] * v[k]).sum())
}

/// World to camera of a quaternion, w first.
pub(super) fn matrix([w, x, y, z]: [f64; 4]) -> Matrix {
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

pub(super) fn product([a, b, c, d]: [f64; 4], [e, f, g, h]: [f64; 4]) -> [f64; 4] {
    [
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    ]
}

/// A camera on a ring of radius 3 that looks at the origin from 25 degrees above.
fn place(k: u32) -> ([f64; 4], [f64; 3]) {
    let around = std::f64::consts::TAU * f64::from(k) / f64::from(VIEWS);
    let above = 25_f64.to_radians();
    let half = |angle: f64| (0.5 * angle).sin_cos();
    // The camera starts along y of the world, with z upwards: x right, -z down, y forwards.
    let start = [0.5_f64.sqrt(), 0.5_f64.sqrt(), 0.0, 0.0];
    let ((s, c), (t, d)) = (half(-above), half(around));
    let tilted = product([c, -s, 0.0, 0.0], start);
    let quaternion = product(tilted, [d, 0.0, 0.0, -t]);
    let axis = matrix(quaternion)[2];
    (quaternion, axis.map(|v| -3.0 * v))
}

pub(super) fn translation(quaternion: [f64; 4], center: [f64; 3]) -> [f64; 3] {
    apply(&matrix(quaternion), center).map(|v| -v)
}

fn pixel(image: &ImageRow, point: [f64; 3]) -> [f64; 2] {
    let [x, y, z] = apply(&matrix(image.quaternion), point);
    let [tx, ty, tz] = image.translation;
    [FOCAL * (x + tx) / (z + tz) + 48.0, FOCAL * (y + ty) / (z + tz) + 32.0]
}

/// Twelve photographs of 60 points about the origin, each with keypoints of all points.
fn scene() -> Folder {
    let point = |i: u32| PointRow {
        id: u64::from(i) + 1,
        position: [f64::from(i % 5) * 0.3 - 0.6, f64::from(i / 5 % 4) * 0.3 - 0.45, f64::from(i / 20) * 0.4 - 0.4],
        colour: [(i * 4) as u8, 120, 200],
        error: 0.3,
        track: (1..=VIEWS).map(|image| (image, i)).collect(),
    };
    let points: Vec<PointRow> = (0..60).map(point).collect();
    let image = |k: u32| {
        let (quaternion, center) = place(k);
        ImageRow {
            id: k + 1,
            quaternion,
            translation: translation(quaternion, center),
            camera: 1,
            name: format!("{k:02}.png"),
            keypoints: Vec::new(),
        }
    };
    let mut images: Vec<ImageRow> = (0..VIEWS).map(image).collect();
    for image in &mut images {
        let seen = points.iter().map(|p| (pixel(image, p.position), p.id as i64));
        image.keypoints = seen.map(|([u, v], id)| (u + 0.02, v - 0.01, id)).collect();
        image.keypoints.insert(3, (1.0, 2.0, -1));
    }
    let camera = CameraRow { id: 1, model: PINHOLE, size: SIZE, params: vec![FOCAL, FOCAL, 48.0, 32.0] };
    Folder { cameras: vec![camera], images, points }
}

fn load_as(folder: &Folder, split: Split, text: bool) -> Result<Dataset, Error> {
    let options = LoadOptions { split, photographs: false, ..LoadOptions::default() };
    Dataset::load(folder.dataset(text).path(), &options)
}

fn load(folder: &Folder) -> Dataset {
    load_as(folder, Split::None, false).unwrap()
}

fn wrong(dataset: &Dataset) -> Vec<(&str, PoseFault, bool)> {
    let of = |warning| match warning {
        &Warning::PoseWrong { ref name, fault, left_out } => Some((name.as_str(), fault, left_out)),
        _ => None,
    };
    dataset.warnings.iter().filter_map(of).collect()
}

/// Makes a pose wrong in one of several ways.
fn spoil(folder: &mut Folder, way: &str) {
    let opposite = folder.images[11].clone();
    let image = &mut folder.images[5];
    let (quaternion, center) = place(5);
    match way {
        "far" => image.translation = translation(quaternion, center.map(|v| 12.0 * v)),
        "aside" => image.translation = translation(quaternion, [40.0, -9.0, 3.0]),
        "turned" => {
            image.quaternion = product([0.0, 0.0, 1.0, 0.0], quaternion);
            image.translation = translation(image.quaternion, center);
        }
        "swapped" => (image.quaternion, image.translation) = (opposite.quaternion, opposite.translation),
        "shifted" => image.translation[0] += 0.4,
        _ => unreachable!(),
    }
}

#[test]
fn a_scene_whose_points_fit_has_no_wrong_pose() {
    for text in [false, true] {
        let dataset = load_as(&scene(), Split::None, text).unwrap();
        assert_eq!(dataset.warnings, [], "{text}");
        assert_eq!(dataset.views_of(Role::Train).count(), VIEWS as usize);
    }
}

#[test]
fn a_photograph_with_misplaced_points_is_left_out_of_training() {
    let sound = load(&scene());
    for way in ["far", "aside", "turned", "swapped", "shifted"] {
        let mut folder = scene();
        spoil(&mut folder, way);
        for text in [false, true] {
            let dataset = load_as(&folder, Split::None, text).unwrap();
            match wrong(&dataset)[..] {
                [("05.png", PoseFault::Reprojection { points: 60, off, usual }, true)] => {
                    assert!(off > 0.02 && usual < 0.01, "{way}: {off} {usual}");
                }
                ref other => panic!("{way}: {other:?}"),
            }
            assert_eq!(dataset.views_of(Role::Train).count(), VIEWS as usize - 1, "{way}");
            assert_eq!(dataset.views[5].role, Role::Unused);
            assert!((dataset.extent / sound.extent - 1.0).abs() < 0.1, "{way}: {} {}", dataset.extent, sound.extent);
            let problems = dataset.problems(&dataset.sights());
            assert_eq!(problems.iter().filter(|line| line.contains("05.png")).count(), 1, "{problems:?}");
        }
    }
}

#[test]
fn a_photograph_without_keypoints_is_judged_by_the_tracks() {
    for way in ["aside", "turned"] {
        let mut folder = scene();
        spoil(&mut folder, way);
        folder.images.iter_mut().for_each(|image| image.keypoints.clear());
        let dataset = load(&folder);
        assert!(matches!(wrong(&dataset)[..], [("05.png", PoseFault::OutOfView { points: 60, .. }, true)]), "{way}");
    }
}

#[test]
fn a_held_out_photograph_with_a_wrong_pose_is_named_and_scored() {
    let mut folder = scene();
    spoil(&mut folder, "aside");
    let dataset = load_as(&folder, Split::Every { every: 6, first: 5 }, false).unwrap();
    assert!(matches!(wrong(&dataset)[..], [("05.png", _, false)]), "{:?}", dataset.warnings);
    assert_eq!(dataset.views[5].role, Role::HeldOut);
}

#[test]
fn a_pose_worse_than_the_others_is_named_and_kept() {
    let mut folder = scene();
    folder.images[5].translation[0] += 0.04;
    let dataset = load(&folder);
    assert!(
        matches!(&dataset.warnings[..], [Warning::PoseDoubtful { name, .. }] if name == "05.png"),
        "{:?}",
        dataset.warnings
    );
    assert_eq!(dataset.views_of(Role::Train).count(), VIEWS as usize);
}

#[test]
fn keypoints_at_another_scale_do_not_speak_against_poses() {
    let mut folder = scene();
    folder.images.iter_mut().for_each(|image| {
        image.keypoints.iter_mut().for_each(|(u, v, _)| (*u, *v) = (4.0 * *u, 4.0 * *v));
    });
    let dataset = load(&folder);
    assert_eq!(dataset.warnings, []);
    spoil(&mut folder, "turned");
    assert!(matches!(wrong(&load(&folder))[..], [("05.png", PoseFault::OutOfView { .. }, true)]));
}

#[test]
fn a_far_camera_whose_points_fit_is_part_of_the_extent() {
    let mut folder = scene();
    spoil(&mut folder, "far");
    let far = folder.images[5].clone();
    let seen = folder.points.iter().map(|p| (pixel(&far, p.position), p.id as i64));
    folder.images[5].keypoints = seen.map(|([u, v], id)| (u, v, id)).collect();
    let dataset = load(&folder);
    assert_eq!(dataset.warnings, []);
    assert!(dataset.extent > 30.0, "{}", dataset.extent);
}

/// Without tracks, a pose is judged by the camera's position and by the points in its view.
#[test]
fn a_far_camera_without_points_does_not_change_the_extent() {
    let bare = |way: Option<&str>| {
        let mut folder = scene();
        way.into_iter().for_each(|way| spoil(&mut folder, way));
        folder.images.iter_mut().for_each(|image| image.keypoints.clear());
        folder.points.iter_mut().for_each(|point| point.track.clear());
        load(&folder)
    };
    let sound = bare(None);
    assert_eq!(sound.warnings, []);
    let far = bare(Some("far"));
    assert!(
        matches!(&far.warnings[..], [Warning::CameraFarAway { name, .. }] if name == "05.png"),
        "{:?}",
        far.warnings
    );
    assert_eq!(far.views_of(Role::Train).count(), VIEWS as usize);
    let blind = bare(Some("aside"));
    assert!(matches!(wrong(&blind)[..], [("05.png", PoseFault::FarAndBlind { .. }, true)]), "{:?}", blind.warnings);
    assert_eq!(blind.views_of(Role::Train).count(), VIEWS as usize - 1);
    for dataset in [far, blind] {
        assert!((dataset.extent / sound.extent - 1.0).abs() < 0.1, "{} {}", dataset.extent, sound.extent);
    }
}

#[test]
fn poses_and_points_of_different_reconstructions_are_named() {
    let mut folder = scene();
    // Moved into other coordinates.
    folder.points.iter_mut().for_each(|p| p.position = [p.position[1], p.position[0], 70.0 - p.position[2]]);
    let dataset = load(&folder);
    assert!(
        matches!(dataset.warnings[..], [Warning::PosesAgainstPoints { wrong: VIEWS_ALL, of: VIEWS_ALL, .. }]),
        "{:?}",
        dataset.warnings
    );
    assert_eq!(dataset.views_of(Role::Train).count(), VIEWS_ALL);
}

const VIEWS_ALL: usize = VIEWS as usize;

pub(super) fn turned_about(m: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|k| m[k][i]))
}

/// A quaternion of a rotation whose trace is not -1.
fn quaternion(m: &Matrix) -> [f64; 4] {
    let w = 0.5 * (1.0 + m[0][0] + m[1][1] + m[2][2]).max(1e-9).sqrt();
    [w, (m[2][1] - m[1][2]) / (4.0 * w), (m[0][2] - m[2][0]) / (4.0 * w), (m[1][0] - m[0][1]) / (4.0 * w)]
}

/// The pose of an image in convention `found` in place of world to camera with y down and z forwards.
fn written(image: &ImageRow, found: Option<Convention>) -> (Matrix, [f64; 3]) {
    written_of((matrix(image.quaternion), image.translation), found)
}

pub(super) fn written_of((r, t): (Matrix, [f64; 3]), found: Option<Convention>) -> (Matrix, [f64; 3]) {
    let axes = |(r, t): (Matrix, [f64; 3])| ([r[0], r[1].map(|v| -v), r[2].map(|v| -v)], [t[0], -t[1], -t[2]]);
    let back = |(r, t): (Matrix, [f64; 3])| {
        let m = turned_about(&r);
        (m, apply(&m, t).map(|v| -v))
    };
    match found {
        None => (r, t),
        Some(Convention::Inverted) => back((r, t)),
        Some(Convention::OtherAxes) => axes((r, t)),
        Some(Convention::InvertedWithOtherAxes) => back(axes((r, t))),
    }
}

#[test]
fn poses_of_another_convention_are_recognised_by_their_points() {
    for found in Convention::ALL {
        // Where keypoints have another scale than the camera, tracks reveal the convention.
        for keypoints in [Some(1.0), Some(4.0), None] {
            let mut folder = scene();
            for image in &mut folder.images {
                let (r, t) = written(image, Some(found));
                (image.quaternion, image.translation) = (quaternion(&r), t);
                match keypoints {
                    Some(scale) => image.keypoints.iter_mut().for_each(|(u, v, _)| (*u, *v) = (scale * *u, scale * *v)),
                    None => image.keypoints.clear(),
                }
            }
            match load_as(&folder, Split::None, false) {
                Err(Error::PosesInOtherConvention { file, what }) => {
                    assert!(file.ends_with("images.bin"));
                    assert_eq!((what.format, what.found), (Format::Colmap, found), "{keypoints:?}");
                }
                other => panic!("{found:?} {keypoints:?}: {:?}", other.map(|d| d.warnings)),
            }
        }
    }
}

fn transforms(folder: &std::path::Path, rows: impl Fn(&ImageRow) -> (Matrix, [f64; 3])) {
    let scene = scene();
    // Six times as many points, as a cloud without tracks.
    let all = |p: &PointRow| [0.0, 0.05, -0.05, 0.1, 0.15, -0.1].map(|d| p.position.map(|v| v + d));
    let points: Vec<[f64; 3]> = scene.points.iter().flat_map(all).collect();
    let mut ply = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nproperty \
         uchar red\n\
         property uchar green\nproperty uchar blue\nend_header\n",
        points.len()
    );
    points.iter().enumerate().for_each(|(i, [x, y, z])| ply += &format!("{x} {y} {z} {} 20 30\n", i % 200));
    std::fs::write(folder.join("points.ply"), ply).unwrap();
    let frame = |image: &ImageRow| {
        let (r, t) = rows(image);
        let row = |i: usize| format!("[{}, {}, {}, {}]", r[i][0], r[i][1], r[i][2], t[i]);
        format!(
            r#"{{"file_path": "{}", "transform_matrix": [{}, {}, {}, [0, 0, 0, 1]]}}"#,
            image.name,
            row(0),
            row(1),
            row(2)
        )
    };
    let frames: Vec<String> = scene.images.iter().map(frame).collect();
    let json = format!(
        r#"{{"camera_model": "PINHOLE", "fl_x": 80, "fl_y": 80, "cx": 48, "cy": 32, "w": 96, "h": 64, "ply_file_path": "points.ply",
            "frames": [{}]}}"#,
        frames.join(", ")
    );
    std::fs::write(folder.join("transforms.json"), json).unwrap();
}

#[test]
fn points_in_view_reveal_the_pose_convention_of_transforms_json() {
    let options = LoadOptions { split: Split::None, photographs: false, ..LoadOptions::default() };
    let folder = tempfile::tempdir().unwrap();
    // The convention of the format: camera to world with y up and z backwards.
    transforms(folder.path(), |image| written(image, Some(Convention::InvertedWithOtherAxes)));
    let sound = Dataset::load(folder.path(), &options).unwrap();
    assert_eq!(sound.warnings, []);
    for (file, found) in [
        (Some(Convention::OtherAxes), Convention::Inverted),
        (None, Convention::InvertedWithOtherAxes),
        (Some(Convention::Inverted), Convention::OtherAxes),
    ] {
        transforms(folder.path(), |image| written(image, file));
        match Dataset::load(folder.path(), &options) {
            Err(Error::PosesInOtherConvention { what, .. }) => {
                assert_eq!((what.format, what.found), (Format::Nerfstudio, found));
            }
            other => panic!("{found:?}: {:?}", other.map(|d| d.warnings)),
        }
    }
}

#[test]
fn real_scenes_stay_whole_and_as_large_as_their_farthest_camera() {
    for name in ["caliterra", "copr", "fox", "garfield", "lewis", "lund", "ochota", "seneca"] {
        let Some(folder) = common::data(name) else { continue };
        for split in [Split::Test, Split::Val, Split::None] {
            let dataset = Dataset::load(&folder, &LoadOptions { split, ..LoadOptions::default() }).unwrap();
            assert_eq!(dataset.warnings, [], "{name}");
            let views = dataset.views.len();
            let held_out = if split == Split::None { 0 } else { dataset.views_of(Role::HeldOut).count() };
            let unused = if split == Split::Val { views.div_ceil(8) } else { 0 };
            assert_eq!(dataset.views_of(Role::Train).count(), views - held_out - unused, "{name}");
            let far = dataset.views_of(Role::Train).map(|(_, view)| {
                let c = view.camera.center();
                (0..3).map(|k| (c[k] - dataset.frame.offset[k]).powi(2)).sum::<f64>().sqrt()
            });
            assert_eq!(dataset.extent, 1.1 * far.fold(0.0, f64::max), "{name}");
        }
    }
}
