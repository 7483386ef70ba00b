//! A palette for rows of numbers: k-means in two levels.
//!
//! Plain k-means compares each row with each entry: for 300,000 rows and 32,768 entries 10^10 distances a round. Here
//! rows are first divided into about the root of that many groups, and each group gets entries of its own, more where
//! its rows differ more. A row is compared with the entries of its group only.

use rayon::prelude::*;

use crate::scene::random::Random;

/// Floats in a step of a distance.
const LANES: usize = 8;
/// Rounds of k-means for groups, and for the entries of a group.
const ROUNDS: usize = 8;
/// Rows per group on which the groups are found.
const SAMPLE: usize = 256;
/// Rows that a thread takes at once.
const BLOCK: usize = 1024;

/// Entries, and for each row the index of its entry.
pub(super) struct Palette {
    /// `dimensions` floats each.
    pub(super) entries: Vec<f32>,
    pub(super) labels: Vec<u32>,
}

/// Rows of a number of floats that is a multiple of [`LANES`].
struct Rows {
    stride: usize,
    floats: Vec<f32>,
}

impl Rows {
    fn len(&self) -> usize {
        self.floats.len() / self.stride
    }

    fn row(&self, i: usize) -> &[f32] {
        &self.floats[self.stride * i..self.stride * (i + 1)]
    }

    /// Some rows, in the given order.
    fn chosen(&self, which: &[u32]) -> Self {
        let floats = which.iter().flat_map(|i| self.row(*i as usize)).copied().collect();
        Self { stride: self.stride, floats }
    }
}

/// At most `most` entries for rows of `dimensions` floats. The same rows give the same palette.
pub(super) fn of(rows: &[f32], dimensions: usize, most: usize) -> Palette {
    let stride = dimensions.next_multiple_of(LANES);
    let padded =
        |row: &[f32]| row.iter().copied().chain(std::iter::repeat_n(0.0, stride - dimensions)).collect::<Vec<_>>();
    let rows = Rows { stride, floats: rows.chunks_exact(dimensions).flat_map(padded).collect() };
    let n = rows.len();
    let (entries, labels) =
        if n <= most { (rows.floats.clone(), (0..n as u32).collect()) } else { two_levels(&rows, most) };
    let entries = entries.chunks_exact(stride).flat_map(|entry| &entry[..dimensions]).copied().collect();
    Palette { entries, labels }
}

fn two_levels(rows: &Rows, most: usize) -> (Vec<f32>, Vec<u32>) {
    let n = rows.len();
    let groups = ((most as f64).sqrt().ceil() as usize).min(most);
    let sample: Vec<u32> = spread(n, (groups * SAMPLE).min(n));
    let centres = k_means(&rows.chosen(&sample), groups, 1).0;
    let nearest = assigned(rows, &centres);
    let mut members = vec![Vec::new(); centres.len()];
    let mut errors = vec![0.0_f64; centres.len()];
    for (i, (group, error)) in nearest.iter().enumerate() {
        members[*group as usize].push(i as u32);
        errors[*group as usize] += f64::from(*error);
    }
    let shares = shares(&members, &errors, most);
    let found: Vec<(Rows, Vec<u32>)> = members
        .par_iter()
        .zip(&shares)
        .enumerate()
        .map(|(seed, (members, share))| k_means(&rows.chosen(members), *share, seed as u64 + 2))
        .collect();
    let mut labels = vec![0; n];
    let mut entries = Vec::new();
    for (members, (own, own_labels)) in members.iter().zip(found) {
        let first = (entries.len() / rows.stride) as u32;
        entries.extend(own.floats);
        members.iter().zip(own_labels).for_each(|(i, label)| labels[*i as usize] = first + label);
    }
    (entries, labels)
}

/// How many entries each group gets, `most` in all at most: one, and more in proportion to the sum of its squared
/// distances.
fn shares(members: &[Vec<u32>], errors: &[f64], most: usize) -> Vec<usize> {
    let used = members.iter().filter(|rows| !rows.is_empty()).count();
    let spare = most.saturating_sub(used) as f64;
    let total: f64 = errors.iter().sum();
    let share = |(rows, error): (&Vec<u32>, &f64)| match rows.len() {
        0 => 0,
        n => n.min(1 + (spare * error / total.max(f64::MIN_POSITIVE)) as usize),
    };
    members.iter().zip(errors).map(share).collect()
}

/// `count` numbers below `n`, evenly spread.
fn spread(n: usize, count: usize) -> Vec<u32> {
    (0..count).map(|k| (k as u64 * n as u64 / count as u64) as u32).collect()
}

