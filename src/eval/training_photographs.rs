//! How well a training came to fit each of its photographs, and how well its model renders some of them.

use serde::{Deserialize, Serialize};

use crate::numbers::mean;

/// With fewer photographs none stands out.
const LEAST: usize = 8;
/// A photograph stands out where its loss is more than this multiple of the median ...
const TIMES: f64 = 2.0;
/// ... and exceeds the median by more than this multiple of the typical distance from the median.
const DEVIATIONS: f64 = 10.0;
/// The least number of steps with a loss: a single one may be chance.
const STEPS: u32 = 2;

/// A photograph to train on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainingPhotograph {
    /// Its name.
    pub name: String,
    /// The mean of its losses in the last steps that it had; `null` where it had none.
    pub loss: Option<f64>,
    /// How many steps these are.
    pub steps: u32,
    /// Why it was left out of training; absent where it was not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub left_out: Option<String>,
}

/// Most training photographs that a finished model is scored on.
const SCORED: usize = 32;

/// Mean scores of a model on photographs that it was trained on, taken as those of held-out photographs. What they are
/// above those is fitted by heart.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TrainingScores {
    /// Mean PSNR in decibels; `None` where a render equals its photograph.
    pub psnr: Option<f64>,
    /// Mean SSIM.
    pub ssim: Option<f64>,
}

impl TrainingScores {
    /// The photographs that are scored, of `photographs` in their order: all, or 32 that are evenly spaced.
    pub fn sample(photographs: usize) -> Vec<usize> {
        let scored = photographs.min(SCORED);
        (0..scored).map(|k| k * photographs / scored).collect()
    }

    /// The means of PSNR and SSIM of each.
    pub(crate) fn of(each: &[(f64, f64)]) -> Self {
        Self { psnr: mean(each.iter().map(|(psnr, _)| *psnr)), ssim: mean(each.iter().map(|(_, ssim)| *ssim)) }
    }
}

/// Puts those first that are fitted worst; those without a loss come last.
pub fn worst_first(photographs: &mut [TrainingPhotograph]) {
    let key = |photograph: &TrainingPhotograph| photograph.loss.unwrap_or(f64::NEG_INFINITY);
    photographs.sort_by(|a, b| key(b).total_cmp(&key(a)).then_with(|| a.name.cmp(&b.name)));
}

/// The median of the losses.
pub fn median_loss(photographs: &[TrainingPhotograph]) -> Option<f64> {
    median(photographs.iter().filter_map(|p| p.loss).collect())
}

/// Photographs that are fitted far worse than the others: of a wrong pose, say, or blurred.
pub fn misfits(photographs: &[TrainingPhotograph]) -> Vec<&TrainingPhotograph> {
    let fitted = || photographs.iter().filter(|p| p.loss.is_some_and(f64::is_finite) && p.steps >= STEPS);
    let losses: Vec<f64> = fitted().filter_map(|p| p.loss).collect();
    let Some(middle) = median(losses.clone()).filter(|_| losses.len() >= LEAST) else { return Vec::new() };
    let deviation = median(losses.iter().map(|loss| (loss - middle).abs()).collect()).unwrap_or(0.0);
    let bound = (TIMES * middle).max(middle + DEVIATIONS * deviation);
    fitted().filter(|p| p.loss.is_some_and(|loss| loss > bound)).collect()
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(losses: &[f64]) -> Vec<TrainingPhotograph> {
        let one = |(k, loss): (usize, &f64)| TrainingPhotograph {
            name: format!("{k}"),
            loss: Some(*loss),
            steps: 3,
            left_out: None,
        };
        losses.iter().enumerate().map(one).collect()
    }

    #[test]
    fn photographs_to_score_are_evenly_spaced() {
        assert_eq!(TrainingScores::sample(0), Vec::<usize>::new());
        assert_eq!(TrainingScores::sample(3), [0, 1, 2]);
        assert_eq!(TrainingScores::sample(32), (0..32).collect::<Vec<_>>());
        for photographs in [33, 64, 100, 1001] {
            let sample = TrainingScores::sample(photographs);
            assert_eq!((sample.len(), sample[0]), (32, 0));
            let gaps: Vec<usize> = sample.windows(2).map(|pair| pair[1] - pair[0]).collect();
            let (least, most) = (photographs / 32, photographs.div_ceil(32));
            assert!(gaps.iter().all(|gap| (least..=most).contains(gap)), "{photographs}: {sample:?}");
            assert!(photographs - sample[31] <= most, "{photographs}: {sample:?}");
        }
    }

    #[test]
    fn photographs_far_above_the_others_stand_out() {
        let mut all = of(&[0.05, 0.06, 0.055, 0.31, 0.07, 0.05, 0.065, 0.06, 0.09]);
        assert_eq!(misfits(&all).iter().map(|p| p.name.as_str()).collect::<Vec<_>>(), ["3"]);
        worst_first(&mut all);
        assert_eq!(all.iter().map(|p| p.name.as_str()).take(3).collect::<Vec<_>>(), ["3", "8", "4"]);
        // Seen once, it may be chance.
        all[0].steps = 1;
        assert_eq!(misfits(&all), Vec::<&TrainingPhotograph>::new());
        // Scenes whose photographs differ much anyway.
        assert!(misfits(&of(&[0.02, 0.04, 0.06, 0.08, 0.1, 0.12, 0.14, 0.21])).is_empty());
        assert!(misfits(&of(&[0.1, 0.9])).is_empty() && misfits(&[]).is_empty());
    }
}
