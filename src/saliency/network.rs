//! The sigma network: 16 values, 16 hidden units (tanh), 2 outputs; and its optimiser.

use serde::{Deserialize, Serialize};

use super::features::RINGS;
use crate::scene::random::Random;

const HIDDEN: usize = 16;
const OUTPUTS: usize = 2;
/// Offsets of the parameters: weights and biases of the hidden units, weights and biases of the outputs.
const HIDDEN_BIAS: usize = HIDDEN * RINGS;
const OUTPUT_WEIGHTS: usize = HIDDEN_BIAS + HIDDEN;
const OUTPUT_BIAS: usize = OUTPUT_WEIGHTS + OUTPUTS * HIDDEN;
/// How many parameters the network has.
pub const PARAMETERS: usize = OUTPUT_BIAS + OUTPUTS;

/// Two layers. Parameters lie row by row: each unit's weights, then the layer's biases.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Network {
    /// [`PARAMETERS`] values.
    pub(super) parameters: Vec<f64>,
}

impl Network {
    /// Random hidden weights (Glorot and Bengio 2010). Until the first step, the network gives `outputs` for every
    /// input.
    pub fn new(outputs: [f64; OUTPUTS], seed: u64) -> Self {
        let mut random = Random::new(seed);
        let bound = (6.0 / (RINGS + HIDDEN) as f64).sqrt();
        let mut parameters: Vec<f64> = (0..HIDDEN_BIAS).map(|_| bound * random.symmetric()).collect();
        parameters.resize(OUTPUT_BIAS, 0.0);
        parameters.extend(outputs);
        Self { parameters }
    }

    fn hidden(&self, input: &[f64; RINGS]) -> [f64; HIDDEN] {
        std::array::from_fn(|i| {
            let weights = &self.parameters[i * RINGS..][..RINGS];
            let sum: f64 = weights.iter().zip(input).map(|(w, x)| w * x).sum();
            (sum + self.parameters[HIDDEN_BIAS + i]).tanh()
        })
    }

    /// The outputs for an input.
    pub fn forward(&self, input: &[f64; RINGS]) -> [f64; OUTPUTS] {
        let hidden = self.hidden(input);
        std::array::from_fn(|o| {
            let weights = &self.parameters[OUTPUT_WEIGHTS + o * HIDDEN..][..HIDDEN];
            let sum: f64 = weights.iter().zip(&hidden).map(|(w, h)| w * h).sum();
            sum + self.parameters[OUTPUT_BIAS + o]
        })
    }

    /// Derivatives of a loss with respect to the parameters, from the derivatives with respect to the outputs for an
    /// input.
    pub fn backward(&self, input: &[f64; RINGS], by_output: [f64; OUTPUTS]) -> Vec<f64> {
        let hidden = self.hidden(input);
        let mut gradient = vec![0.0; PARAMETERS];
        for (o, g) in by_output.iter().enumerate() {
            gradient[OUTPUT_BIAS + o] = *g;
            for (i, h) in hidden.iter().enumerate() {
                gradient[OUTPUT_WEIGHTS + o * HIDDEN + i] = g * h;
                // Sums over the outputs, through the derivative of tanh.
                gradient[HIDDEN_BIAS + i] += g * self.parameters[OUTPUT_WEIGHTS + o * HIDDEN + i] * (1.0 - h * h);
            }
        }
        for i in 0..HIDDEN {
            let g = gradient[HIDDEN_BIAS + i];
            gradient[i * RINGS..][..RINGS].iter_mut().zip(input).for_each(|(w, x)| *w = g * x);
        }
        gradient
    }

    /// The parameters.
    pub fn parameters(&self) -> &[f64] {
        &self.parameters
    }

    /// The parameters, mutable.
    pub fn parameters_mut(&mut self) -> &mut [f64] {
        &mut self.parameters
    }

    pub(super) fn is_sound(&self) -> bool {
        self.parameters.len() == PARAMETERS && self.parameters.iter().all(|p| p.is_finite())
    }
}

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
