//! Discrete Fourier transforms of images.

use std::sync::Arc;

use rustfft::num_complex::Complex64;
use rustfft::{Fft, FftPlanner};

/// Side of a block of the transposition: one block fits the innermost cache.
const BLOCK: usize = 16;

/// The transforms of one size.
#[derive(Clone)]
pub(super) struct Fft2 {
    width: usize,
    height: usize,
    forward: [Arc<dyn Fft<f64>>; 2],
    inverse: [Arc<dyn Fft<f64>>; 2],
}

impl Fft2 {
    /// For images of this size; no side is 0.
    pub(super) fn new(width: usize, height: usize) -> Self {
        let mut planner = FftPlanner::new();
        let forward = [width, height].map(|n| planner.plan_fft_forward(n));
        let inverse = [width, height].map(|n| planner.plan_fft_inverse(n));
        Self { width, height, forward, inverse }
    }

    /// Sums of `values * exp(-2 pi i (ux/W + vy/H))`, in place.
    pub(super) fn forward(&self, values: &mut Vec<Complex64>) {
        self.transform(values, &self.forward);
    }

    /// The inverse of [`Fft2::forward`], the factor 1/(W H) included.
    pub(super) fn inverse(&self, values: &mut Vec<Complex64>) {
        self.transform(values, &self.inverse);
        let factor = 1.0 / values.len() as f64;
        values.iter_mut().for_each(|v| *v *= factor);
    }

    fn transform(&self, values: &mut Vec<Complex64>, [along_rows, along_columns]: &[Arc<dyn Fft<f64>>; 2]) {
        along_rows.process(values);
        let mut turned = transposed(values, self.width, self.height);
        along_columns.process(&mut turned);
        *values = transposed(&turned, self.height, self.width);
    }
}

fn transposed(values: &[Complex64], width: usize, height: usize) -> Vec<Complex64> {
    let mut turned = vec![Complex64::default(); values.len()];
    for top in (0..height).step_by(BLOCK) {
        for left in (0..width).step_by(BLOCK) {
            for y in top..(top + BLOCK).min(height) {
                for x in left..(left + BLOCK).min(width) {
                    turned[x * height + y] = values[y * width + x];
                }
            }
        }
    }
    turned
}

/// The smallest length of at least `n` without a prime factor above 5, for which a transform is fast.
pub(super) fn quick_length(n: usize) -> usize {
    let smooth = |mut m: usize| {
        for p in [2, 3, 5] {
            while m.is_multiple_of(p) {
                m /= p;
            }
        }
        m == 1
    };
    (n.max(1)..).find(|m| smooth(*m)).unwrap_or(n)
}
