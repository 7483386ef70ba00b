//! `--bands`: steps that see a part of their photograph.

use psrgs_vk::train::settings::{Growth, Settings};
use psrgs_vk::train::{Input, Pacing, Residency};

use super::common::{self, plane_scene};
use super::{Run, assert_same, run, settings, stops_and_resumes_on};

/// Rows of the photographs: three bands have 48, 48 and 64 rows.
const ROWS: u32 = 160;
const OF_THREE: [f32; 3] = [48.0 / 160.0, 48.0 / 160.0, 64.0 / 160.0];

fn input(views: usize) -> Input {
    plane_scene::input(views, 48, ROWS, 300)
}

/// One photograph, and splats that cover all of it, so that no pixel is near a cut-off, which rounding decides. Splats
/// are not round, because rotations of round splats have no gradient.
fn seen_everywhere() -> Input {
    let mut input = plane_scene::input(1, 48, ROWS, 12);
    input.initial.opacities.fill(-2.0);
    for (k, scale) in input.initial.scales.iter_mut().enumerate() {
        *scale = 6.0_f32.ln() + [0.0, 0.3, 0.5][k % 3];
    }
    input
}

/// Nothing moves, and the moments of the optimiser give the gradients.
fn still(bands: u32, steps: u32) -> Settings {
    let mut settings = settings(steps);
    (settings.run.bands, settings.density.no_densify) = (bands, true);
    // Without SSIM, whose windows cross the ends of bands: absolute differences are sums over pixels.
    settings.optimiser.lambda_dssim = 0.0;
    let optimiser = &mut settings.optimiser;
    (optimiser.lr_means, optimiser.lr_means_final) = (1e-30, 1e-30);
    for rate in [
        &mut optimiser.lr_scales,
        &mut optimiser.lr_rotations,
        &mut optimiser.lr_opacities,
        &mut optimiser.lr_sh_base,
        &mut optimiser.lr_sh_rest,
    ] {
        *rate = 0.0;
    }
    settings
}

/// The gradient of each step but the last, and the losses.
fn summed(gpu: &psrgs_vk::vk::Gpu, input: &Input, bands: u32) -> (Vec<[Vec<f64>; 8]>, Vec<f32>) {
    let mut before: [Vec<f64>; 8] = Default::default();
    let (mut gradients, mut losses) = (Vec::new(), Vec::new());
    for steps in 2..=bands + 1 {
        let run = run(gpu, input.clone(), &still(bands, steps), Pacing::default());
        let now = run.state.moments[0].clone().map(|plane| plane.into_iter().map(f64::from).collect::<Vec<_>>());
        // The first moment m' = 0.9 m + 0.1 g.
        let gradient = std::array::from_fn(|k| {
            let old = before[k].iter().copied().chain(std::iter::repeat(0.0));
            now[k].iter().zip(old).map(|(new, old)| (new - 0.9 * old) / 0.1).collect()
        });
        gradients.push(gradient);
        (before, losses) = (now, run.losses);
    }
    (gradients, losses)
}

#[test]
fn bands_add_up_to_the_photograph() {
    let Some(gpu) = common::gpu() else { return };
    let input = seen_everywhere();
    let (whole, loss) = summed(&gpu, &input, 1);
    let (parts, losses) = summed(&gpu, &input, 3);
    assert_eq!((whole.len(), parts.len()), (1, 3));
    // A band's loss is the mean over its own pixels.
    let together: f32 = losses.iter().zip(OF_THREE).map(|(loss, share)| loss * share).sum();
    assert!((together / loss[0] - 1.0).abs() < 1e-5, "losses {losses:?} for {loss:?}");
    for k in 0..5 {
        let most = whole[0][k].iter().fold(0.0, |most: f64, g| most.max(g.abs()));
        assert!(most > 0.0, "plane {k}");
        for (i, want) in whole[0][k].iter().enumerate() {
            let got: f64 = parts.iter().map(|part| part[k][i]).sum();
            assert!((got - want).abs() < 2e-5 * most, "plane {k}, value {i}: {got} for {want}, largest {most}");
        }
        // Each band contributes.
        assert!(parts.iter().all(|part| part[k].iter().any(|g| g.abs() > 0.01 * most)), "plane {k}");
    }
}

/// Sampled growth with weights of masks and errors, weights by mask, steps of visible splats, exposures, and steps that
/// see several photographs, the last of which whole.
fn all_that_bands_pass(bands: u32) -> Settings {
    let mut settings = settings(66);
    settings.run.bands = bands;
    settings.density.growth = Growth::Sampled;
    (settings.density.sample_mask_share, settings.density.sample_error_share) = (0.3, 0.3);
    (settings.frequencies.low_stage, settings.frequencies.low_texture_weight) = (0.4, 0.5);
    (settings.texture.lambda_perceptual, settings.texture.perceptual_every) = (0.02, 7);
    settings.texture.perceptual_views = 3;
    settings.shortcuts.visible_adam = true;
    settings.optimiser.exposure = psrgs_vk::train::settings::Exposure::Affine;
    settings
}

#[test]
fn bands_train_the_same_streamed_and_replayed_and_resumed() {
    let Some(gpu) = common::gpu() else { return };
    let mut input = input(4);
    // A photograph with rows for a single band.
    input.train[2] = plane_scene::input(4, 56, 40, 0).train[2].clone();
    let settings = all_that_bands_pass(3);
    let resident = Pacing { photographs: Residency::Resident, ..Pacing::default() };
    let truth = run(&gpu, input.clone(), &settings, resident);
    assert!(truth.changed > 0);
    let streamed = Pacing { photographs: Residency::Streamed, decoded_ahead: 2, decoders: 2, ..Pacing::default() };
    for (pacing, what) in [
        (streamed, "streamed"),
        (Pacing { splat_capacity: 301, pair_capacity: 64, ..resident }, "replayed"),
        (Pacing { splat_capacity: 301, pair_capacity: 64, ..streamed }, "streamed and replayed"),
    ] {
        let got = run(&gpu, input.clone(), &settings, pacing);
        assert_same(&truth.state, &got.state, what);
        assert_eq!(truth.losses, got.losses, "{what}");
    }
    stops_and_resumes_on(&gpu, &settings, &input, &[7, 8, 31]);
}

#[test]
fn bands_learn_what_photographs_show() {
    let Some(gpu) = common::gpu() else { return };
    let mut of_bands = settings(120);
    of_bands.run.bands = 2;
    of_bands.density.densify_until = 80;
    let Run { losses, changed, .. } = run(&gpu, input(5), &of_bands, Pacing::default());
    assert_eq!(losses.len(), 120);
    let mean = |x: &[f32]| x.iter().sum::<f32>() / x.len() as f32;
    let (first, last) = (mean(&losses[..10]), mean(&losses[110..]));
    assert!(last < 0.7 * first && changed > 0, "loss {first} -> {last}, {changed} changed");
}
