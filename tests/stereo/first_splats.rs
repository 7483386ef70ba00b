//! The first splats of a model on surfaces from stereo.

use psrgs_vk::dataset::{Dataset, HostShare};
use psrgs_vk::saliency::Gate;
use psrgs_vk::scene::Gaussians;
use psrgs_vk::train::settings::{Density, DepthPrior, Spacing, Start};
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
        settings.geometry.start = Start::Stereo;
        settings.geometry.stereo_side = 48;
        settings.geometry.stereo_splats = 200;
        settings.geometry.stereo_width = width;
        settings.geometry.stereo_thickness = thickness;
        settings.geometry.stereo_opacity = opacity;
        let (report, input) = found(&gpu, &dataset, &settings, true);
        assert!(report.splats > 50 && report.reduced_to.is_none(), "{report:?}");
        ([report.splats, report.contradicted], input.initial)
    };
    let ([count, contradicted], plain) = begun(1.0, 1.0, 0.1);
    let (again, asked) = begun(0.5, 0.25, 0.75);
    let points = plain.len() - count;
    assert_eq!((again, points), ([count, contradicted], dataset.points.len() - contradicted));
    assert!(contradicted > 0 && 20 * contradicted < dataset.points.len(), "{contradicted} of the wrong points");
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

/// Splats on reconstructed points begin with the opacity and the width of points, and those on surfaces with their own.
#[test]
fn points_beside_surfaces_begin_as_points_do() {
    let Some(gpu) = common::gpu() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dataset = world(folder.path(), 96);
    let begun = |opacity: f64, width: f64| {
        let mut settings = train::Settings::default();
        settings.geometry.start = Start::Stereo;
        settings.geometry.stereo_side = 48;
        settings.geometry.stereo_splats = 200;
        (settings.geometry.first_opacity, settings.geometry.first_width) = (opacity, width);
        let (report, input) = found(&gpu, &dataset, &settings, true);
        (input.initial.len() - report.splats, input.initial)
    };
    let ((points, plain), (_, asked)) = (begun(0.1, 1.0), begun(0.5, 0.25));
    for i in 0..plain.len() {
        let (opacity, width) = if i < points { (0.5, 0.25) } else { (0.1, 1.0) };
        let got = 1.0 / (1.0 + (-f64::from(asked.opacities[i])).exp());
        assert!((got - opacity).abs() < 1e-6, "splat {i}: {got}");
        let ratio = f64::from(asked.scales[3 * i] - plain.scales[3 * i]).exp();
        assert!((ratio / width - 1.0).abs() < 1e-5, "splat {i}: {ratio}");
    }
}

/// Splats along the edges of the photographs lie where round ones do, and cover as much.
#[test]
fn splats_along_edges_keep_places_and_areas() {
    let Some(gpu) = common::gpu() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dataset = world(folder.path(), 96);
    let begun = |axes: f64| {
        let mut settings = train::Settings::default();
        settings.geometry.start = Start::Stereo;
        settings.geometry.stereo_side = 48;
        settings.geometry.stereo_splats = 200;
        settings.geometry.stereo_thickness = 0.25;
        settings.geometry.stereo_axes = axes;
        let (report, input) = found(&gpu, &dataset, &settings, true);
        (input.initial.len() - report.splats, input.initial)
    };
    let ((points, round), (_, long)) = (begun(0.0), begun(1.0));
    assert_eq!((&long.means, &long.scales[..3 * points]), (&round.means, &round.scales[..3 * points]));
    let rows = |splats: &Gaussians| -> Vec<[f32; 3]> {
        splats.scales.chunks_exact(3).skip(points).map(|s| [s[0], s[1], s[2]]).collect()
    };
    let mut narrow = 0;
    for (now, before) in rows(&long).iter().zip(rows(&round)) {
        assert!((now[0] + now[1] - before[0] - before[1]).abs() < 1e-4 && now[2] == before[2], "{now:?} {before:?}");
        assert!((1.0 / 3.0 - 1e-4..1.0 + 1e-4).contains(&f64::from(now[1] - now[0]).exp()), "{now:?}");
        narrow += usize::from(now[1] - now[0] < 0.7_f32.ln());
    }
    assert!(narrow > 20, "{narrow}");
}

#[test]
fn the_first_splats_leave_room_to_grow() {
    let mut settings = train::Settings::default();
    let more = |settings: &train::Settings, asked: f64, fit: u32| splats_on_surfaces(1000, asked, fit, settings);
    assert_eq!([0.0, 0.4, 300.2].map(|asked| more(&settings, asked, 1 << 20)), [0, 0, 300]);
    assert_eq!(more(&settings, 486.0, 2800), 400, "half of what fits is for growth");
    settings.geometry.stereo_splats = 300;
    assert_eq!([0.0, 1e9].map(|asked| more(&settings, asked, 10)), [300; 2], "a number is a number");
    settings.geometry.stereo_splats = 0;
    let under = |most: u32, recycle_share: f64| {
        let density = Density { max_splats: Some(most), recycle_share, ..settings.density.clone() };
        more(&train::Settings { density, ..settings.clone() }, 486.0, 1 << 20)
    };
    assert_eq!([2600, 10].map(|most| under(most, 0.0)), [300, 0]);
    assert_eq!([2600, 1486].map(|most| under(most, 0.2)), [486, 486], "growth takes the room of the lightest");
    assert_eq!([900, 800, 10, 1].map(|most| under(most, 0.2)), [450, 400, 5, 0], "points leave half");
    assert_eq!(longer_side([(320, 240), (180, 360)]), 340.0);
    assert_eq!(longer_side([]), 0.0);
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
    settings.geometry.start = Start::Stereo;
    (settings.geometry.stereo_splats, settings.density.recycle_share) = (points as u32, 0.2);
    let (report, input) = found(&gpu, &dataset, &settings, true);
    assert_eq!((report.splats, input.initial.len()), (points / 4, points / 2));
}

/// Any method begins with as many splats as local frequencies ask for, whatever the spacing; the spacing is the method's.
#[test]
fn as_many_splats_begin_with_either_spacing() {
    let Some(gpu) = common::gpu() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dataset = world(folder.path(), 96);
    let begun = |spacing: Spacing, gate: Gate, begins: bool| {
        let mut settings = train::Settings::default();
        settings.geometry.start = Start::Stereo;
        settings.geometry.stereo_side = 48;
        settings.geometry.stereo_spacing = spacing;
        settings.frequencies.gate = gate;
        let (report, input) = found(&gpu, &dataset, &settings, begins);
        (report.splats, input.initial.means)
    };
    let (uniform, even) = begun(Spacing::Uniform, Gate::Spectral, true);
    let (frequency, uneven) = begun(Spacing::Frequency, Gate::Spectral, true);
    assert!(uniform > 50, "{uniform}");
    assert_eq!(uniform, frequency);
    assert_ne!(even, uneven, "they lie elsewhere");
    assert_eq!(begun(Spacing::Frequency, Gate::Spectral, true).1, uneven, "and there each time");
    assert_ne!(begun(Spacing::Frequency, Gate::Random, true).1, uneven, "the mask has a part");
    assert_eq!(begun(Spacing::Frequency, Gate::Spectral, false).0, 0, "a model from elsewhere has its splats");
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
