//! Maps and masks from the formulas, by sums over all pairs of pixels and frequencies, against the fast ones.

use std::f64::consts::{PI, TAU};

use psrgs_vk::saliency::{Border, Plane, Settings, Spectrum};

use crate::images::{distance, waves};

type C = (f64, f64);

fn times(a: C, b: C) -> C {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

/// Sums of `values * exp(sign 2 pi i (ux/W + vy/H))`.
fn slow_transform(values: &[C], w: usize, h: usize, sign: f64) -> Vec<C> {
    let mut out = Vec::new();
    for v in 0..h {
        for u in 0..w {
            let mut sum = (0.0, 0.0);
            for y in 0..h {
                for x in 0..w {
                    let turns = ((u * x) % w) as f64 / w as f64 + ((v * y) % h) as f64 / h as f64;
                    let one = times(values[y * w + x], ((TAU * turns).cos(), sign * (TAU * turns).sin()));
                    sum = (sum.0 + one.0, sum.1 + one.1);
                }
            }
            out.push(sum);
        }
    }
    out
}

/// A Gaussian of `s` bins on a circle of `n` bins: the sum over all periods.
fn wrapped(d: usize, n: usize, s: f64) -> f64 {
    (-40..=40).map(|turn| (-0.5 * ((d as f64 + f64::from(turn) * n as f64) / s).powi(2)).exp()).sum()
}

/// The weighted average of each bin's neighbours on the torus.
fn slow_average(values: &[f64], w: usize, h: usize, sigma: f64) -> Vec<f64> {
    let weights = |n: usize| -> Vec<f64> { (0..n).map(|d| wrapped(d, n, sigma * n as f64 / 256.0)).collect() };
    let (across, down) = (weights(w), weights(h));
    let total = across.iter().sum::<f64>() * down.iter().sum::<f64>();
    let mut out = Vec::new();
    for v in 0..h {
        for u in 0..w {
            let mut sum = 0.0;
            for y in 0..h {
                for x in 0..w {
                    sum += across[(u + w - x) % w] * down[(v + h - y) % h] * values[y * w + x];
                }
            }
            out.push(sum / total);
        }
    }
    out
}

fn fold(i: i64, n: usize) -> usize {
    let mut i = i;
    while i < 0 || i >= n as i64 {
        i = if i < 0 { -1 - i } else { 2 * n as i64 - 1 - i };
    }
    i as usize
}

/// The image in the middle of a larger image that fades to the mean: values, and the position of the original.
fn padded(image: &Plane, size: (usize, usize)) -> (Vec<C>, (usize, usize)) {
    let (w, h) = (image.width() as usize, image.height() as usize);
    let at = ((size.0 - w) / 2, (size.1 - h) / 2);
    let fade = |i: usize, origin: usize, n: usize, length: usize| {
        let (outside, width) = if i < origin {
            (origin - i, origin)
        } else if i >= origin + n {
            (i + 1 - origin - n, length - n - origin)
        } else {
            return 1.0;
        };
        (1.0 + (PI * outside as f64 / (width as f64 + 1.0)).cos()) / 2.0
    };
    let (mut values, mut weights) = (Vec::new(), Vec::new());
    for y in 0..size.1 {
        for x in 0..size.0 {
            let source = fold(y as i64 - at.1 as i64, h) * w + fold(x as i64 - at.0 as i64, w);
            values.push(f64::from(image.values()[source]));
            weights.push(fade(x, at.0, w, size.0) * fade(y, at.1, h, size.1));
        }
    }
    let mean = values.iter().zip(&weights).map(|(v, w)| v * w).sum::<f64>() / weights.iter().sum::<f64>();
    (values.iter().zip(&weights).map(|(v, w)| ((v - mean) * w, 0.0)).collect(), at)
}

/// Map and logits of the mask.
fn slow(image: &Plane, padded_size: (usize, usize), sigma: f64, settings: &Settings) -> (Vec<f64>, Vec<f64>) {
    let (w, h) = padded_size;
    let (values, at) = padded(image, padded_size);
    let spectrum = slow_transform(&values, w, h, -1.0);
    let amplitudes: Vec<f64> = spectrum.iter().map(|f| f.0.hypot(f.1)).collect();
    let noise = settings.epsilon * amplitudes[1..].iter().sum::<f64>() / (w * h) as f64;
    let mut logarithms: Vec<f64> = amplitudes.iter().map(|a| (a + noise).ln()).collect();
    let around = [(1, 0), (w - 1, 0), (0, 1), (0, h - 1), (1, 1), (w - 1, 1), (1, h - 1), (w - 1, h - 1)];
    logarithms[0] = around.iter().map(|(u, v)| logarithms[v * w + u]).sum::<f64>() / 8.0;
    let averages = slow_average(&logarithms, w, h, sigma);
    let residual: Vec<C> = (0..w * h)
        .map(|k| {
            let factor = if k == 0 { 0.0 } else { (logarithms[k] - averages[k]).exp() / (amplitudes[k] + noise) };
            (spectrum[k].0 * factor, spectrum[k].1 * factor)
        })
        .collect();
    let picture = slow_transform(&residual, w, h, 1.0);
    let (iw, ih) = (image.width() as usize, image.height() as usize);
    let energy = |x: usize, y: usize| {
        let z = picture[(y + at.1) * w + x + at.0];
        z.0 * z.0 + z.1 * z.1
    };
    let blur = settings.blur * iw.min(ih) as f64 / 256.0;
    let reach = (3.0 * blur).ceil() as i64;
    let mut map = Vec::new();
    for y in 0..ih as i64 {
        for x in 0..iw as i64 {
            let (mut sum, mut total) = (0.0, 0.0);
            for dy in -reach..=reach {
                for dx in -reach..=reach {
                    let weight = (-((dx * dx + dy * dy) as f64) / (2.0 * blur * blur)).exp();
                    sum += weight * energy(fold(x + dx, iw), fold(y + dy, ih));
                    total += weight;
                }
            }
            map.push(sum / total);
        }
    }
    let mean = map.iter().sum::<f64>() / map.len() as f64;
    map.iter_mut().for_each(|v| *v /= mean);

    let logit = |v: f64, level: f64| ((v + 1e-3).ln() - level) / settings.softness;
    let (mut low, mut high) = (-20.0, 20.0);
    for _ in 0..100 {
        let level = (low + high) / 2.0;
        let share = map.iter().map(|v| 1.0 / (1.0 + (-logit(*v, level)).exp())).sum::<f64>() / map.len() as f64;
        if share > settings.share { low = level } else { high = level }
    }
    let logits = map.iter().map(|v| logit(*v, low)).collect();
    (map, logits)
}

#[test]
fn maps_and_masks_are_those_of_the_formulas() {
    // Blurs of a few pixels also on a small image. 20 + 2 x 2 = 24 and 13 + 2 x 1 = 15 have no prime factor above 5.
    let settings = Settings { blur: 25.0, ..Settings::default() };
    let image = waves(20, 13, 5);
    for sigma in [45.0, 60.0, 110.0] {
        let (map, logits) = slow(&image, (24, 15), sigma, &settings);
        let found = Spectrum::new(&image, &settings).expect("a spectrum").map(sigma).expect("a map");
        assert!(distance(&map, found.values()) < 1e-9, "map at {sigma}: {}", distance(&map, found.values()));
        let mask = found.mask(0.0);
        assert!(distance(&logits, mask.logits()) < 1e-7, "mask at {sigma}: {}", distance(&logits, mask.logits()));
    }
}

/// Also on the torus without padding, for Gaussians narrower than a bin, which are defined by their transform.
#[test]
fn narrow_filters_are_those_of_the_transform() {
    let settings = Settings { border: Border::Periodic, blur: 0.0, ..Settings::default() };
    let (w, h) = (15, 9);
    let image = waves(w as u32, h as u32, 8);
    let (values, _) = padded(&image, (w, h));
    let spectrum = slow_transform(&values, w, h, -1.0);
    let amplitudes: Vec<f64> = spectrum.iter().map(|f| f.0.hypot(f.1)).collect();
    let noise = settings.epsilon * amplitudes[1..].iter().sum::<f64>() / (w * h) as f64;
    let mut logarithms: Vec<C> = amplitudes.iter().map(|a| ((a + noise).ln(), 0.0)).collect();
    let around = [(1, 0), (w - 1, 0), (0, 1), (0, h - 1), (1, 1), (w - 1, 1), (1, h - 1), (w - 1, h - 1)];
    logarithms[0].0 = around.iter().map(|(u, v)| logarithms[v * w + u].0).sum::<f64>() / 8.0;
    let cepstrum = slow_transform(&logarithms, w, h, -1.0);
    for sigma in [0.0_f64, 0.5, 3.0, 12.0] {
        let lifted: Vec<C> = (0..w * h)
            .map(|k| {
                let (x, y) = ((k % w).min(w - k % w) as f64, (k / w).min(h - k / w) as f64);
                let kept = 1.0 - (-2.0 * PI * PI * (sigma / 256.0).powi(2) * (x * x + y * y)).exp();
                (cepstrum[k].0 * kept, cepstrum[k].1 * kept)
            })
            .collect();
        let residual = slow_transform(&lifted, w, h, 1.0);
        let whole: Vec<C> = (0..w * h)
            .map(|k| {
                let factor = (residual[k].0 / (w * h) as f64).exp() / (amplitudes[k] + noise);
                if k == 0 { (0.0, 0.0) } else { (spectrum[k].0 * factor, spectrum[k].1 * factor) }
            })
            .collect();
        let mut map: Vec<f64> = slow_transform(&whole, w, h, 1.0).iter().map(|z| z.0 * z.0 + z.1 * z.1).collect();
        let mean = map.iter().sum::<f64>() / map.len() as f64;
        map.iter_mut().for_each(|v| *v /= mean);
        let found = Spectrum::new(&image, &settings).expect("a spectrum").map(sigma).expect("a map");
        assert!(distance(&map, found.values()) < 1e-9, "{sigma}: {}", distance(&map, found.values()));
    }
}
