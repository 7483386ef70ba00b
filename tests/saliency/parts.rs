//! Planes, settings, the split of a photograph, the cache.

use std::sync::Arc;

use psrgs_vk::dataset::Pixels;
use psrgs_vk::saliency::{Cache, Error, Gate, Plane, Settings, Spectrum, split};

use crate::images::{drawn, waves};

#[test]
fn images_that_are_none_are_refused() {
    assert_eq!(Plane::new(0, 3, vec![]), Err(Error::Empty { width: 0, height: 3 }));
    assert_eq!(Plane::new(2, 3, vec![0.0; 5]), Err(Error::Size { what: "the image", found: 5, expected: 6 }));
    assert!(matches!(Plane::new(1, 2, vec![0.0, f32::NAN]), Err(Error::NotFinite { index: 1, .. })));
    let cut = Pixels::Rgba8(vec![0; 12]);
    assert!(matches!(Plane::luma(2, 2, &cut), Err(Error::Size { found: 3, expected: 4, .. })));
    assert!(matches!(split(2, 2, &cut, &waves(2, 2, 1)), Err(Error::Size { found: 3, expected: 4, .. })));
}

#[test]
fn settings_that_make_no_sense_are_refused() {
    let image = waves(16, 16, 1);
    let with = |change: &dyn Fn(&mut Settings)| {
        let mut settings = Settings::default();
        change(&mut settings);
        [Spectrum::new(&image, &settings).err(), Gate::Random.mask(&image, 3.0, 0, &settings).err()]
    };
    type Change<'a> = &'a dyn Fn(&mut Settings);
    let cases: [(&str, Change<'_>); 6] = [
        ("side", &|s| s.side = 0),
        ("pad", &|s| s.pad = -0.1),
        ("epsilon", &|s| s.epsilon = 0.0),
        ("blur", &|s| s.blur = f64::NAN),
        ("share", &|s| s.share = 1.0),
        ("softness", &|s| s.softness = 0.0),
    ];
    for (name, change) in cases {
        for error in with(change) {
            assert!(matches!(error, Some(Error::Setting { name: n, .. }) if n == name), "{name}: {error:?}");
        }
    }
    for sigma in [-1.0, f64::NAN, f64::INFINITY] {
        for gate in Gate::ALL {
            assert!(gate.mask(&image, sigma, 0, &Settings::default()).is_err(), "{gate}, {sigma}");
        }
    }
    assert!(Spectrum::new(&image, &Settings::default()).expect("a spectrum").map(-1.0).is_err());
}

#[test]
fn gates_are_read_and_written_as_words() {
    for gate in Gate::ALL {
        assert_eq!(gate.to_string().parse(), Ok(gate));
        let json = serde_json::to_string(&gate).expect("JSON");
        assert_eq!(serde_json::from_str::<Gate>(&json).expect("a gate"), gate);
    }
    let error = "sharp".parse::<Gate>().expect_err("no gate");
    assert!(error.contains("`sharp`") && error.contains("gradient, random"), "{error}");
}

#[test]
fn luma_leaves_out_what_is_masked() {
    let rgba = vec![255, 0, 0, 255, 0, 255, 0, 255, 9, 9, 9, 0, 255, 255, 255, 255];
    let deep = rgba.iter().map(|v| 257 * u16::from(*v)).collect();
    let luma = Plane::luma(4, 1, &Pixels::Rgba8(rgba)).expect("an image");
    assert_eq!(Plane::luma(4, 1, &Pixels::Rgba16(deep)), Ok(luma.clone()));
    let want = [0.2126, 0.7152, (0.2126 + 0.7152 + 1.0) / 3.0, 1.0];
    for (found, want) in luma.values().iter().zip(want) {
        assert!((found - want).abs() < 1e-6, "{found} and {want}");
    }
    assert_eq!(Plane::luma(2, 1, &Pixels::Rgba8(vec![0; 8])).expect("an image").values(), [0.0, 0.0]);
}

#[test]
fn resizing_keeps_means_and_straight_lines() {
    let image = waves(48, 36, 3);
    let mean = |p: &Plane| p.values().iter().map(|v| f64::from(*v)).sum::<f64>() / p.values().len() as f64;
    for (width, height) in [(24, 18), (16, 12), (1, 1)] {
        let small = image.resized(width, height);
        assert_eq!((small.width(), small.height()), (width, height));
        // A triangle filter about each output weights inner pixels evenly, and border pixels 1.5 times.
        assert!((mean(&small) - mean(&image)).abs() < 0.02, "{} and {}", mean(&small), mean(&image));
    }
    let grey = Plane::new(31, 17, vec![0.3; 31 * 17]).expect("an image");
    assert!(grey.resized(12, 40).values().iter().all(|v| *v == 0.3));
    let line = drawn(32, 4, |x, _| x / 64.0).resized(64, 4);
    for x in 1..63 {
        assert!((line.values()[x] - (x as f32 / 2.0 - 0.25) / 64.0).abs() < 1e-6, "{x}");
    }
    assert_eq!(waves(600, 400, 1).reduced(256).width(), 384);
    assert_eq!(waves(60, 40, 1).reduced(256).width(), 60);
}

#[test]
fn both_parts_of_a_photograph_make_it_up() {
    let rgba: Vec<u8> = (0..4 * 12 * 8).map(|i| (i * 37 % 256) as u8).collect();
    let photograph = Pixels::Rgba8(rgba.clone());
    let [low, high] = split(12, 8, &photograph, &waves(6, 4, 2)).expect("two parts");
    for (i, (a, b)) in low.iter().zip(&high).enumerate() {
        let want = f32::from(rgba[i / 3 * 4 + i % 3]) / 255.0;
        assert!((a + b - want).abs() < 1e-6, "{i}: {a} + {b} and {want}");
    }
    let none = Plane::new(1, 1, vec![0.0]).expect("an image");
    assert!(split(12, 8, &photograph, &none).expect("two parts")[1].iter().all(|v| *v == 0.0));
}

#[test]
fn masks_are_made_once_for_each_sigma() {
    let images = vec![waves(40, 30, 1), waves(30, 40, 2), waves(20, 20, 3)];
    let settings = Settings::default();
    let cache = Cache::new(images.clone(), Gate::Spectral, 4, &settings).expect("a cache");
    cache.prepare(&[3.0, 4.0, 5.0]).expect("masks");
    let (first, version) = cache.get(1, 4.0).expect("a mask");
    assert_eq!(version, 1);
    assert_eq!(*first, Gate::Spectral.mask(&images[1], 4.0, 0, &settings).expect("a mask"));
    assert!(Arc::ptr_eq(&first, &cache.get(1, 4.0).expect("a mask").0));
    let (second, version) = cache.get(1, 4.5).expect("a mask");
    assert!(version == 2 && second != first);
    assert!(matches!(cache.get(3, 4.0), Err(Error::NoImage { index: 3, images: 3 })));
    assert!(matches!(cache.prepare(&[3.0]), Err(Error::Size { found: 1, expected: 3, .. })));
    assert!(cache.get(1, -2.0).is_err());
    assert_eq!(cache.get(1, 4.5).expect("a mask").1, 2);

    // Noise does not depend on sigma, and differs from image to image.
    let cache = Cache::new(vec![waves(20, 20, 3); 2], Gate::Random, 4, &settings).expect("a cache");
    let (first, _) = cache.get(0, 3.0).expect("a mask");
    assert!(Arc::ptr_eq(&first, &cache.get(0, 9.0).expect("a mask").0));
    assert_ne!(first, cache.get(1, 3.0).expect("a mask").0);
}
