//! Losses of a mask, with their gradients.

use super::blur::gaussian;
use super::mask::logistic;
use super::{Border, Error, Plane};

/// Colour differences below this count by their squares.
const ROUND: f64 = 1e-3;

/// Where a model fails: the pixels with the largest errors.
#[derive(Clone, Debug, PartialEq)]
pub struct MaskTarget {
    size: (u32, u32),
    values: Vec<f64>,
}

impl MaskTarget {
    /// From an error map of any size (absolute differences between a render and its photograph): 1 for the `share` of
    /// the pixels with the largest errors after a blur of `blur` pixels, 0 elsewhere. `None` where no pixel has a
    /// larger error than the others.
    pub fn of_errors(errors: &Plane, size: (u32, u32), blur: f64, share: f64) -> Option<Self> {
        let errors = errors.resized(size.0, size.1);
        let size = (errors.width(), errors.height());
        let values = errors.values().iter().map(|v| f64::from(*v)).collect();
        let blurred = gaussian(values, (size.0 as usize, size.1 as usize), blur, Border::Reflect);
        let mut sorted = blurred.clone();
        let rank = (((1.0 - share) * sorted.len() as f64) as usize).min(sorted.len().saturating_sub(1));
        let (_, level, above) = sorted.select_nth_unstable_by(rank, f64::total_cmp);
        let level = *level;
        if !above.iter().any(|v| *v > level) {
            return None;
        }
        Some(Self { size, values: blurred.iter().map(|v| if *v > level { 1.0 } else { 0.0 }).collect() })
    }

    /// Width and height.
    pub fn size(&self) -> (u32, u32) {
        self.size
    }

    /// 0 or 1 per pixel, row by row from the top.
    pub fn values(&self) -> &[f64] {
        &self.values
    }
}

/// Mean cross entropy between a mask, given by its logits, and its target, and the derivatives with respect to the
/// logits.
pub fn cross_entropy(logits: &[f64], target: &[f64]) -> Result<(f64, Vec<f64>), Error> {
    Error::check("the target", target.len(), logits.len())?;
    let n = logits.len().max(1) as f64;
    // -t ln M - (1-t) ln (1-M) = ln(1 + e^x) - t x, without overflow.
    let one = |(x, t): (&f64, &f64)| x.max(0.0) + (-x.abs()).exp().ln_1p() - t * x;
    let loss = logits.iter().zip(target).map(one).sum::<f64>() / n;
    Ok((loss, logits.iter().zip(target).map(|(x, t)| (logistic(*x) - t) / n).collect()))
}

/// Mean absolute difference of a photograph and the composite `(1 - M) low + M full` of two renders (red, green, blue
/// per pixel, at the size of the mask), plus `price` times the mean of the mask; and the derivatives with respect to
/// the logits. Where the splats that only `full` has are not worth the price, the mask goes down. Absolute differences
/// are smoothed: sqrt(d^2 + r^2) - r with r = 0.001.
pub fn composite(
    logits: &[f64],
    low: &[f32],
    full: &[f32],
    photograph: &[f32],
    price: f64,
) -> Result<(f64, Vec<f64>), Error> {
    for (what, image) in [("the low render", low), ("the full render", full), ("the photograph", photograph)] {
        Error::check(what, image.len(), 3 * logits.len())?;
    }
    let n = logits.len().max(1) as f64;
    let mut loss = 0.0;
    let mut by_logit = Vec::with_capacity(logits.len());
    let pixels = low.chunks_exact(3).zip(full.chunks_exact(3)).zip(photograph.chunks_exact(3));
    for (x, ((low, full), wanted)) in logits.iter().zip(pixels) {
        let m = logistic(*x);
        let mut by_mask = price / n;
        loss += price * m / n;
        for ((a, b), c) in low.iter().zip(full).zip(wanted) {
            let (a, b, c) = (f64::from(*a), f64::from(*b), f64::from(*c));
            let d = (1.0 - m) * a + m * b - c;
            let rounded = d.hypot(ROUND);
            loss += (rounded - ROUND) / (3.0 * n);
            by_mask += d / rounded * (b - a) / (3.0 * n);
        }
        by_logit.push(by_mask * m * (1.0 - m));
    }
    Ok((loss, by_logit))
}
