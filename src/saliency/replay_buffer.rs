//! What the outlooks of earlier updates have found, of each image once. An image comes by every so many hundred steps,
//! and the others move the network in between: steps that recall all of them hold it to what it was taught, so that few
//! updates of many images are enough.

use serde::{Deserialize, Serialize};

use super::adam::Adam;
use super::features::RINGS;
use super::network::{Network, PARAMETERS};

/// The width that an outlook found best, of an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Found {
    /// What the network sees of the image.
    input: [f64; RINGS],
    /// The output that gives the width.
    goal: f64,
    /// By how much the loss changes over the range.
    weight: f64,
}

/// All of them, with the optimiser of these steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Recall {
    found: Vec<Found>,
    adam: Adam,
}

impl Default for Recall {
    fn default() -> Self {
        Self { found: Vec::new(), adam: Adam::new(PARAMETERS) }
    }
}

impl Recall {
    /// Keeps what was found of an image in place of what was found of it before.
    pub(super) fn keep(&mut self, input: [f64; RINGS], goal: f64, weight: f64) {
        let new = Found { input, goal, weight };
        match self.found.iter_mut().find(|old| old.input == input) {
            Some(old) => *old = new,
            None => self.found.push(new),
        }
    }

    /// Steps towards the goals of all images, by the mean of the squared distances,
    /// in which an image counts as much as its loss changes.
    pub(super) fn teach(&mut self, network: &mut Network, steps: usize, rate: f64) {
        let total: f64 = self.found.iter().map(|f| f.weight).sum();
        if total <= 0.0 {
            return;
        }
        for _ in 0..steps {
            let mut sum = vec![0.0; PARAMETERS];
            for Found { input, goal, weight } in &self.found {
                let [output, _] = network.forward(input);
                let gradient = network.backward(input, [weight / total * (output - goal), 0.0]);
                sum.iter_mut().zip(&gradient).for_each(|(sum, g)| *sum += g);
            }
            self.adam.step(network.parameters_mut(), &sum, rate);
        }
    }

    /// Whether it can be gone on with.
    pub(super) fn is_sound(&self) -> bool {
        let finite = |f: &Found| f.input.iter().chain([&f.goal, &f.weight]).all(|v| v.is_finite()) && f.weight >= 0.0;
        self.adam.is_sound(PARAMETERS) && self.found.iter().all(finite)
    }
}
