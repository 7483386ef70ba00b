//! Which views are compared.

use psrgs_vk::stereo::{Observations, choose_sources, depth_range};

use super::site::camera;

fn seen(points: Vec<[f64; 3]>, views: impl Fn(usize) -> Vec<u32>) -> Observations {
    let views = (0..points.len()).map(views).collect();
    Observations { points, views, drawn: false }
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
    // What shares more points is better.
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
