//! Degenerate input.

use glam::DVec3;
use psrgs_vk::stereo::{Error, InitialPlanes, Matcher, Prior, Settings, StereoView, fuse};

use super::common;
use super::site::{Sheet, camera, cross, views};

fn run(views: &[StereoView]) -> Option<Vec<Prior>> {
    let gpu = common::gpu()?;
    let priors = Matcher::new(&gpu, &Settings::default()).unwrap().run(views, |_| ()).unwrap();
    for (prior, view) in priors.iter().zip(views) {
        assert_eq!(prior.depth.len(), view.pixels());
        assert_eq!(prior.normals.len(), view.pixels());
        let fine = |v: f32| v.is_finite() && v >= 0.0;
        assert!(prior.depth.iter().chain(&prior.confidence).all(|v| fine(*v)));
        assert!(prior.normals.iter().flatten().all(|v| v.is_finite()));
        assert!(prior.depth.iter().zip(&prior.confidence).all(|(d, c)| (*d > 0.0) == (*c > 0.0)));
    }
    Some(priors)
}

fn wall() -> Sheet {
    Sheet::plane(DVec3::NEG_Z, DVec3::new(0.0, 0.0, 3.0))
}

#[test]
fn views_from_one_place_say_nothing_and_do_no_harm() {
    let identical = [camera([0.0; 3], [0.0; 2], 24, 18); 3];
    let (same, _) = views(&[wall()], &identical, [1.0, 6.0]);
    let turned = [0.0, 0.05, -0.05].map(|a| camera([0.1; 3], [a, 0.0], 24, 18));
    let (rotation, _) = views(&[wall()], &turned, [1.0, 6.0]);
    for views in [same, rotation] {
        run(&views);
    }
}

#[test]
fn one_view_or_none_has_no_prior() {
    let (views, _) = views(&[wall()], &cross(0.3, 24, 18)[..1], [1.0, 6.0]);
    assert!(views[0].sources.is_empty());
    if let Some(priors) = run(&views) {
        assert_eq!(priors[0].share(), 0.0);
        assert!(fuse(&views, &priors, &Settings::default()).is_empty());
    }
    run(&[]);
}

#[test]
fn walls_without_texture_and_black_pictures_have_no_depth() {
    let flat = Sheet { contrast: 0.0, ..wall() };
    for sheets in [vec![flat], vec![]] {
        let (views, _) = views(&sheets, &cross(0.3, 24, 18), [1.0, 6.0]);
        if let Some(priors) = run(&views) {
            assert!(priors.iter().all(|prior| prior.share() == 0.0));
        }
    }
}

#[test]
fn cameras_that_look_away_from_each_other_agree_on_nothing() {
    let cameras = [camera([0.0; 3], [0.0; 2], 24, 18), camera([0.5, 0.0, 0.0], [3.0, 0.0], 24, 18)];
    let behind = Sheet::plane(DVec3::Z, DVec3::new(0.0, 0.0, -3.0));
    let (views, _) = views(&[wall(), behind], &cameras, [1.0, 6.0]);
    if let Some(priors) = run(&views) {
        assert!(priors.iter().all(|prior| prior.share() == 0.0));
    }
}

#[test]
fn tiny_pictures_and_pictures_of_several_sizes_are_matched() {
    let cameras = [
        camera([0.0; 3], [0.0; 2], 1, 1),
        camera([0.3, 0.0, 0.0], [0.0; 2], 2, 5),
        camera([0.0, 0.3, 0.0], [0.0; 2], 37, 29),
        camera([-0.3, 0.0, 0.0], [0.0; 2], 31, 40),
    ];
    let (views, _) = views(&[wall()], &cameras, [1.0, 6.0]);
    run(&views);
}

#[test]
fn only_wanted_pixels_are_matched() {
    let (mut views, _) = views(&[wall()], &cross(0.3, 48, 36), [1.5, 6.0]);
    let left = |p: usize| p % 48 < 24;
    views[0].wanted = Some((0..views[0].pixels()).map(left).collect());
    if let Some(priors) = run(&views) {
        let valid = |want: bool| (0..48 * 36).filter(|p| left(*p) == want && priors[0].depth[*p] > 0.0).count();
        assert!(valid(true) > 400, "{}", valid(true));
        assert_eq!(valid(false), 0);
    }
    views[0].wanted = Some(vec![false; 48 * 36]);
    if let Some(priors) = run(&views) {
        assert_eq!(priors[0].share(), 0.0);
        assert!(priors[1].share() > 0.3, "{}", priors[1].share());
    }
}

#[test]
fn what_does_not_fit_together_is_an_error() {
    let Some(gpu) = common::gpu() else { return };
    let matcher = Matcher::new(&gpu, &Settings::default()).unwrap();
    let (good, _) = views(&[wall()], &cross(0.3, 24, 18)[..2], [1.0, 6.0]);
    let refused = |change: &dyn Fn(&mut StereoView)| {
        let mut views = good.clone();
        change(&mut views[1]);
        matcher.run(&views, |_| ()).expect_err("an error")
    };
    assert!(matches!(refused(&|v| v.luma.truncate(5)), Error::Pixels { view: 1, what: "luma", .. }));
    assert!(matches!(refused(&|v| v.wanted = Some(vec![])), Error::Pixels { view: 1, .. }));
    assert!(matches!(refused(&|v| v.start = InitialPlanes::Hypotheses(vec![])), Error::Pixels { view: 1, .. }));
    assert!(matches!(refused(&|v| v.sources = vec![1]), Error::Source { view: 1, wrong: 1 }));
    assert!(matches!(refused(&|v| v.sources = vec![7]), Error::Source { view: 1, wrong: 7 }));
    for wrong in [
        Settings { sources: 5, ..Settings::default() },
        Settings { taps: 7, ..Settings::default() },
        Settings { taps: 4, step: 1, ..Settings::default() },
        Settings { sigma_luma: 0.0, ..Settings::default() },
        Settings { most_slanted: 90.0, ..Settings::default() },
    ] {
        assert!(matches!(Matcher::new(&gpu, &wrong), Err(Error::Setting { .. })), "{wrong:?}");
    }
}
