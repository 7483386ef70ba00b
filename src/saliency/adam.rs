//! The optimiser of the sigma network.

use serde::{Deserialize, Serialize};

const BETA1: f64 = 0.9;
const BETA2: f64 = 0.999;
const EPSILON: f64 = 1e-8;

/// Adam (Kingma and Ba, ICLR 2015) with bias correction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Adam {
    first: Vec<f64>,
    second: Vec<f64>,
    steps: u64,
}

impl Adam {
    pub(super) fn new(parameters: usize) -> Self {
        Self { first: vec![0.0; parameters], second: vec![0.0; parameters], steps: 0 }
    }

    pub(super) fn steps(&self) -> u64 {
        self.steps
    }

    /// One step against the gradient, at the learning rate `rate`.
    pub(super) fn step(&mut self, parameters: &mut [f64], gradient: &[f64], rate: f64) {
        self.steps += 1;
        let t = self.steps as f64;
        let (c1, c2) = (1.0 - BETA1.powf(t), 1.0 - BETA2.powf(t));
        let moments = self.first.iter_mut().zip(&mut self.second);
        for ((p, g), (m, v)) in parameters.iter_mut().zip(gradient).zip(moments) {
            *m = BETA1 * *m + (1.0 - BETA1) * g;
            *v = BETA2 * *v + (1.0 - BETA2) * g * g;
            *p -= rate * (*m / c1) / ((*v / c2).sqrt() + EPSILON);
        }
    }

    /// Whether the state fits the number of parameters and every moment is finite.
    pub(super) fn is_sound(&self, parameters: usize) -> bool {
        let finite = self.first.iter().all(|m| m.is_finite());
        let positive = self.second.iter().all(|v| v.is_finite() && *v >= 0.0);
        self.first.len() == parameters && self.second.len() == parameters && finite && positive
    }
}
