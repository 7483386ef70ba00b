//! The losses of a training by photograph.

use super::Trainer;
use crate::eval::{TrainingPhotograph, worst_first};
use crate::train::schedule::Schedule;

/// Most passes over all photographs from which losses are taken.
const PASSES: u32 = 4;

impl Trainer {
    /// The mean loss of each photograph over the last steps of the run: the second half of the steps, at most four
    /// passes over all photographs. The worst photograph comes first.
    pub fn training_photographs(&self) -> Vec<TrainingPhotograph> {
        let mut out = by_photograph(&self.history.loss, &self.schedule, &self.trained_on.names);
        worst_first(&mut out);
        out
    }
}

fn by_photograph(losses: &[f32], schedule: &Schedule, names: &[String]) -> Vec<TrainingPhotograph> {
    let done = losses.len() as u32;
    let pass = schedule.steps_of_a_pass();
    let last = (done / 2).clamp(pass.min(done), pass.saturating_mul(PASSES).max(1));
    let mut sums = vec![(0.0_f64, 0_u32); names.len()];
    for step in done - last.min(done) + 1..=done {
        let loss = losses.get(step as usize - 1).copied().filter(|loss| loss.is_finite());
        if let (Some(loss), Some((sum, steps))) = (loss, sums.get_mut(schedule.view_at(step))) {
            *sum += f64::from(loss);
            *steps += 1;
        }
    }
    let one = |(name, (sum, steps)): (&String, (f64, u32))| TrainingPhotograph {
        name: name.clone(),
        loss: (steps > 0).then(|| sum / f64::from(steps)),
        steps,
        left_out: None,
    };
    names.iter().zip(sums).map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::Settings;

    #[test]
    fn losses_belong_to_the_photographs_of_their_steps() {
        let names: Vec<String> = (0..7).map(|k| k.to_string()).collect();
        let schedule = Schedule::new(&Settings::default(), names.len());
        let of = |view: usize| if view == 3 { 0.5 } else { 0.01 * view as f32 };
        let losses = |steps: u32| -> Vec<f32> { (1..=steps).map(|t| of(schedule.view_at(t))).collect() };
        for (steps, each) in [(7, 1), (28, 2), (700, 4)] {
            for (view, found) in by_photograph(&losses(steps), &schedule, &names).iter().enumerate() {
                assert_eq!((found.name.as_str(), found.steps), (names[view].as_str(), each), "{steps}");
                assert!((found.loss.unwrap() - f64::from(of(view))).abs() < 1e-6, "{found:?}");
            }
        }
        // Early losses, which are high for all photographs, do not count.
        let mut some = losses(700);
        some[..600].fill(9.0);
        assert!(by_photograph(&some, &schedule, &names).iter().all(|p| p.loss.unwrap() < 0.6));
        let few = by_photograph(&losses(3), &schedule, &names);
        assert_eq!(few.iter().filter(|p| p.loss.is_some()).count(), 3);
        assert!(by_photograph(&[], &schedule, &names).iter().all(|p| p.loss.is_none() && p.steps == 0));
    }
}
