//! The first splats of a model on surfaces from stereo.

use psrgs_vk::dataset::{Dataset, HostShare};
use psrgs_vk::train::settings::{Density, DepthPrior};
use psrgs_vk::train::{self, Input, StereoReport, compute_stereo_priors, longer_side, prepare, splats_on_surfaces};
use psrgs_vk::vk::Gpu;

use super::common;
use super::memory::world;

/// The report of stereo for a training of the dataset, and the training's input.
fn found(gpu: &Gpu, dataset: &Dataset, settings: &train::Settings, begins: bool) -> (StereoReport, Input) {
    let share = HostShare::unlimited();
    let initial = prepare::initial(dataset, settings).expect("points");
    let mut input = prepare::input_within(dataset, initial, share).expect("decoded");
    let report = compute_stereo_priors(gpu, dataset, &mut input, settings, &share, begins).expect("matched");
    (report, input)
}

/// The settings of the shape change splats on surfaces alone, not the round splats of reconstructed points.
#[test]
fn splats_on_surfaces_begin_with_the_shape_that_is_asked_for() {
    let Some(gpu) = common::gpu() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dataset = world(folder.path(), 96);
    let begun = |width: f64, thickness: f64, opacity: f64| {
        let mut settings = train::Settings::default();
        settings.geometry.depth_prior = DepthPrior::Stereo;
        settings.geometry.stereo_side = 48;
        settings.geometry.stereo_splats = 200;
        settings.geometry.stereo_width = width;
        settings.geometry.stereo_thickness = thickness;
        settings.geometry.stereo_opacity = opacity;
        let (report, input) = found(&gpu, &dataset, &settings, true);
        assert!(report.splats > 50 && report.reduced_to.is_none(), "{report:?}");
        (report.splats, input.initial)
    };
    let (count, plain) = begun(1.0, 1.0, 0.1);
    let (again, asked) = begun(0.5, 0.25, 0.75);
    let points = plain.len() - count;
    assert_eq!((again, points), (count, dataset.points.len()));
    assert_eq!(asked.means, plain.means);
    for i in 0..plain.len() {
        let on_surface = i >= points;
        let ratio = |k: usize| f64::from(asked.scales[3 * i + k] - plain.scales[3 * i + k]).exp();
        let (across, along) = if on_surface { (0.5, 0.125) } else { (1.0, 1.0) };
        for (k, want) in [(0, across), (1, across), (2, along)] {
            assert!((ratio(k) / want - 1.0).abs() < 1e-5, "splat {i}, axis {k}: {}", ratio(k));
        }
        let opacity = 1.0 / (1.0 + (-f64::from(asked.opacities[i])).exp());
        assert!((opacity - if on_surface { 0.75 } else { 0.1 }).abs() < 1e-6, "splat {i}: {opacity}");
    }
}

#[test]
fn surfaces_that_fill_many_photographs_begin_with_more_splats() {
    let mut settings = train::Settings::default();
    let more = |settings: &train::Settings, surface: f64| splats_on_surfaces(1000, surface, 640.0, 1 << 20, settings);
    assert_eq!(more(&settings, 8.0), 0);
    settings.geometry.stereo_splats = 300;
    assert_eq!(more(&settings, 8.0), 300);
    settings.geometry.stereo_density = 100;
    assert_eq!([0.0, 2.0, 3.0, 4.86].map(|surface| more(&settings, surface)), [300, 300, 300, 486]);
    settings.geometry.stereo_densest = 150;
    assert_eq!([0.0, 0.5, 1.0, 2.0, 4.86].map(|surface| more(&settings, surface)), [0, 75, 150, 300, 486]);
    settings.geometry.stereo_densest = 0;
    assert_eq!(splats_on_surfaces(1000, 4.86, 640.0, 2800, &settings), 400, "no room is left to grow");
    assert_eq!(splats_on_surfaces(1000, 4.86, 640.0, 10, &settings), 300, "`stereo-splats` leaves no room");
    settings.density.max_splats = Some(2600);
    assert_eq!(more(&settings, 4.86), 300, "no room is left to grow");
    settings.density.max_splats = Some(10);
    assert_eq!(more(&settings, 1e9), 0);
    settings.density.recycle_share = 0.2;
    let under = |most: u32| {
        more(
            &train::Settings {
                density: Density { max_splats: Some(most), ..settings.density.clone() },
                ..settings.clone()
            },
            4.86,
        )
    };
    assert_eq!([2600, 1486].map(under), [486, 486], "with recycling no room has to be left");
    assert_eq!([900, 800, 10, 1].map(under), [450, 400, 5, 0], "surfaces get half of the limit");
}

