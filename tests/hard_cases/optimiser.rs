//! Steps of the optimiser and changes of density at which models could get stuck or vanish.

use psrgs_vk::pass::adam::{AdamSettings, Push};
use psrgs_vk::scene::{Frame, init};
use psrgs_vk::train::{Input, Pacing, Trainer};
use psrgs_vk::twin::Real;
use psrgs_vk::twin::adam::{Element, adam};

use super::common;
use super::common::plane_scene;
use super::training::{run, settings, state, tail, trained};

/// The longest step under a constant gradient, in units of the learning rate.
fn longest<R: Real>(gradient: f64, start: u32) -> f64 {
    let (mut param, mut first, mut second) = (R::zero(), R::zero(), R::zero());
    let mut longest = 0.0f64;
    for t in start..start + 10 {
        let before = param;
        let push = Push::new(&AdamSettings::default(), t, 1, 0, 1.0, 1.0);
        let element = Element { param: &mut param, first: &mut first, second: &mut second };
        adam(&push, R::of(1e-3), R::of(gradient), element);
        assert!(param.is_finite() && first.is_finite() && second.is_finite(), "gradient {gradient:e} at {t}");
        longest = longest.max((param.f64() - before.f64()).abs() / 1e-3);
    }
    longest
}

/// Adam divides a gradient by its own size: with an epsilon of 1e-15, the smallest noise moves a parameter as far as a
/// true gradient. A step is at most (1 - 0.9^k) / sqrt(1 - 0.999^k) learning rates: 1 from the start, 6.6 for rows that
/// are born late. The twin test of `adam` holds the device to the same bound.
#[test]
fn adam_at_tiny_and_huge_gradients() {
    for e in -25..=18 {
        for sign in [-1.0, 1.0] {
            let gradient = sign * 10f64.powi(e);
            for (start, most) in [(1, 1.01), (30_000, 6.6)] {
                let [single, double] = [longest::<f32>(gradient, start), longest::<f64>(gradient, start)];
                assert!(single <= most && double <= most, "gradient {gradient:e}: {single} and {double} rates");
                // Steps are shorter near the epsilon, and in f32 where the square is a denormal (below 3e-18).
                assert!(e < -12 || double > 0.99, "gradient {gradient:e}: {double} rates");
            }
        }
    }
    for gradient in [f64::NAN, f64::INFINITY, 1e19, -1e30] {
        assert_eq!(longest::<f32>(gradient, 1), 0.0, "gradient {gradient:e} must move nothing");
    }
}

/// At opacity 0.01 a splat shows up to 1.4 deviations from its centre; fainter splats show nowhere, get no gradient and
/// cannot recover. Training makes up for the cost of the reset.
#[test]
fn opacity_reset_recovery() {
    let Some(gpu) = common::gpu() else { return };
    let views = 5;
    let mut s = settings(200);
    // One reset, at step 60: a reset in the last steps would not recover.
    s.density.opacity_reset_interval = 60;
    s.density.densify_until = 100;
    s.density.max_splats = Some(1000);
    let mut trainer = Trainer::new(&gpu, plane_scene::input(views, 64, 48, 300), &s, Pacing::default(), None).unwrap();
    let before = run(&mut trainer, 60);
    let after = run(&mut trainer, 60 + 3 * views as u32);
    let now = state(&mut trainer);
    // The reset has cleared the moments of the opacities. Three passes over the photographs have filled those of
    // visible splats.
    let still = now.moments[0][3].iter().filter(|m| **m == 0.0).count() as f64 / now.splats() as f64;
    let (was, at_worst) = (tail(&before.losses, views), after.losses.iter().fold(0.0f32, |m, l| m.max(*l)));
    let rest = run(&mut trainer, u32::MAX);
    let end = tail(&rest.losses, views);
    println!(
        "opacity reset: loss {was:.4}, after it up to {at_worst:.4}, {end:.4} at the end, {:.1} % without gradient",
        100.0 * still
    );
    assert!(at_worst > 1.1 * was, "the reset shows: {was} and {at_worst}");
    assert!(still < 0.1, "{} of the opacities have no gradient", still);
    assert!(end < was, "{end} at the end, {was} before the reset");
}

/// One camera, and ten points: at one place, on a line, too large, or too faint to stay. Training runs to its end.
#[test]
fn all_pruned_and_degenerate_starts() {
    let Some(gpu) = common::gpu() else { return };
    let line: Vec<_> = (0..10).map(|i| ([0.1 * f64::from(i), 0.0, 0.0], [200; 3])).collect();
    let one_place = vec![([0.25, 0.25, 0.0], [90, 120, 30]); 10];
    let two_places: Vec<_> = (0..10).map(|i| ([0.5 * f64::from(i % 2), 0.0, 0.0], [10; 3])).collect();
    for (what, points) in [("a line", line), ("one place", one_place), ("two places", two_places)] {
        let initial = init::from_points(&points, &Frame::IDENTITY).unwrap();
        let first = plane_scene::input(1, 40, 30, 0);
        let input = Input { initial, extent: 1.0, ..first };
        let (mut trainer, told) = trained(&gpu, input, &settings(40));
        assert!(told.losses.len() == 40 && told.losses.iter().all(|l| l.is_finite()), "{what}");
        let end = state(&mut trainer);
        assert!(end.params.iter().flatten().all(|v| v.is_finite()), "{what}");
    }
    let mut large = plane_scene::splats(10);
    large.scales.fill(2.0);
    let mut faint = plane_scene::splats(10);
    faint.opacities.fill(-9.0);
    for (what, initial) in [("large", large), ("faint", faint)] {
        let mut s = settings(60);
        // Large splats are pruned by the changes after the first reset.
        s.density.opacity_reset_interval = 20;
        let (mut trainer, told) = trained(&gpu, Input { initial, ..plane_scene::input(1, 40, 30, 0) }, &s);
        assert!(told.losses.len() == 60 && told.losses.iter().all(|l| l.is_finite()), "{what}");
        assert_eq!(state(&mut trainer).splats(), 0, "{what}");
        assert!(told.warnings.iter().any(|w| w.contains("every splat was pruned")), "{what}: {:?}", told.warnings);
    }
    common::assert_no_messages(&gpu);
}

/// A splat of a hundred extents is drawn until the first density change that prunes by size. The other splats stay.
#[test]
fn giants_are_pruned_and_splats_that_grow_are_not_clipped() {
    let Some(gpu) = common::gpu() else { return };
    let mut input = plane_scene::input(4, 48, 36, 120);
    input.initial.scales[..3].fill(500.0f32.ln());
    let mut s = settings(60);
    s.density.opacity_reset_interval = 20;
    let mut trainer = Trainer::new(&gpu, input, &s, Pacing::default(), None).unwrap();
    run(&mut trainer, 16);
    assert!(state(&mut trainer).ids.contains(&0), "sizes count only after the first reset");
    let told = run(&mut trainer, u32::MAX);
    assert!(told.losses.iter().all(|l| l.is_finite()));
    let end = state(&mut trainer);
    assert!(!end.ids.contains(&0), "the giant is still there");
    assert!(end.splats() > 60, "{} splats left", end.splats());
    let largest = end.params[2].iter().fold(f32::MIN, |m, v| m.max(*v)).exp();
    assert!(largest < 50.0, "{largest}");
}
