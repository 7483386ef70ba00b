//! Derivatives against finite differences.

use psrgs_vk::saliency::{
    Border, MaskTarget, Network, PARAMETERS, RINGS, Settings, Spectrum, composite, cross_entropy,
};
use psrgs_vk::scene::random::Random;

use crate::images::{distance, patch, waves};

const STEP: f64 = 1e-4;

/// A loss with its derivatives by logits.
type Loss<'a> = &'a dyn Fn(&[f64]) -> (f64, Vec<f64>);

/// The central difference of a function's values.
fn difference(f: impl Fn(f64) -> Vec<f64>, at: f64) -> Vec<f64> {
    f(at + STEP).iter().zip(f(at - STEP)).map(|(a, b)| (a - b) / (2.0 * STEP)).collect()
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |m: f64, v| m.max(v.abs()))
}

#[test]
fn maps_and_masks_by_sigma() {
    for (border, blur) in [(Border::Reflect, 10.0), (Border::Periodic, 0.0)] {
        let settings = Settings { border, blur, ..Settings::default() };
        for image in [waves(45, 32, 3), patch(40, 56, (10.0, 20.0), 14.0, 4)] {
            let spectrum = Spectrum::new(&image, &settings).expect("a spectrum");
            for sigma in [0.3, 1.0, 3.0, 8.0, 30.0] {
                let map = |sigma: f64| spectrum.map(sigma).expect("a map");
                let slopes = difference(|s| map(s).values().to_vec(), sigma);
                let scale = largest(&slopes);
                assert!(scale > 1e-5, "{sigma}: the map does not depend on sigma");
                let error = distance(&slopes, map(sigma).slopes());
                assert!(error < 1e-5 * scale, "map at {sigma}: {error} of {scale}");
                let slopes = difference(|s| map(s).mask(0.2).logits().to_vec(), sigma);
                let error = distance(&slopes, map(sigma).mask(0.2).slopes());
                assert!(error < 1e-4 * largest(&slopes), "mask at {sigma}: {error} of {}", largest(&slopes));
            }
        }
    }
}

#[test]
fn losses_by_sigma_and_level() {
    let settings = Settings { blur: 10.0, ..Settings::default() };
    let image = patch(48, 40, (20.0, 8.0), 16.0, 9);
    let spectrum = Spectrum::new(&image, &settings).expect("a spectrum");
    let errors = waves(30, 30, 2);
    let target = MaskTarget::of_errors(&errors, (48, 40), 1.0, 0.25).expect("a target");
    let mut random = Random::new(6);
    let mut picture = || -> Vec<f32> { (0..3 * 48 * 40).map(|_| random.unit() as f32).collect() };
    let (low, full, photograph) = (picture(), picture(), picture());
    let failing: Loss<'_> = &|logits| cross_entropy(logits, target.values()).expect("a loss");
    let priced: Loss<'_> = &|logits| composite(logits, &low, &full, &photograph, 0.1).expect("a loss");
    for (name, loss) in [("errors", failing), ("composite", priced)] {
        for sigma in [1.0, 4.0, 10.0] {
            let at = |sigma: f64, level: f64| loss(spectrum.map(sigma).expect("a map").mask(level).logits()).0;
            let mask = spectrum.map(sigma).expect("a map").mask(0.1);
            let [by_sigma, by_level] = mask.pull(&loss(mask.logits()).1);
            let want = difference(|s| vec![at(s, 0.1)], sigma)[0];
            assert!((by_sigma - want).abs() < 1e-4 * want.abs() + 1e-9, "{name} at {sigma}: {by_sigma}, {want}");
            let want = difference(|l| vec![at(sigma, l)], 0.1)[0];
            assert!((by_level - want).abs() < 1e-5 * want.abs() + 1e-9, "{name} at {sigma}: {by_level}, {want}");
        }
    }
}

#[test]
fn losses_by_logit() {
    let mut random = Random::new(1);
    let logits: Vec<f64> = (0..12).map(|_| 8.0 * random.unit() - 4.0).collect();
    let target: Vec<f64> = (0..12).map(|_| random.unit().round()).collect();
    let mut picture = || -> Vec<f32> { (0..36).map(|_| random.unit() as f32).collect() };
    let (low, full, photograph) = (picture(), picture(), picture());
    let check = |name: &str, loss: Loss<'_>| {
        let slopes = loss(&logits).1;
        for k in 0..logits.len() {
            let moved = |by: f64| {
                let mut other = logits.clone();
                other[k] += by;
                loss(&other).0
            };
            let want = (moved(STEP) - moved(-STEP)) / (2.0 * STEP);
            assert!((slopes[k] - want).abs() < 1e-8, "{name} {k}: {} and {want}", slopes[k]);
        }
    };
    check("errors", &|l| cross_entropy(l, &target).expect("a loss"));
    check("composite", &|l| composite(l, &low, &full, &photograph, 0.1).expect("a loss"));
}

#[test]
fn losses_far_out_stay_finite() {
    let (loss, slopes) = cross_entropy(&[-800.0, 800.0, -800.0, 800.0], &[0.0, 1.0, 1.0, 0.0]).expect("a loss");
    assert_eq!((loss, slopes), (400.0, vec![0.0, 0.0, -0.25, 0.25]));
    let (loss, slopes) = composite(&[-800.0, 800.0], &[0.0; 6], &[1.0; 6], &[0.5; 6], 1.0).expect("a loss");
    assert!(loss.is_finite() && slopes == [0.0, 0.0], "{loss}, {slopes:?}");
}

#[test]
fn the_network_by_its_parameters() {
    let mut network = Network::new([0.3, -0.2], 11);
    let mut random = Random::new(12);
    // Away from the initial parameters, at which most of the gradient is 0.
    network.parameters_mut().iter_mut().for_each(|p| *p += random.unit() - 0.5);
    let input: [f64; RINGS] = std::array::from_fn(|_| 4.0 * random.unit() - 2.0);
    let (a, b) = (0.7, -1.3);
    let gradient = network.backward(&input, [a, b]);
    assert_eq!(gradient.len(), PARAMETERS);
    for (k, found) in gradient.iter().enumerate() {
        let moved = |by: f64| {
            let mut other = network.clone();
            other.parameters_mut()[k] += by;
            let [x, y] = other.forward(&input);
            a * x + b * y
        };
        let want = (moved(STEP) - moved(-STEP)) / (2.0 * STEP);
        assert!((found - want).abs() < 1e-7, "parameter {k}: {found} and {want}");
        assert!(want != 0.0, "parameter {k} has no gradient");
    }
}
