//! Resampling of images.

/// The input pixels of one output pixel, and their weights.
struct Taps {
    first: usize,
    weights: Vec<f64>,
}

/// Triangle filters about the outputs' centres, widened where the image shrinks; weights sum to 1.
fn taps(from: usize, to: usize) -> Vec<Taps> {
    let scale = from as f64 / to as f64;
    let reach = scale.max(1.0);
    let one = |i: usize| {
        let centre = (i as f64 + 0.5) * scale - 0.5;
        let first = (centre - reach).ceil().max(0.0) as usize;
        let last = ((centre + reach).floor() as usize).min(from - 1);
        let weight = |k: usize| (1.0 - (k as f64 - centre).abs() / reach).max(0.0);
        let mut weights: Vec<f64> = (first..=last).map(weight).collect();
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
        Taps { first, weights }
    };
    (0..to).map(one).collect()
}

/// Resamples `from.0` x `from.1` values to `to.0` x `to.1`; no side is 0.
pub(super) fn resize(values: &[f32], from: (usize, usize), to: (usize, usize)) -> Vec<f32> {
    let (columns, rows) = (taps(from.0, to.0), taps(from.1, to.1));
    let mut narrow = Vec::with_capacity(to.0 * from.1);
    for row in values.chunks_exact(from.0) {
        narrow.extend(
            columns
                .iter()
                .map(|tap| row[tap.first..].iter().zip(&tap.weights).map(|(v, w)| f64::from(*v) * w).sum::<f64>()),
        );
    }
    let mut result = Vec::with_capacity(to.0 * to.1);
    let mut sums = vec![0.0; to.0];
    for tap in &rows {
        sums.fill(0.0);
        for (row, w) in narrow[tap.first * to.0..].chunks_exact(to.0).zip(&tap.weights) {
            sums.iter_mut().zip(row).for_each(|(sum, v)| *sum += v * w);
        }
        result.extend(sums.iter().map(|sum| *sum as f32));
    }
    result
}
