//! The choice of source views.

use psrgs_vk::dataset::{Dataset, LoadOptions, Split};
use psrgs_vk::stereo::{Observations, StereoView, choose_sources, depth_range};

use super::colmap_folder::{Folder, PointRow};
use super::site::camera;

fn seen(points: Vec<[f64; 3]>, views: impl Fn(usize) -> Vec<u32>) -> Observations {
    let views = (0..points.len()).map(views).collect();
    Observations { points, views, ..Observations::default() }
}

fn points() -> Vec<[f64; 3]> {
    (0..40).map(|k| [0.05 * f64::from(k) - 1.0, 0.03 * f64::from(k % 7), 5.0]).collect()
}

#[test]
fn sources_share_points_at_useful_angles() {
    // At 5 units, 0.01 apart is a tenth of a degree, 1 apart is 11 degrees, 5 apart 45.
    let cameras = [0.0, 0.01, 1.0, 5.0, 1.2].map(|x| camera([x, 0.0, 0.0], [0.0; 2], 64, 48));
    let all = seen(points(), |_| vec![0, 1, 2, 3, 4]);
    let sources = choose_sources(&cameras, &all, 4);
    assert!(!sources[0].contains(&1), "no parallax: {sources:?}");
    assert_eq!(sources[0].len(), 3);
    assert_eq!(sources[0][2], 3, "a wide angle comes last: {sources:?}");
    assert_eq!(choose_sources(&cameras, &all, 2)[0].len(), 2);
    // A view that shares more points is better.
    let some = seen(points(), |p| if p < 30 { vec![0, 2] } else { vec![0, 2, 4] });
    assert_eq!(choose_sources(&cameras, &some, 4)[0], [2, 4]);
}

#[test]
fn views_without_overlap_or_parallax_have_no_sources() {
    let apart = [0.0, 1.0, 2.0].map(|x| camera([x, 0.0, 0.0], [0.0; 2], 64, 48));
    let alone = seen(points(), |p| vec![p as u32 % 3]);
    assert!(choose_sources(&apart, &alone, 4).iter().all(Vec::is_empty));
    let turned = [0.0, 0.1, 0.2].map(|angle| camera([0.3, 0.0, 0.0], [angle, 0.0], 64, 48));
    let all = seen(points(), |_| vec![0, 1, 2]);
    assert!(choose_sources(&turned, &all, 4).iter().all(Vec::is_empty));
    assert!(choose_sources(&apart[..1], &seen(points(), |_| vec![0]), 4)[0].is_empty());
    assert!(choose_sources(&[], &Observations::default(), 4).is_empty());
}

#[test]
fn the_range_of_depths_is_that_of_the_points_without_outliers() {
    let depths = (0..1000).map(|k| 10.0 + 0.01 * f64::from(k)).chain([1e-3, 1e6, f64::NAN, -4.0, f64::INFINITY]);
    let [near, far] = depth_range(depths).unwrap();
    assert!((7.5..8.0).contains(&near) && (25.0..26.0).contains(&far), "{near} {far}");
    assert_eq!(depth_range([f64::NAN, -1.0]), None);
}

/// Eight cameras on a ring above 120 points, which the first `tracked` of the cameras observe by name.
fn ring(tracked: u32) -> Dataset {
    let names = ["a.png", "b.png", "c.png", "d.png", "e.png", "f.png", "g.png", "h.png"];
    let mut folder = Folder::ring(&names, [0.0; 3]);
    let first = folder.points[0].clone();
    let point = |i: u32| PointRow {
        id: u64::from(i) + 1,
        position: [0.2 * f64::from(i % 12) - 1.1, 0.2 * f64::from(i / 12) - 0.9, 0.05 * f64::from(i % 5)],
        track: (1..=tracked).map(|image| (image, i)).collect(),
        ..first.clone()
    };
    folder.points = (0..120).map(point).collect();
    folder.images.iter_mut().for_each(|image| image.keypoints.clear());
    let root = folder.dataset(false);
    Dataset::load(root.path(), &LoadOptions { split: Split::None, ..LoadOptions::default() }).unwrap()
}

#[test]
fn photographs_without_observations_have_sources_by_geometry() {
    let chosen: Vec<usize> = (0..8).collect();
    let sources = |dataset: &Dataset| {
        let seen = Observations::of(dataset, &chosen, 0);
        let cameras: Vec<_> = chosen.iter().map(|i| dataset.scene_camera(*i).unwrap()).collect();
        (choose_sources(&cameras, &seen, 4), seen)
    };
    let (by_tracks, whole) = sources(&ring(8));
    assert!(whole.assumed.is_empty());
    let (mixed, some) = sources(&ring(3));
    assert_eq!(some.assumed, [3, 4, 5, 6, 7]);
    assert!(mixed.iter().all(|of| of.len() == 4), "{mixed:?}");
    assert!(some.views.iter().all(|views| views[..3] == [0, 1, 2]), "known observations changed");
    // All points lie in all photographs: geometry gives the sources of complete tracks.
    assert_eq!((mixed, some.views), (by_tracks, whole.views));
}

#[test]
fn assumed_observations_are_no_measurements() {
    let dataset = ring(3);
    let chosen: Vec<usize> = (0..8).collect();
    let seen = Observations::of(&dataset, &chosen, 0);
    let view = |i: &usize| StereoView {
        camera: dataset.scene_camera(*i).unwrap(),
        luma: Vec::new(),
        colours: Vec::new(),
        sources: Vec::new(),
        depths: [0.1, 1.0],
        start: psrgs_vk::stereo::InitialPlanes::Random,
        wanted: None,
    };
    let observed = seen.observed_by(&chosen.iter().map(view).collect::<Vec<_>>(), 3);
    assert_eq!(observed.iter().map(Vec::len).collect::<Vec<_>>(), [120, 120, 120, 0, 0, 0, 0, 0]);
}
