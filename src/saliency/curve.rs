//! A loss as a function of sigma, and a judgement of learned values of sigma by the loss.

use rayon::prelude::*;

use super::{Error, MaskTarget, Spectrum, cross_entropy};

/// Losses at several sigma, ascending in sigma.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    points: Vec<(f64, f64)>,
}

/// `count` values from `lowest` to `highest`, equally spaced in the logarithm; both ends must be above 0.
pub fn spaced(lowest: f64, highest: f64, count: usize) -> Vec<f64> {
    let step = (highest / lowest).ln() / count.saturating_sub(1).max(1) as f64;
    (0..count).map(|i| lowest * (step * i as f64).exp()).collect()
}

impl Curve {
    /// The cross entropy between an image's mask and a target at each sigma, without the learner's prior.
    pub fn of_target(spectrum: &Spectrum, target: &MaskTarget, sigmas: &[f64]) -> Result<Self, Error> {
        let one = |sigma: &f64| {
            let mask = spectrum.map(*sigma)?.mask(0.0);
            Ok((*sigma, cross_entropy(mask.logits(), target.values())?.0))
        };
        let points = sigmas.par_iter().map(one).collect::<Result<Vec<_>, Error>>()?;
        Ok(Self::new(points))
    }

    /// From (sigma, loss) pairs in any order.
    pub fn new(mut points: Vec<(f64, f64)>) -> Self {
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self { points }
    }

    /// The (sigma, loss) pairs, ascending in sigma.
    pub fn points(&self) -> &[(f64, f64)] {
        &self.points
    }

    /// The point of the lowest loss; `None` for an empty curve.
    pub fn best(&self) -> Option<(f64, f64)> {
        self.points.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The loss at a sigma: linear in the logarithm of sigma between two points, and the nearest point's loss outside.
    /// `None` for an empty curve.
    pub fn loss(&self, sigma: f64) -> Option<f64> {
        let after = self.points.partition_point(|p| p.0 < sigma);
        let (Some(a), Some(b)) = (after.checked_sub(1).map(|i| self.points[i]), self.points.get(after)) else {
            return self.points.get(after).or(self.points.last()).map(|p| p.1);
        };
        let t = (sigma / a.0).ln() / (b.0 / a.0).ln();
        Some(if t.is_finite() { a.1 + t * (b.1 - a.1) } else { b.1 })
    }

    /// Largest minus smallest loss between two values of sigma, as a share of the smallest.
    pub fn rise(&self, lowest: f64, highest: f64) -> Option<f64> {
        let inside = self.points.iter().filter(|p| (lowest..=highest).contains(&p.0)).map(|p| p.1);
        let losses = inside.chain([self.loss(lowest)?, self.loss(highest)?]);
        let (least, most) = losses.fold((f64::MAX, f64::MIN), |(a, b), l| (a.min(l), b.max(l)));
        Some(if most > least { (most - least) / least.abs().max(f64::MIN_POSITIVE) } else { 0.0 })
    }
}

/// How the sigma that several trainings learned for one image, from different starts, compare.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Agreement {
    /// The learned sigma lie within the tolerance of one another.
    Agree {
        /// Largest sigma over smallest, minus 1.
        spread: f64,
    },
    /// The learned sigma differ, but the loss is flat from the smallest to the largest.
    Flat {
        /// Largest sigma over smallest, minus 1.
        spread: f64,
        /// [`Curve::rise`] from the smallest sigma to the largest.
        rise: f64,
    },
    /// The learned sigma differ, and so do their losses: sigma was not learned.
    Differ {
        /// Largest sigma over smallest, minus 1.
        spread: f64,
        /// [`Curve::rise`] from the smallest sigma to the largest.
        rise: f64,
    },
}

/// Judges the sigma (above 0) that trainings learned for one image by its loss over sigma, `curve`. `within` is the
/// largest spread that counts as agreement, `flat` the largest [`Curve::rise`] that counts as flat. `None` without
/// sigma or for an empty curve.
pub fn agreement(curve: &Curve, trained: &[f64], within: f64, flat: f64) -> Option<Agreement> {
    let lowest = trained.iter().copied().min_by(f64::total_cmp)?;
    let highest = trained.iter().copied().max_by(f64::total_cmp)?;
    let spread = highest / lowest - 1.0;
    let rise = curve.rise(lowest, highest)?;
    Some(if spread <= within {
        Agreement::Agree { spread }
    } else if rise <= flat {
        Agreement::Flat { spread, rise }
    } else {
        Agreement::Differ { spread, rise }
    })
}
