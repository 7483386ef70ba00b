//! What a model begins with on the surfaces that stereo has found.

use psrgs_vk::dataset::HostShare;
use psrgs_vk::train::settings::DepthPrior;
use psrgs_vk::train::{self, prepare, take_stereo};

use super::common;
use super::memory::world;

/// Splats on surfaces differ from round ones of reconstructed points by just what is asked for, and those of the points by nothing.
#[test]
fn splats_on_surfaces_begin_as_wide_flat_and_opaque_as_asked_for() {
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
        let share = HostShare::unlimited();
        let initial = prepare::initial(&dataset, None, 0).expect("points");
        let mut input = prepare::input_within(&dataset, initial, share).expect("decoded");
        let report = take_stereo(&gpu, &dataset, &mut input, &settings, &share, true).expect("matched");
        assert!(report.splats > 50, "{report:?}");
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
