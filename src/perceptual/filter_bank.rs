//! A distance without learned weights: oriented band-pass filters of two scales in place of a trunk.
//!
//! Each scale has four orientations with an even and an odd filter (Gabor functions on luma without a constant part).
//! The eight responses of a pixel are compared as LPIPS compares features. A constant added to their length before
//! normalisation suppresses noise in flat areas.

use std::f64::consts::PI;

use super::network::{Convolution, Filters, Network, Op, Tap};

/// Taps along a side, wavelength and standard deviation in pixels.
const SCALES: [(usize, f64, f64); 2] = [(7, 4.5, 1.6), (13, 9.0, 3.2)];
const ORIENTATIONS: usize = 4;
/// Luma weights of Rec. 601.
const LUMA: [f64; 3] = [0.299, 0.587, 0.114];
/// Constant added to a feature's length, in units of responses: a grating of contrast 1 gives a response of 0.5.
const EPS: f32 = 0.05;

/// The network, for images in [0, 1].
pub(super) fn network() -> Network {
    let mut network = Network::default();
    let image = network.tensor(4, false);
    for (size, wavelength, sigma) in SCALES {
        let answers = network.tensor(2 * ORIENTATIONS, false);
        let filters = filters(size, wavelength, sigma);
        network.ops.push(Op::Convolution(Convolution::new(image, answers, filters, 2, 0)));
        let weights = vec![1.0 / 8.0; 2 * ORIENTATIONS];
        network.taps.push(Tap { tensor: answers, weights, eps: EPS });
    }
    network
}

fn filters(size: usize, wavelength: f64, sigma: f64) -> Filters {
    let mut taps = Vec::new();
    for k in 0..ORIENTATIONS {
        let (sin, cos) = (PI * k as f64 / ORIENTATIONS as f64).sin_cos();
        for phase in [0.0, -PI / 2.0] {
            let kernel = band_pass(size, sigma, |x, y| (2.0 * PI * (x * cos + y * sin) / wavelength + phase).cos());
            taps.extend(LUMA.iter().flat_map(|l| kernel.iter().map(move |v| (l * v) as f32)));
        }
    }
    Filters { outputs: 2 * ORIENTATIONS, inputs: 3, size, taps, biases: vec![0.0; 2 * ORIENTATIONS] }
}

/// A wave under a Gaussian, without a constant part, whose response to the wave itself is 1/2.
fn band_pass(size: usize, sigma: f64, wave: impl Fn(f64, f64) -> f64) -> Vec<f64> {
    let middle = (size - 1) as f64 / 2.0;
    let places = || (0..size * size).map(|i| ((i % size) as f64 - middle, (i / size) as f64 - middle));
    let window: Vec<f64> = places().map(|(x, y)| (-(x * x + y * y) / (2.0 * sigma * sigma)).exp()).collect();
    let waves: Vec<f64> = places().map(|(x, y)| wave(x, y)).collect();
    let total: f64 = window.iter().sum();
    let mean = window.iter().zip(&waves).map(|(w, v)| w * v).sum::<f64>() / total;
    let kernel: Vec<f64> = window.iter().zip(&waves).map(|(w, v)| w * (v - mean)).collect();
    let gain: f64 = kernel.iter().zip(&waves).map(|(k, v)| k * v).sum();
    kernel.iter().map(|k| 0.5 * k / gain).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_answer_to_their_orientation_and_not_to_flat_areas() {
        for (size, wavelength, sigma) in SCALES {
            let f = filters(size, wavelength, sigma);
            let answer = |output: usize, image: &dyn Fn(f64, f64) -> f64| -> f64 {
                let middle = (size - 1) as f64 / 2.0;
                (0..3 * size * size)
                    .map(|i| {
                        let (c, y, x) = (i / (size * size), i / size % size, i % size);
                        f64::from(f.at(output, c, y, x)) * image(x as f64 - middle, y as f64 - middle)
                    })
                    .sum()
            };
            for output in 0..f.outputs {
                assert!(answer(output, &|_, _| 1.0).abs() < 1e-6);
            }
            let upright = |x: f64, _: f64| (2.0 * PI * x / wavelength).cos();
            assert!((answer(0, &upright) - 0.5).abs() < 1e-6);
            assert!(answer(4, &upright).abs() < 0.1, "the filter across it answers {}", answer(4, &upright));
        }
    }
}
