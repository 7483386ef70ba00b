//! Maps and masks of hard images, and their invariances.

use psrgs_vk::saliency::{Border, Gate, Plane, Settings, Spectrum};
use psrgs_vk::scene::random::Random;

use crate::images::{distance, drawn, index, patch, waves};

/// Images that have broken other programs, each with its name.
fn hard() -> Vec<(&'static str, Plane)> {
    let mut random = Random::new(3);
    let constant = |width, height, value: f32| {
        Plane::new(width, height, vec![value; (width * height) as usize]).expect("an image")
    };
    let mut impulse = vec![0.25; 40 * 30];
    impulse[12 * 40 + 17] = 1.0;
    vec![
        ("black", constant(32, 32, 0.0)),
        ("white", constant(17, 31, 1.0)),
        ("grey", constant(64, 5, 0.3)),
        ("one pixel", constant(1, 1, 0.7)),
        ("a row", drawn(9, 1, |x, _| x / 9.0)),
        ("a column", drawn(1, 7, |_, y| (y / 3.0).fract())),
        ("2 x 3", drawn(2, 3, |x, y| 0.2 * x + 0.3 * y)),
        ("3 x 2, one differs", drawn(3, 2, |x, y| if (x, y) == (1.0, 1.0) { 1.0 } else { 0.0 })),
        ("sides of prime lengths", waves(53, 37, 1)),
        ("an impulse", Plane::new(40, 30, impulse).expect("an image")),
        ("a checkerboard", drawn(32, 24, |x, y| (x + y) % 2.0)),
        ("squares of eight", drawn(64, 64, |x, y| ((x / 8.0).floor() + (y / 8.0).floor()) % 2.0)),
        ("a step", drawn(50, 20, |x, _| if x < 25.0 { 0.0 } else { 1.0 })),
        ("a slope", drawn(256, 9, |x, _| x / 256.0)),
        ("very dark", drawn(48, 48, |_, _| if random.unit() < 0.05 { 1.0 / 255.0 } else { 0.0 })),
        (
            "tiny values",
            Plane::new(20, 20, waves(20, 20, 4).values().iter().map(|v| v * 1e-37).collect()).expect("one"),
        ),
        ("huge values", Plane::new(20, 20, waves(20, 20, 4).values().iter().map(|v| v * 1e38).collect()).expect("one")),
    ]
}

#[test]
fn hard_images_have_finite_maps() {
    for border in [Border::Reflect, Border::Periodic] {
        let settings = Settings { border, ..Settings::default() };
        for (name, image) in hard() {
            for gate in Gate::ALL {
                for sigma in [0.0, 0.5, 3.0, 12.0, 300.0] {
                    let found = gate.mask(&image, sigma, 1, &settings).expect("a mask");
                    let what = format!("{gate} of {name} at {sigma}");
                    for plane in [&found.map, &found.mask] {
                        assert_eq!((plane.width(), plane.height()), (image.width(), image.height()), "{what}");
                        assert!(plane.values().iter().all(|v| v.is_finite() && *v >= 0.0), "{what}");
                    }
                    let mean =
                        |p: &Plane| p.values().iter().map(|v| f64::from(*v)).sum::<f64>() / p.values().len() as f64;
                    let (map, mask) = (mean(&found.map), mean(&found.mask));
                    assert!((map - 1.0).abs() < 1e-5 || map == 0.0, "{what}: {map}");
                    assert!(mask <= settings.share + 1e-5, "{what}: {mask}");
                    assert!(found.mask.values().iter().all(|v| *v <= 1.0), "{what}");
                }
            }
        }
    }
}

#[test]
fn one_colour_has_no_texture_and_a_photograph_its_share() {
    let settings = Settings::default();
    for (name, image) in hard() {
        let values = image.values();
        let flat = values.iter().all(|v| *v == values[0]);
        let spectrum = Spectrum::new(&image, &settings).expect("a spectrum");
        assert_eq!(spectrum.is_flat(), flat, "{name}");
        assert!(spectrum.features().0.iter().all(|f| f.is_finite()), "{name}");
        if flat {
            for gate in [Gate::Spectral, Gate::Phase, Gate::Gradient] {
                let mask = gate.mask(&image, 3.0, 0, &settings).expect("a mask").mask;
                assert!(mask.values().iter().all(|v| *v < 1e-6), "{gate} of {name}");
            }
        }
    }
    for gate in Gate::ALL {
        for share in [0.1, 0.3, 0.6] {
            let settings = Settings { share, ..Settings::default() };
            let mask = gate.mask(&waves(70, 64, 6), 3.0, 0, &settings).expect("a mask").mask;
            let mean = mask.values().iter().map(|v| f64::from(*v)).sum::<f64>() / mask.values().len() as f64;
            assert!((mean - share).abs() < 1e-6, "{gate}: {mean} for {share}");
        }
    }
}

fn map(image: &Plane, sigma: f64, settings: &Settings) -> Vec<f64> {
    Spectrum::new(image, settings).expect("a spectrum").map(sigma).expect("a map").values().to_vec()
}

