//! Growth near a cloud, with depths and normals of the cloud, in whole trainings.

use std::sync::Arc;

use psrgs_vk::train::cloud::{ProximityIndex, maps};
use psrgs_vk::train::settings::{LidarCloud, Method};
use psrgs_vk::train::{Input, Pacing, Settings};

use super::common::{gpu, plane_scene};
use super::{assert_same, run, settings, stops_and_resumes_on};

/// Largest distance of new splats from the cloud.
const WITHIN: f64 = 0.1;

fn rsgs(iterations: u32) -> Settings {
    let mut s = settings(iterations);
    s.density.lidar = Some(LidarCloud::File("ground.las".into()));
    s.density.lidar_distance = WITHIN / 5.0;
    s.geometry.stereo_side = 32;
    Method::Rsgs.apply(&mut s, |_| false);
    s
}

/// Points of the ground where x is negative.
fn half(input: &mut Input, settings: &Settings) {
    let at = |k: u32| (f64::from(k) + 0.5) * 0.05 - 3.0;
    let cloud: Vec<[f64; 3]> = (0..60 * 120).map(|k| [at(k % 60), at(k / 60), 0.0]).collect();
    let reduced = |view: &psrgs_vk::train::View| {
        let (width, height) = settings.geometry.prior_size(view.camera.width, view.camera.height);
        view.camera.resized(width, height)
    };
    let cameras: Vec<_> = input.train.iter().map(reduced).collect();
    input.optional.priors = maps(&cameras, &cloud).into_iter().map(Some).collect();
    input.optional.gate = ProximityIndex::new(&cloud, WITHIN).map(Arc::new);
}

#[test]
fn splats_grow_near_the_cloud_alone_and_every_run_is_the_same() {
    let Some(gpu) = gpu() else { return };
    let settings = rsgs(60);
    let free = plane_scene::input(5, 64, 48, 300);
    let mut kept = free.clone();
    half(&mut kept, &settings);
    assert!(kept.optional.priors.iter().flatten().all(|p| p.share() > 0.05), "the views see the cloud");
    let [first, without] = [&kept, &free].map(|i| run(&gpu, i.clone(), &settings, Pacing::default()));
    // New splats on either side. Children of splats at the edge may lie slightly beyond the edge.
    let grown = |run: &super::Run, side: f32| {
        let new = run.state.ids.iter().zip(run.state.params[0].chunks_exact(3)).filter(|(id, _)| **id >= 300);
        new.filter(|(_, mean)| side * mean[0] > 0.5).count()
    };
    assert!(grown(&without, 1.0) > 20 && grown(&without, -1.0) > 20, "without a cloud all grow");
    assert!(grown(&first, -1.0) > 20, "{} new ones near the cloud", grown(&first, -1.0));
    assert_eq!(grown(&first, 1.0), 0, "far from the cloud");
    // With many events in flight, and with buffers that have to grow.
    let tight = Pacing { events_in_flight: 7, splat_capacity: 301, pair_capacity: 64, ..Pacing::default() };
    let second = run(&gpu, kept, &settings, tight);
    assert!(second.grown >= 2);
    assert_same(&first.state, &second.state, "a repetition");
    assert_eq!(first.losses, second.losses);
}

#[test]
fn growth_near_a_cloud_stops_and_resumes_bit_equal() {
    let Some(gpu) = gpu() else { return };
    let settings = rsgs(50);
    let mut input = plane_scene::input(5, 64, 48, 300);
    half(&mut input, &settings);
    stops_and_resumes_on(&gpu, &settings, &input, &[14, 15, 30]);
}

#[test]
fn rsgs_asks_for_a_cloud_and_says_where_it_had_none() {
    let mut s = Settings::of_method(Method::Rsgs);
    let error = s.check().expect_err("no cloud").to_string();
    assert!(error.starts_with("lidar must be") && error.contains("`mvs`") && error.contains("LAZ"), "{error}");
    for (cloud, name) in [(LidarCloud::Mvs, "rsgs (MVS cloud, no LiDAR)"), (LidarCloud::File("a".into()), "rsgs")] {
        s.density.lidar = Some(cloud);
        s.check().expect("a cloud");
        assert_eq!(s.method_name(), name);
    }
    assert_eq!("mvs".parse(), Ok(LidarCloud::Mvs));
    assert_eq!("./mvs".parse(), Ok(LidarCloud::File("./mvs".into())));
}