/// Larger photographs show more detail of a surface.
#[test]
fn large_photographs_begin_with_more_splats() {
    assert_eq!(longer_side([(320, 240), (180, 360)]), 340.0);
    assert_eq!(longer_side([]), 0.0);
    let mut settings = train::Settings::default();
    let geometry = &mut settings.geometry;
    (geometry.stereo_splats, geometry.stereo_density, geometry.stereo_densest) = (300, 100, 150);
    let of = |settings: &train::Settings, surface: f64, fit: u32| {
        [0.0, 160.0, 320.0, 640.0, 4000.0].map(|side| splats_on_surfaces(1000, surface, side, fit, settings))
    };
    let all = 1 << 20;
    assert_eq!(of(&settings, 4.0, all), [400; 5], "as many at any size");
    settings.geometry.stereo_splats_for = 320;
    settings.run.iterations = 1750 * 13 * 13;
    assert_eq!(of(&settings, 4.0, all), [400, 400, 400, 800, 5000], "the number depends on the surface");
    assert_eq!(of(&settings, 2.0, all), [300, 300, 300, 600, 3750], "--stereo-splats");
    assert_eq!(of(&settings, 1.0, all), [150, 150, 150, 300, 1875], "--stereo-densest");
    assert_eq!(of(&settings, 4.0, 3200), [400, 400, 400, 600, 600], "no room is left to grow");
    assert_eq!(of(&settings, 2.0, 10), [300; 5], "the size lowers the named number");
    for (steps, at_most) in [(100, 1.0), (1750, 1.0), (7000, 2.0), (28_000, 4.0)] {
        settings.run.iterations = steps;
        let times = [1.0, 1.0, 1.0, 2.0, 12.5].map(|times: f64| times.min(at_most));
        assert_eq!(of(&settings, 4.0, all), times.map(|times| (400.0 * times) as u32), "{steps} steps");
    }
    settings.density.max_splats = Some(2500);
    assert_eq!(of(&settings, 4.0, all), [250; 5], "the limit holds at any size");
}

/// The limit of splats also holds for the first splats: of points and surfaces, and of points alone.
#[test]
fn no_more_splats_begin_than_are_allowed() {
    let Some(gpu) = common::gpu() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dataset = world(folder.path(), 96);
    let mut settings = train::Settings::default();
    settings.geometry.depth_prior = DepthPrior::Stereo;
    settings.geometry.stereo_side = 48;
    let points = dataset.points.len();
    settings.density.max_splats = Some(points as u32 / 2);
    let (report, input) = found(&gpu, &dataset, &settings, true);
    assert_eq!((report.splats, input.initial.len()), (0, points / 2));
    (settings.geometry.stereo_splats, settings.density.recycle_share) = (points as u32, 0.2);
    let (report, input) = found(&gpu, &dataset, &settings, true);
    assert_eq!((report.splats, input.initial.len()), (points / 4, points / 2));
}

/// With a density of splats, the surface that stereo finds decides their number.
#[test]
fn the_number_of_splats_goes_by_the_surface_that_was_found() {
    let Some(gpu) = common::gpu() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dataset = world(folder.path(), 96);
    let begun = |splats: u32, density: u32, begins: bool| {
        let mut settings = train::Settings::default();
        settings.geometry.depth_prior = DepthPrior::Stereo;
        settings.geometry.stereo_side = 48;
        (settings.geometry.stereo_splats, settings.geometry.stereo_density) = (splats, density);
        let (report, _) = found(&gpu, &dataset, &settings, begins);
        (report.splats, report.surface)
    };
    assert_eq!(begun(50, 0, true), (50, None));
    let (splats, surface) = begun(50, 1000, true);
    let surface = surface.expect("a surface");
    // The photographs overlap, and stereo at this size finds a depth in a part of the pixels.
    assert!(surface > 0.2 && surface < 4.5, "{surface} of 9 photographs at most");
    assert_eq!(splats, (1000.0 * surface).round() as usize);
    assert_eq!(begun(50, 1, true).0, 50, "the least number of splats");
    assert_eq!(begun(50, 1000, false), (0, None), "without splats from stereo nothing is counted");
}

/// Pixels that the mask calls texture have no depth; the others keep theirs.
#[test]
fn texture_is_left_out_where_that_is_asked_for() {
    let Some(gpu) = common::gpu() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dataset = world(folder.path(), 96);
    let known = |texture: f64| {
        let mut settings = train::Settings::default();
        settings.geometry.depth_prior = DepthPrior::Stereo;
        settings.geometry.stereo_side = 160;
        settings.geometry.stereo_texture = texture;
        let (report, input) = found(&gpu, &dataset, &settings, true);
        assert_eq!(report.reduced_to, None, "small photographs are matched as they are");
        let sizes: Vec<(u32, u32)> = input.train.iter().map(|v| (v.camera.width, v.camera.height)).collect();
        let priors = input.optional.priors.iter().zip(&sizes).map(|(prior, size)| {
            let (width, height) = settings.geometry.prior_size(size.0, size.1);
            let depth = prior.as_ref().map_or(vec![0.0; (width * height) as usize], |p| p.depth.clone());
            depth.into_iter().map(|d| d > 0.0).collect::<Vec<bool>>()
        });
        priors.collect::<Vec<_>>()
    };
    let (all, some) = (known(1.0), known(0.5));
    let count = |of: &[Vec<bool>]| of.iter().flatten().filter(|k| **k).count();
    let (before, after) = (count(&all), count(&some));
    // The mask's mean is 0.3: about as many pixels are above a half.
    assert!(after > before / 3 && after < before * 9 / 10, "{after} of {before}");
}