/// At most `k` centres of rows, and for each row the index of the centre nearest to it.
fn k_means(rows: &Rows, k: usize, seed: u64) -> (Rows, Vec<u32>) {
    let n = rows.len();
    if n <= k {
        return (rows.chosen(&spread(n, n)), (0..n as u32).collect());
    }
    let mut random = Random::new(seed);
    // A random row of each of k parts: rows are along a curve through space, and neighbours have much in common.
    let first: Vec<u32> = (0..k)
        .map(|part| {
            let (begin, end) = (part * n / k, (part + 1) * n / k);
            (begin + (random.range(0.0, 1.0) * (end - begin) as f64) as usize).min(end - 1) as u32
        })
        .collect();
    let mut centres = rows.chosen(&first);
    let mut nearest = assigned(rows, &centres);
    for _ in 0..ROUNDS {
        recentre(rows, &mut centres, &mut nearest);
        let next = assigned(rows, &centres);
        let same = next.iter().zip(&nearest).all(|(a, b)| a.0 == b.0);
        nearest = next;
        if same {
            break;
        }
    }
    (centres, nearest.into_iter().map(|(label, _)| label).collect())
}

/// Moves each centre to the mean of its rows. A centre without rows takes the row that is farthest from its own centre.
fn recentre(rows: &Rows, centres: &mut Rows, nearest: &mut [(u32, f32)]) {
    let stride = rows.stride;
    let mut sums = vec![0.0_f64; centres.floats.len()];
    let mut counts = vec![0_u32; centres.len()];
    for (i, (label, _)) in nearest.iter().enumerate() {
        let sum = &mut sums[stride * *label as usize..][..stride];
        sum.iter_mut().zip(rows.row(i)).for_each(|(sum, v)| *sum += f64::from(*v));
        counts[*label as usize] += 1;
    }
    for (label, count) in counts.iter().enumerate() {
        let centre = &mut centres.floats[stride * label..][..stride];
        if *count > 0 {
            let sum = &sums[stride * label..][..stride];
            centre.iter_mut().zip(sum).for_each(|(v, sum)| *v = (sum / f64::from(*count)) as f32);
            continue;
        }
        let farthest = nearest.iter().enumerate().max_by(|a, b| a.1.1.total_cmp(&b.1.1)).map_or(0, |(i, _)| i);
        centre.copy_from_slice(rows.row(farthest));
        nearest[farthest].1 = 0.0;
    }
}

/// For each row the index of the nearest centre, and the squared distance to it.
fn assigned(rows: &Rows, centres: &Rows) -> Vec<(u32, f32)> {
    rows.floats
        .par_chunks(rows.stride * BLOCK)
        .flat_map_iter(|block| block.chunks_exact(rows.stride).map(|row| nearest_of(row, centres)))
        .collect()
}

fn nearest_of(row: &[f32], centres: &Rows) -> (u32, f32) {
    let all = centres.floats.chunks_exact(centres.stride).zip(0..);
    all.fold((0, f32::INFINITY), |best, (centre, label)| {
        let distance = squared(row, centre, best.1);
        if distance < best.1 { (label, distance) } else { best }
    })
}

/// The squared distance of two rows, or any number from `enough` on where the distance is not smaller.
fn squared(a: &[f32], b: &[f32], enough: f32) -> f32 {
    let mut sum = 0.0;
    for (a, b) in a.chunks_exact(LANES).zip(b.chunks_exact(LANES)) {
        let mut lanes = [0.0_f32; LANES];
        for k in 0..LANES {
            let d = a[k] - b[k];
            lanes[k] = d * d;
        }
        sum += ((lanes[0] + lanes[4]) + (lanes[1] + lanes[5])) + ((lanes[2] + lanes[6]) + (lanes[3] + lanes[7]));
        if sum >= enough {
            break;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows in clumps, and the clump of each.
    fn clumps(count: usize, rows: usize) -> (Vec<f32>, Vec<usize>) {
        let mut random = Random::new(3);
        let centres: Vec<f32> = (0..9 * count).map(|_| random.range(-1.0, 1.0) as f32).collect();
        let which: Vec<usize> = (0..rows).map(|i| i * 7 % count).collect();
        let near = |c: usize, random: &mut Random| {
            centres[9 * c..9 * (c + 1)].iter().map(|v| v + random.range(-0.01, 0.01) as f32).collect::<Vec<_>>()
        };
        (which.iter().flat_map(|c| near(*c, &mut random)).collect(), which)
    }

    #[test]
    fn a_palette_follows_the_clumps_of_its_rows() {
        let (rows, _) = clumps(40, 3000);
        let palette = of(&rows, 9, 200);
        assert!(palette.entries.len() <= 9 * 200 && palette.labels.len() == 3000);
        let error = |i: usize| {
            let entry = &palette.entries[9 * palette.labels[i] as usize..][..9];
            entry.iter().zip(&rows[9 * i..]).map(|(a, b)| (a - b).powi(2)).sum::<f32>()
        };
        let worst = (0..3000).map(error).fold(0.0, f32::max);
        // Two numbers of a clump differ by 0.02 at most, those of two clumps by much more.
        assert!(worst < 9.0 * 0.02 * 0.02, "{worst}");
    }

    #[test]
    fn few_rows_are_their_own_palette() {
        let rows = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let palette = of(&rows, 3, 2);
        assert_eq!((palette.entries.as_slice(), palette.labels.as_slice()), (&rows[..], &[0, 1][..]));
        let same = of(&[0.5; 3000], 3, 64);
        assert!(same.entries.chunks_exact(3).all(|entry| entry == [0.5; 3]));
        assert!(of(&[], 3, 64).labels.is_empty());
    }
}
