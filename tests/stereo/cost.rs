//! What stereo costs, and how it is made to fit.

use psrgs_vk::stereo::{Budget, Settings};

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
    // Nothing is too little: it gets as cheap as it can.
    let least = Budget { samples: 0.0 }.fitting(&settings, 160, 10, 640, 480);
    assert_eq!((least.max_side, least.sources, least.iterations, least.rounds), (16, 2, 1, 0));
}
