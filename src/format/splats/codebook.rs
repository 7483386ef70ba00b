//! A table of 256 numbers from which many numbers are taken: one-dimensional k-means.

use rayon::prelude::*;

/// Entries of a codebook.
pub(super) const ENTRIES: usize = 256;
/// Bins of the histogram from which the first entries are taken.
const BINS: usize = 1 << 14;
/// Most rounds of k-means.
const ROUNDS: usize = 40;

/// 256 ascending numbers near the given ones. Where there are at most 256 different numbers the table has each of them.
pub(super) fn of(values: impl ParallelIterator<Item = f32>) -> Vec<f32> {
    let mut sorted: Vec<f32> = values.collect();
    sorted.par_sort_unstable_by(f32::total_cmp);
    let mut different = sorted.clone();
    different.dedup();
    let Some(last) = different.last().copied() else { return vec![0.0; ENTRIES] };
    if different.len() <= ENTRIES {
        different.resize(ENTRIES, last);
        return different;
    }
    refined(&sorted, companded(&sorted))
}

/// First entries: as dense as the third root of the density of the numbers, which is best for fine steps (Panter and
/// Dite 1951).
fn companded(sorted: &[f32]) -> Vec<f64> {
    let (low, high) = (f64::from(sorted[0]), f64::from(sorted[sorted.len() - 1]));
    let width = (high - low) / BINS as f64;
    let mut counts = vec![0.0_f64; BINS];
    for v in sorted {
        counts[(((f64::from(*v) - low) / width) as usize).min(BINS - 1)] += 1.0;
    }
    let mut sum = 0.0;
    let shares: Vec<f64> = counts.iter().map(|count| (sum += count.cbrt(), sum).1).collect();
    (0..ENTRIES)
        .map(|entry| {
            let bin = shares.partition_point(|share| *share < sum * (entry as f64 + 0.5) / ENTRIES as f64);
            low + width * (bin as f64 + 0.5)
        })
        .collect()
}

/// Moves entries to the means of the numbers nearest to them (Lloyd 1982).
fn refined(sorted: &[f32], mut entries: Vec<f64>) -> Vec<f32> {
    let mut sum = 0.0;
    let sums: Vec<f64> = std::iter::once(0.0).chain(sorted.iter().map(|v| (sum += f64::from(*v), sum).1)).collect();
    for _ in 0..ROUNDS {
        let ends: Vec<usize> = entries
            .windows(2)
            .map(|pair| sorted.partition_point(|v| f64::from(*v) < 0.5 * (pair[0] + pair[1])))
            .chain([sorted.len()])
            .collect();
        let mut moved = false;
        let mut begin = 0;
        for (entry, end) in entries.iter_mut().zip(ends) {
            if end > begin {
                let mean = (sums[end] - sums[begin]) / (end - begin) as f64;
                moved |= mean != *entry;
                *entry = mean;
            }
            begin = end.max(begin);
        }
        if !moved {
            break;
        }
    }
    entries.sort_unstable_by(f64::total_cmp);
    entries.into_iter().map(|v| v as f32).collect()
}

/// Index of the entry nearest to a number.
pub(super) fn nearest(codebook: &[f32], value: f32) -> u8 {
    let above = codebook.partition_point(|entry| *entry < value).min(codebook.len() - 1);
    let below = above.saturating_sub(1);
    let nearer = if (value - codebook[below]).abs() <= (codebook[above] - value).abs() { below } else { above };
    nearer as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_different_numbers_are_all_in_the_table() {
        let values = [3.0, -1.0, 3.0, 0.25];
        let codebook = of(values.into_par_iter());
        assert_eq!(codebook.len(), ENTRIES);
        for v in values {
            assert_eq!(codebook[usize::from(nearest(&codebook, v))], v);
        }
        assert_eq!(of([].into_par_iter()), vec![0.0; ENTRIES]);
    }

    #[test]
    fn a_table_follows_the_density_of_the_numbers() {
        // A normal distribution by its quantiles, with two numbers far away.
        let normal = |k: usize| {
            let p = (k as f64 + 0.5) / 20_000.0;
            // Tukey's lambda approximation of the quantile.
            ((p.powf(0.135) - (1.0 - p).powf(0.135)) / 0.1975) as f32
        };
        let values: Vec<f32> = (0..20_000).map(normal).chain([-40.0, 60.0]).collect();
        let codebook = of(values.clone().into_par_iter());
        let error = |v: f32| f64::from(v - codebook[usize::from(nearest(&codebook, v))]);
        let rms = (values.iter().map(|v| error(*v).powi(2)).sum::<f64>() / values.len() as f64).sqrt();
        // The best 256 steps of a normal distribution have an error of 0.0103.
        assert!(rms < 0.0115, "{rms}");
        assert!(error(-40.0).abs() < 1e-5 && error(60.0).abs() < 1e-5);
        assert!(codebook.is_sorted());
    }
}