#[test]
fn moving_a_pattern_that_repeats_moves_its_map() {
    let settings = Settings { border: Border::Periodic, blur: 10.0, ..Settings::default() };
    let image = waves(45, 32, 7);
    let shifted = |values: &[f64]| -> Vec<f64> {
        (0..32).flat_map(|y| (0..45).map(move |x| values[(y + 29) % 32 * 45 + (x + 11) % 45])).collect()
    };
    let values: Vec<f64> = image.values().iter().map(|v| f64::from(*v)).collect();
    let moved = Plane::new(45, 32, shifted(&values).iter().map(|v| *v as f32).collect()).expect("an image");
    for sigma in [0.0, 1.0, 3.0, 12.0] {
        let error = distance(&shifted(&map(&image, sigma, &settings)), &map(&moved, sigma, &settings));
        assert!(error < 1e-9, "{sigma}: {error}");
    }
}

#[test]
fn brightness_and_contrast_have_no_part_in_it() {
    for image in [waves(45, 32, 7), patch(64, 50, (30.0, 10.0), 20.0, 3)] {
        let dimmed = image.values().iter().map(|v| 0.125 * v + 0.5).collect();
        let dimmed = Plane::new(image.width(), image.height(), dimmed).expect("an image");
        for sigma in [0.0, 1.0, 3.0, 12.0] {
            let error = distance(&map(&image, sigma, &Settings::default()), &map(&dimmed, sigma, &Settings::default()));
            assert!(error < 1e-9, "{sigma}: {error}");
        }
        let features = |image| Spectrum::new(image, &Settings::default()).expect("a spectrum").features().0;
        assert!(distance(&features(&image), &features(&dimmed)) < 1e-9);
    }
}

#[test]
fn a_quarter_turn_turns_the_map() {
    let image = waves(45, 32, 9);
    // The row, counted from below, becomes the column.
    let turned = |values: &[f64]| -> Vec<f64> {
        (0..45).flat_map(|y| (0..32).map(move |x| values[(31 - x) * 45 + y])).collect()
    };
    let values: Vec<f64> = image.values().iter().map(|v| f64::from(*v)).collect();
    let other = Plane::new(32, 45, turned(&values).iter().map(|v| *v as f32).collect()).expect("an image");
    // Padding is symmetric only where it is even.
    let settings = Settings { border: Border::Periodic, ..Settings::default() };
    for sigma in [0.0, 3.0, 12.0] {
        let error = distance(&turned(&map(&image, sigma, &settings)), &map(&other, sigma, &settings));
        assert!(error < 1e-9, "{sigma}: {error}");
    }
}

#[test]
fn without_a_filter_the_phase_alone_is_left() {
    let image = waves(40, 40, 2);
    let settings = Settings::default();
    let of = |gate: Gate, sigma| gate.mask(&image, sigma, 0, &settings).expect("a mask");
    assert_eq!(of(Gate::Spectral, 0.0), of(Gate::Phase, 7.0));
    assert_ne!(of(Gate::Spectral, 3.0), of(Gate::Phase, 3.0));
    // The map converges to that of the phase as sigma falls.
    let near = distance(&map(&image, 1e-3, &settings), &map(&image, 0.0, &settings));
    assert!(near < 1e-4, "{near}");
}

#[test]
fn texture_is_told_from_shade() {
    let (at, side) = ((60.0, 30.0), 36.0);
    let image = patch(128, 96, at, side, 5);
    let settings = Settings { share: 0.1, ..Settings::default() };
    let contrast = |gate: Gate| {
        let mask = gate.mask(&image, 3.0, 0, &settings).expect("a mask").mask;
        let (mut inside, mut outside) = ((0.0, 0.0), (0.0, 0.0));
        for y in 0..96 {
            for x in 0..128 {
                let (dx, dy) = (f64::from(x) - at.0, f64::from(y) - at.1);
                let sum =
                    if (0.0..side).contains(&dx) && (0.0..side).contains(&dy) { &mut inside } else { &mut outside };
                *sum = (sum.0 + f64::from(mask.values()[index(&mask, x, y)]), sum.1 + 1.0);
            }
        }
        (inside.0 / inside.1, outside.0 / outside.1)
    };
    for gate in [Gate::Spectral, Gate::Phase, Gate::Gradient] {
        let (inside, outside) = contrast(gate);
        assert!(inside > 0.7 && outside < 0.05, "{gate}: {inside} inside, {outside} outside");
    }
    for gate in [Gate::Random, Gate::Off] {
        let (inside, outside) = contrast(gate);
        assert!((inside - outside).abs() < 0.1, "{gate}: {inside} inside, {outside} outside");
    }
}

#[test]
fn the_brightest_place_of_an_impulse_is_the_impulse() {
    let (_, image) = hard().swap_remove(9);
    for sigma in [0.0, 3.0, 12.0] {
        let map = map(&image, sigma, &Settings::default());
        let brightest = (0..map.len()).max_by(|a, b| map[*a].total_cmp(&map[*b]));
        assert_eq!(brightest, Some(12 * 40 + 17), "{sigma}");
    }
}

#[test]
fn noise_follows_its_seed() {
    let image = waves(40, 30, 2);
    let of = |seed| Gate::Random.mask(&image, 3.0, seed, &Settings::default()).expect("a mask");
    assert_eq!(of(5), of(5));
    assert_ne!(of(5), of(6));
}
