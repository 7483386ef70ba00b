//! `--early-steps`: the first steps skip splats at higher alphas than later steps.

use psrgs_vk::raster::TileShape;
use psrgs_vk::train::Pacing;
use psrgs_vk::train::settings::Settings;

use super::common::{self, plane_scene};
use super::{assert_same, run, settings, stops_and_resumes_on};

const STEPS: u32 = 40;

fn early(share: f64) -> Settings {
    let mut settings = settings(STEPS);
    (settings.shortcuts.early_steps, settings.shortcuts.early_cutoff) = (share, 32);
    settings
}

#[test]
fn only_early_steps_use_the_early_alpha_cutoff() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(5, 64, 48, 300);
    for shape in [TileShape::Column, TileShape::Pixel] {
        let trained = |mut settings: Settings| {
            settings.blending.tile_shape = Some(shape);
            run(&gpu, input.clone(), &settings, Pacing::default())
        };
        let (everywhere, nowhere) = (trained(early(1.0)), trained(settings(STEPS)));
        assert_ne!(everywhere.losses, nowhere.losses, "{shape:?}");
        // Early steps with the usual cut-off change nothing.
        let mut usual = early(1.0);
        usual.shortcuts.early_cutoff = 255;
        let usual = trained(usual);
        assert_same(&nowhere.state, &usual.state, "the usual cut-off");
        assert_eq!(nowhere.losses, usual.losses);
        let half = trained(early(0.5));
        assert_eq!(everywhere.losses[..20], half.losses[..20], "{shape:?}");
        assert_ne!(everywhere.losses[20], half.losses[20], "{shape:?}");
        assert_same(&nowhere.state, &trained(early(0.0)).state, "none early");
    }
    common::assert_no_messages(&gpu);
}

#[test]
fn early_steps_end_in_the_same_step_when_replayed_and_resumed() {
    let Some(gpu) = common::gpu() else { return };
    let input = plane_scene::input(4, 64, 48, 300);
    let mut settings = early(0.6);
    settings.run.iterations = 66;
    let truth = run(&gpu, input.clone(), &settings, Pacing::default());
    assert!(truth.changed > 0);
    let tight = Pacing { events_in_flight: 8, splat_capacity: 301, pair_capacity: 64, ..Pacing::default() };
    let replayed = run(&gpu, input.clone(), &settings, tight);
    assert!(replayed.grown >= 2);
    assert_same(&truth.state, &replayed.state, "replayed");
    stops_and_resumes_on(&gpu, &settings, &input, &[7, 39, 40]);
}
