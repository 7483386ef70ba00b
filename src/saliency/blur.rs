//! Gaussian blur of images.

use super::Border;

/// Standard deviation in pixels below which only the centre of the kernel counts.
const NOTHING: f64 = 0.2;

/// Index of the pixel at position `i`, inside or outside, of a side of `n` pixels.
pub(super) fn at(i: isize, n: usize, border: Border) -> usize {
    match border {
        Border::Periodic => i.rem_euclid(n as isize) as usize,
        Border::Reflect => {
            let at = i.rem_euclid(2 * n as isize) as usize;
            at.min(2 * n - 1 - at)
        }
    }
}

/// Blurs by a Gaussian with a standard deviation of `sigma` pixels, cut off at 3 sigma; weights sum to 1.
pub(super) fn gaussian(values: Vec<f64>, (width, height): (usize, usize), sigma: f64, border: Border) -> Vec<f64> {
    if sigma < NOTHING {
        return values;
    }
    let radius = (3.0 * sigma).ceil() as isize;
    let weight = |d: isize| (-0.5 * (d as f64 / sigma).powi(2)).exp();
    let total: f64 = (-radius..=radius).map(weight).sum();
    let kernel: Vec<f64> = (-radius..=radius).map(|d| weight(d) / total).collect();

    let around = |n: usize| (-radius..n as isize + radius).map(move |i| at(i, n, border));
    let columns: Vec<usize> = around(width).collect();
    let mut wide = vec![0.0; columns.len()];
    let mut along = Vec::with_capacity(values.len());
    for row in values.chunks_exact(width) {
        wide.iter_mut().zip(&columns).for_each(|(w, x)| *w = row[*x]);
        along.extend(wide.windows(kernel.len()).map(|part| part.iter().zip(&kernel).map(|(v, w)| v * w).sum::<f64>()));
    }
    let rows: Vec<usize> = around(height).collect();
    let mut result = vec![0.0; values.len()];
    for (out, sources) in result.chunks_exact_mut(width).zip(rows.windows(kernel.len())) {
        for (y, w) in sources.iter().zip(&kernel) {
            out.iter_mut().zip(&along[y * width..]).for_each(|(sum, v)| *sum += v * w);
        }
    }
    result
}
