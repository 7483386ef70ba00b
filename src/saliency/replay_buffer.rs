//! A replay buffer of the best sigma last found for each image. An image is updated only every few hundred steps, and
//! the updates of other images move the network meanwhile. Steps over the whole buffer keep what the network has
//! learned, so that a few updates of each image are enough.

use serde::{Deserialize, Serialize};

use super::features::RINGS;
use super::network::Adam;
use super::network::{Network, PARAMETERS};

/// The best sigma last found for an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct BestSigma {
    /// The network's input for the image.
    input: [f64; RINGS],
    /// The network output that gives the sigma.
    goal: f64,
    /// Range of the loss over all sigma tried.
    weight: f64,
}

/// The best sigma of all images, with the optimiser of the steps over them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct ReplayBuffer {
    found: Vec<BestSigma>,
    adam: Adam,
}

impl Default for ReplayBuffer {
    fn default() -> Self {
        Self { found: Vec::new(), adam: Adam::new(PARAMETERS) }
    }
}

impl ReplayBuffer {
    /// Stores an image's best sigma in place of the image's earlier entry.
    pub(super) fn keep(&mut self, input: [f64; RINGS], goal: f64, weight: f64) {
        let new = BestSigma { input, goal, weight };
        match self.found.iter_mut().find(|old| old.input == input) {
            Some(old) => *old = new,
            None => self.found.push(new),
        }
    }

    /// Trains the network for `steps` steps on the mean squared distance of its outputs from all goals, weighted by
    /// each image's range of the loss.
    pub(super) fn teach(&mut self, network: &mut Network, steps: usize, rate: f64) {
        let total: f64 = self.found.iter().map(|f| f.weight).sum();
        if total <= 0.0 {
            return;
        }
        for _ in 0..steps {
            let mut sum = vec![0.0; PARAMETERS];
            for BestSigma { input, goal, weight } in &self.found {
                let [output, _] = network.forward(input);
                let gradient = network.backward(input, [weight / total * (output - goal), 0.0]);
                sum.iter_mut().zip(&gradient).for_each(|(sum, g)| *sum += g);
            }
            self.adam.step(network.parameters_mut(), &sum, rate);
        }
    }

    /// Whether all numbers are finite and no weight is negative.
    pub(super) fn is_sound(&self) -> bool {
        let finite =
            |f: &BestSigma| f.input.iter().chain([&f.goal, &f.weight]).all(|v| v.is_finite()) && f.weight >= 0.0;
        self.adam.is_sound(PARAMETERS) && self.found.iter().all(finite)
    }
}
