//! The cost of stereo, and settings that fit a budget.

use psrgs_vk::stereo::{Budget, Settings};
use psrgs_vk::train::{self, stereo_settings};

/// The cost of stereo is limited by the steps: short trainings on many photographs reduce settings, and the measured
/// trainings do not.
#[test]
fn stereo_fits_the_time_of_the_steps() {
    let taken = |views: usize, size: (u32, u32), iterations: u32, share: f64| {
        let mut training = train::Settings::default();
        training.run.iterations = iterations;
        training.geometry.stereo_share = share;
        let settings = stereo_settings(&training, vec![size; views]);
        (Budget::samples(&settings, views, size.0, size.1), settings, training.geometry.stereo())
    };
    for (views, size) in [(65, (320, 240)), (43, (180, 320)), (33, (320, 214)), (56, (320, 240))] {
        let (_, found, asked) = taken(views, size, 1500, 0.12);
        assert_eq!(found, asked, "{views} photographs of {size:?}");
    }
    let mut before = f64::INFINITY;
    for iterations in [30_000, 2000, 500, 100] {
        let (samples, found, asked) = taken(2000, (1600, 1200), iterations, 0.12);
        let allowed = 0.12 * f64::from(iterations) * 80.0 * (1600.0 * 1200.0 + 76_800.0);
        assert!(samples <= allowed.max(1e9) && samples <= before, "{iterations} steps: {samples}, {found:?}");
        assert!(found.max_side >= 16 && found.max_side <= asked.max_side);
        before = samples;
    }
    assert!(before < 0.2 * taken(2000, (1600, 1200), 30_000, 0.12).0, "{before}");
    // Stereo has a few seconds, however few the steps.
    assert_eq!(taken(9, (96, 72), 1, 0.12).1.max_side, train::Settings::default().geometry.stereo_side.min(96));
    assert_eq!(stereo_settings(&train::Settings::default(), []), train::Settings::default().geometry.stereo());
}

#[test]
fn samples_are_counted_and_settings_made_to_fit() {
    let settings = Settings {
        max_side: 320,
        sources: 3,
        taps: 5,
        iterations: 2,
        first_draws: 2,
        draws: 3,
        rounds: 1,
        ..Settings::default()
    };
    // 1 + 2 hypotheses, then 8 + 3 in each of two sweeps, 1 + 8 + 3 in the second round; 3 sources; 25 taps.
    assert_eq!(settings.samples_per_pixel(4), 37 * 3 * 25);
    assert_eq!(settings.samples_per_pixel(2), 37 * 2 * 25);
    assert_eq!(settings.size(640, 480), (320, 240));
    assert_eq!(settings.size(200, 100), (200, 100));
    assert_eq!(settings.size(100, 3000), (11, 320));
    let all = Budget::samples(&settings, 10, 640, 480);
    assert_eq!(all, 10.0 * 320.0 * 240.0 * 2775.0);

    let same = Budget { samples: all }.fitting(&settings, 100, 10, 640, 480);
    assert_eq!(same, settings);
    let mut before = all;
    for share in [0.5, 0.1, 0.03, 0.005] {
        let fitted = Budget { samples: share * all }.fitting(&settings, 160, 10, 640, 480);
        let costs = Budget::samples(&fitted, 10, 640, 480);
        fitted.check().unwrap();
        assert!(costs <= share * all && costs < before, "{share}: {fitted:?}");
        before = costs;
    }
    let little = Budget { samples: 0.3 * all }.fitting(&settings, 160, 10, 640, 480);
    assert!(little.max_side >= 160 && little.iterations == 2 && little.sources == 3);
    // With a budget of nothing, settings are as cheap as possible.
    let least = Budget { samples: 0.0 }.fitting(&settings, 160, 10, 640, 480);
    assert_eq!((least.max_side, least.sources, least.iterations, least.rounds), (16, 2, 1, 0));
}
