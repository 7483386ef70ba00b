//! The input of the sigma network: the shape of an image's spectrum.

use serde::{Deserialize, Serialize};

/// Values per image.
pub const RINGS: usize = 16;
/// Largest magnitude of a standardised value, so that one unusual image does not dominate the network.
const MOST: f64 = 4.0;
/// Standard deviation over the images below which values differ by rounding only.
const SAME: f64 = 1e-9;

/// Means of the logarithm of an image's amplitudes over rings of frequencies, relative to the mean amplitude. Rings are
/// of equal width in the logarithm of the frequency, from one cycle per shorter side to half a cycle per pixel. A ring
/// without a frequency has its neighbour's value; an image of one colour has zeros.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Features(pub [f64; RINGS]);

pub(super) fn radial(logarithms: &[f64], (width, height): (usize, usize), image: (usize, usize)) -> Features {
    let lowest = 1.0 / image.0.min(image.1).max(1) as f64;
    let octaves = (0.5 / lowest).ln();
    let (mut sums, mut counts) = ([0.0; RINGS], [0.0; RINGS]);
    for (y, row) in logarithms.chunks_exact(width).enumerate() {
        let fy = y.min(height - y) as f64 / height as f64;
        for (x, value) in row.iter().enumerate() {
            let fx = x.min(width - x) as f64 / width as f64;
            let f = fx.hypot(fy);
            if (x, y) == (0, 0) || f > 0.5 {
                continue;
            }
            let position = if octaves > 0.0 { (f / lowest).ln() / octaves * RINGS as f64 } else { 0.0 };
            let ring = (position.max(0.0) as usize).min(RINGS - 1);
            sums[ring] += value;
            counts[ring] += 1.0;
        }
    }
    let means: Vec<Option<f64>> = sums.iter().zip(counts).map(|(s, n)| (n > 0.0).then(|| s / n)).collect();
    let mut features = Features::default();
    let mut last = means.iter().find_map(|m| *m).unwrap_or(0.0);
    for (feature, mean) in features.0.iter_mut().zip(means) {
        last = mean.unwrap_or(last);
        *feature = last;
    }
    features
}

/// Means and deviations of features over a set of images.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Standard {
    means: [f64; RINGS],
    deviations: [f64; RINGS],
}

impl Standard {
    pub(super) fn of(images: &[Features]) -> Self {
        let n = images.len().max(1) as f64;
        let mean = |of: &dyn Fn(&Features) -> f64| images.iter().map(of).sum::<f64>() / n;
        let means: [f64; RINGS] = std::array::from_fn(|k| mean(&|f| f.0[k]));
        let deviations = std::array::from_fn(|k| mean(&|f| (f.0[k] - means[k]).powi(2)).sqrt());
        Self { means, deviations }
    }

    /// Deviations of the features from their means, in standard deviations; 0 for a feature that is equal in all
    /// images.
    pub(super) fn apply(&self, features: &Features) -> [f64; RINGS] {
        std::array::from_fn(|k| {
            let (mean, deviation) = (self.means[k], self.deviations[k]);
            if deviation > SAME { ((features.0[k] - mean) / deviation).clamp(-MOST, MOST) } else { 0.0 }
        })
    }

    pub(super) fn is_finite(&self) -> bool {
        self.means.iter().chain(&self.deviations).all(|v| v.is_finite())
    }
}
