//! The scene's frame.

use psrgs_vk::dataset::{Dataset, LoadOptions, Role, Split, Warning};
use psrgs_vk::format::ply;
use psrgs_vk::scene::Frame;

use super::colmap_folder::Folder;
use super::{NAMES, load};

#[test]
fn the_frame_is_that_of_the_training_cameras() {
    let folder = Folder::ring(&NAMES, [3.0, -4.0, 5.0]);
    let dataset = load(folder.dataset(false).path()).expect("loads");
    // "a.png" is held out: two cameras remain, at 120 and 240 degrees of the ring.
    let middle = [3.0 - 1.0, -4.0, 15.0];
    for (got, want) in dataset.frame.offset.iter().zip(middle) {
        assert!((got - want).abs() < 1e-12, "{got} {want}");
    }
    let reach = 2.0 * (std::f64::consts::TAU / 3.0).sin();
    assert!((dataset.extent - 1.1 * reach).abs() < 1e-12);
    assert!((dataset.frame.scale - 5.0 / dataset.extent).abs() < 1e-12);
    let all = LoadOptions { split: Split::None, photographs: false, ..LoadOptions::default() };
    let dataset = Dataset::load(folder.dataset(false).path(), &all).expect("loads");
    assert!((dataset.extent - 2.2).abs() < 1e-12);
}

#[test]
fn cameras_at_one_place_take_the_extent_of_the_points() {
    let folder = Folder::ring(&["only.png"], [50.0, 0.0, 0.0]);
    let dataset = load(folder.dataset(false).path()).expect("loads");
    assert_eq!(dataset.views[0].role, Role::Train);
    assert!(dataset.warnings.contains(&Warning::NothingHeldOut { views: 1 }));
    let extent = dataset.extent;
    assert!((10.0..10.7).contains(&extent), "the points are about 10 from the camera: {extent}");
    assert!(dataset.warnings.contains(&Warning::CamerasAtOnePlace { cameras: 1, extent }));
    assert_eq!(dataset.frame.scale, Frame::EXTENT / extent);

    let mut same = Folder::ring(&NAMES, [5e5, 4.6e6, 100.0]);
    for image in &mut same.images {
        image.translation = [-5e5, 4.6e6, 110.0];
        // A turn about the viewing axis changes the rounding of the centre.
        image.quaternion = [0.0, 1.0, 1e-3 * f64::from(image.id), 0.0];
        let (w, h) = (1.0, 1e-3 * f64::from(image.id));
        let (c, s) = ((w * w - h * h) / (w * w + h * h), 2.0 * w * h / (w * w + h * h));
        // Rows of the rotation [[c, s, 0], [s, -c, 0], [0, 0, -1]].
        image.translation = [-(c * 5e5 + s * 4.6e6), -(s * 5e5 - c * 4.6e6), 110.0];
    }
    let dataset = load(same.dataset(false).path()).expect("loads");
    assert!(dataset.warnings.iter().any(|w| matches!(w, Warning::CamerasAtOnePlace { cameras: 2, .. })));
    assert!((9.9..10.7).contains(&dataset.extent), "{}", dataset.extent);

    same.points.clear();
    let dataset = load(same.dataset(true).path()).expect("loads");
    assert_eq!(dataset.extent, 1.0);
}

/// A wrong pose 1e30 away must not enlarge the scene until every splat is a speck.
#[test]
fn a_far_camera_is_named_and_does_not_change_the_extent() {
    let names = ["a.png", "b.png", "c.png", "d.png", "e.png", "f.png"];
    let all = LoadOptions { split: Split::None, photographs: false, ..LoadOptions::default() };
    let load = |folder: &Folder| Dataset::load(folder.dataset(false).path(), &all).expect("loads");
    let mut folder = Folder::ring(&names, [3.0, -4.0, 5.0]);
    let sound = load(&folder);
    assert!(!sound.warnings.iter().any(|w| matches!(w, Warning::CameraFarAway { .. })), "{:?}", sound.warnings);
    for far in [1e3, 1e9, 1e30] {
        folder.images[3].translation[0] = far;
        let dataset = load(&folder);
        let named: Vec<&Warning> =
            dataset.warnings.iter().filter(|w| matches!(w, Warning::CameraFarAway { .. })).collect();
        match named[..] {
            [Warning::CameraFarAway { name, times }] => {
                assert_eq!(*name, folder.images[3].name);
                assert!((0.2 * far..2.0 * far).contains(times), "{far}: {times}");
            }
            _ => panic!("{far}: {named:?}"),
        }
        assert!((0.8..1.25).contains(&(dataset.extent / sound.extent)), "{far}: {} {}", dataset.extent, sound.extent);
    }
    // Ten times as far away as the other cameras.
    folder.images[3].translation[0] = 20.0;
    let dataset = load(&folder);
    assert!(dataset.warnings.iter().any(|w| matches!(w, Warning::CameraFarAway { .. })));
    assert!((0.8..1.25).contains(&(dataset.extent / sound.extent)), "{}", dataset.extent);
    // A little farther away than the other cameras: the camera is part of the extent.
    folder.images[3].translation[0] = -9.0;
    let dataset = load(&folder);
    assert!(!dataset.warnings.iter().any(|w| matches!(w, Warning::CameraFarAway { .. })));
    assert!(dataset.extent > 1.5 * sound.extent, "{}", dataset.extent);
}

#[test]
fn geo_referenced_coordinates_give_the_same_scene() {
    let shift = [5e5, 4.6e6, 100.0];
    let near = load(Folder::ring(&NAMES, [0.0; 3]).dataset(false).path()).expect("near");
    let far = load(Folder::ring(&NAMES, shift).dataset(false).path()).expect("far");
    assert!((near.frame.scale - far.frame.scale).abs() < 1e-8);
    for (a, b) in near.points.iter().zip(&far.points) {
        for (x, y) in near.frame.to_scene(a.position).iter().zip(far.frame.to_scene(b.position)) {
            assert!((x - y).abs() < 1e-8, "{x} {y}");
        }
    }
    for i in 0..3 {
        let (a, b) = (near.scene_camera(i).expect("camera"), far.scene_camera(i).expect("camera"));
        for (x, y) in a.translation.iter().zip(b.translation) {
            assert!((x - y).abs() < 1e-8, "{x} {y}");
        }
    }
    // Written as a model and read again: f32 coordinates plus offset give the points of the dataset.
    let root = tempfile::tempdir().expect("temporary folder");
    let file = root.path().join("point_cloud.ply");
    ply::save(&file, &far.first_gaussians().expect("points"), &far.frame, false).expect("written");
    let model = ply::read(&file).expect("read");
    for (mean, point) in model.gaussians.means.chunks_exact(3).zip(&far.points) {
        for (k, value) in mean.iter().enumerate() {
            let error = f64::from(*value) + model.shift[k] - point.position[k];
            assert!(error.abs() < 1e-6 * far.extent, "{error}");
        }
    }
    assert_eq!(near.frame.shift(), [0.0; 3]);
    assert_eq!(far.frame.shift(), far.frame.offset);
}
