//! How well a training came to fit each of its photographs.

use serde::{Deserialize, Serialize};

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
