//! Soft masks.

use super::{Plane, Settings};

/// Added to a map before taking its logarithm, in units of the map's mean.
const LEAST: f64 = 1e-3;
/// Smallest level of a mask, as a share of the map's mean: smaller values are never texture.
const LOWEST: f64 = 0.1;
/// Steps of the search for a level, enough for bisection alone to reach rounding.
const STEPS: usize = 80;

/// How much each pixel counts as texture: logistic((ln map - level) / softness).
///
/// The level is the soft quantile of the map, at which the mask's mean is [`Settings::share`]. The level therefore
/// follows the map as sigma changes and has a known derivative, and no mask can lower a loss by covering everything or
/// nothing.
#[derive(Clone, Debug)]
pub struct SoftMask {
    size: (u32, u32),
    logits: Vec<f64>,
    slopes: Vec<f64>,
    level: f64,
    softness: f64,
}

pub(super) fn of(size: (u32, u32), map: &[f64], map_slopes: &[f64], moved: f64, settings: &Settings) -> SoftMask {
    let softness = settings.softness;
    let logarithms: Vec<f64> = map.iter().map(|v| (v + LEAST).ln()).collect();
    let changes = map_slopes.iter().zip(map).map(|(d, v)| d / (v + LEAST));
    let lowest = LOWEST.ln();
    let mut level = soft_quantile(&logarithms, settings.share, softness);
    let mut level_change = 0.0;
    if level > lowest {
        // The mean stays constant: sum of M (1 - M) (change - level_change) = 0.
        let (mut sum, mut total) = (0.0, 0.0);
        for (l, change) in logarithms.iter().zip(changes.clone()) {
            let m = logistic((l - level) / softness);
            sum += m * (1.0 - m) * change;
            total += m * (1.0 - m);
        }
        level_change = if total > 0.0 { sum / total } else { 0.0 };
    }
    level = level.max(lowest) + moved;
    let slopes = changes.map(|change| (change - level_change) / softness).collect();
    let logits = logarithms.iter().map(|l| (l - level) / softness).collect();
    SoftMask { size, logits, slopes, level, softness }
}

/// The level at which the mean of logistic((value - level) / softness) is `share`, by Newton's method inside a
/// shrinking bracket.
fn soft_quantile(values: &[f64], share: f64, softness: f64) -> f64 {
    let n = values.len() as f64;
    let (least, most) = values.iter().fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(*v), b.max(*v)));
    // If all values were equal, the level would lie this distance above them.
    let distance = softness * ((1.0 - share) / share).ln();
    let (mut low, mut high) = (least + distance, most + distance);
    let mut sorted = values.to_vec();
    let rank = (((1.0 - share) * n) as usize).min(values.len() - 1);
    let mut level = *sorted.select_nth_unstable_by(rank, f64::total_cmp).1;
    for _ in 0..STEPS {
        let (mut sum, mut slope) = (0.0, 0.0);
        for v in values {
            let m = logistic((v - level) / softness);
            sum += m;
            slope += m * (1.0 - m);
        }
        let excess = sum / n - share;
        if excess > 0.0 {
            low = low.max(level);
        } else {
            high = high.min(level);
        }
        let step = excess * n * softness / slope;
        let next = level + step;
        let next = if next.is_finite() && (low..=high).contains(&next) { next } else { 0.5 * (low + high) };
        if (next - level).abs() <= 1e-12 * (1.0 + level.abs()) {
            return next;
        }
        level = next;
    }
    level
}

pub(super) fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

impl SoftMask {
    /// Width and height.
    pub fn size(&self) -> (u32, u32) {
        self.size
    }

    /// The mask before the logistic function, row by row from the top.
    pub fn logits(&self) -> &[f64] {
        &self.logits
    }

    /// Derivatives of [`SoftMask::logits`] with respect to sigma.
    pub fn slopes(&self) -> &[f64] {
        &self.slopes
    }

    /// Natural logarithm of the map where the mask is one half.
    pub fn level(&self) -> f64 {
        self.level
    }

    /// The mask: from 0 to 1, row by row from the top.
    pub fn values(&self) -> Vec<f64> {
        self.logits.iter().map(|l| logistic(*l)).collect()
    }

    /// The mask as an image.
    pub fn plane(&self) -> Plane {
        Plane::of(self.size.0, self.size.1, self.logits.iter().map(|l| logistic(*l)))
    }

    /// Derivatives of a loss with respect to sigma and to the level, from the derivatives with respect to the logits.
    pub fn pull(&self, by_logit: &[f64]) -> [f64; 2] {
        let by_sigma = by_logit.iter().zip(&self.slopes).map(|(g, d)| g * d).sum();
        let by_level = -by_logit.iter().sum::<f64>() / self.softness;
        [by_sigma, by_level]
    }
}
