//! The similarity between points of a dataset and measured places, in spite of a few wrong ones.

mod horn;
mod refine;

use crate::scene::Similarity;
use crate::scene::random::Random;

/// Triples of pairs that are tried. Of a set with a third wrong, one in three triples is sound.
const TRIPLES: usize = 400;
/// A pair further off than this many deviations of the sound ones is wrong.
const WRONG: f64 = 4.0;
/// Rounds of weighing pairs anew.
const ROUNDS: usize = 12;
/// Points that lie further from their places than this share of their extent (in the mean square) have nothing to do with
/// the places.
const MOST_OFF: f64 = 0.25;
/// Points whose second extent is less than this many deviations of the measurement lie on a line.
const LEAST_WIDTH: f64 = 3.0;

/// A point and its measured place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// The point in the dataset.
    pub point: [f64; 3],
    /// The place: metres east, north and up.
    pub place: [f64; 3],
    /// Standard deviations of the place in metres. Infinite where a coordinate was not measured.
    pub deviation: [f64; 3],
}

/// A similarity, and what it leaves of each pair.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// From the dataset to metres east, north and up.
    pub similarity: Similarity,
    /// What is measured less what the similarity gives, in metres. Not a number where nothing was measured.
    pub residuals: Vec<[f64; 3]>,
    /// Whether a pair was used: wrong ones were not.
    pub used: Vec<bool>,
}

/// Why nothing can be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoFit {
    /// Fewer than three pairs.
    #[error("{0} of at least 3 places are known")]
    TooFew(usize),
    /// Fewer than three heights.
    #[error("{0} of at least 3 heights are known")]
    NoHeights(usize),
    /// The points lie on a line, so that the scene may turn about it.
    #[error(
        "the places lie on a line (they are {along:.1} m long and {across:.1} m wide, measured to {deviation:.2} m), and \
         the scene may turn about the line"
    )]
    OnALine {
        /// Extent along the line in metres: a standard deviation.
        along: f64,
        /// Extent across in metres.
        across: f64,
        /// Deviation of the measurements in metres.
        deviation: f64,
    },
    /// No similarity brings most points to their places.
    #[error("no similarity brings more than {fitting} of {pairs} points to their places")]
    NoAgreement {
        /// Points that fit the best one.
        fitting: usize,
        /// All points.
        pairs: usize,
    },
}

/// Fits a similarity to pairs, of which less than half may be wrong. `least` is the residual, in deviations, below which
/// none is called wrong.
pub fn fit(pairs: &[Pair], least: f64) -> Result<Fit, NoFit> {
    check(pairs)?;
    let none = || NoFit::NoAgreement { fitting: 0, pairs: pairs.len() };
    let start = sound_start(pairs).ok_or_else(none)?;
    let mut similarity = start;
    let mut spread = 0.0;
    for _ in 0..ROUNDS {
        let off = normalised(pairs, &similarity);
        spread = deviation_of(&off).max(least / WRONG);
        // Cauchy's weights: a wrong pair pulls less, the further off the pair is.
        let weights: Vec<f64> = off.iter().map(|r| 1.0 / (1.0 + (r / (2.0 * spread)).powi(2))).collect();
        similarity = refine::step(pairs, &weights, &similarity).unwrap_or(similarity);
    }
    let mut used: Vec<bool> = normalised(pairs, &similarity).iter().map(|r| *r <= WRONG * spread).collect();
    for _ in 0..ROUNDS {
        let weights: Vec<f64> = used.iter().map(|used| f64::from(u8::from(*used))).collect();
        similarity = refine::step(pairs, &weights, &similarity).unwrap_or(similarity);
        used = normalised(pairs, &similarity).iter().map(|r| *r <= WRONG * spread).collect();
    }
    let fitting = used.iter().filter(|used| **used).count();
    if fitting < 3 || 2 * fitting <= pairs.len() {
        return Err(NoFit::NoAgreement { fitting, pairs: pairs.len() });
    }
    let kept: Vec<Pair> = pairs.iter().zip(&used).filter(|(_, used)| **used).map(|(pair, _)| *pair).collect();
    let extent = check(&kept)?;
    let square = |pair: &Pair| {
        let [east, north, _] = residual(pair, &similarity);
        east * east + north * north
    };
    if (kept.iter().map(square).sum::<f64>() / kept.len() as f64).sqrt() > MOST_OFF * extent {
        return Err(none());
    }
    let residuals = pairs.iter().map(|pair| residual(pair, &similarity)).collect();
    Ok(Fit { similarity, residuals, used })
}

/// Refuses pairs that leave the similarity open. The result is the extent of the places in the plane.
fn check(pairs: &[Pair]) -> Result<f64, NoFit> {
    if pairs.len() < 3 {
        return Err(NoFit::TooFew(pairs.len()));
    }
    let heights = pairs.iter().filter(|pair| pair.deviation[2].is_finite()).count();
    if heights < 3 {
        return Err(NoFit::NoHeights(heights));
    }
    // In the plane: a flight's heights tell little, and may be unknown.
    let n = pairs.len() as f64;
    let mean: [f64; 3] = std::array::from_fn(|k| pairs.iter().map(|pair| pair.place[k]).sum::<f64>() / n);
    let of = |i: usize, j: usize| {
        pairs.iter().map(|pair| (pair.place[i] - mean[i]) * (pair.place[j] - mean[j])).sum::<f64>() / n
    };
    let (a, b, c) = (of(0, 0), of(0, 1), of(1, 1));
    let apart = (0.25 * (a - c).powi(2) + b * b).sqrt();
    let [along, across] = [0.5 * (a + c) + apart, 0.5 * (a + c) - apart].map(|v| v.max(0.0).sqrt());
    let mut deviations: Vec<f64> = pairs.iter().map(|pair| pair.deviation[0].max(pair.deviation[1])).collect();
    let deviation = median(&mut deviations);
    if across < LEAST_WIDTH * deviation / n.sqrt() || across < 1e-3 * along || along == 0.0 {
        return Err(NoFit::OnALine { along, across, deviation });
    }
    Ok(along)
}

fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    values.sort_by(f64::total_cmp);
    values.get(middle).copied().unwrap_or(0.0)
}

/// What is measured less what a similarity gives.
fn residual(pair: &Pair, similarity: &Similarity) -> [f64; 3] {
    let at = similarity.point(pair.point);
    let off = |k: usize| if pair.deviation[k].is_finite() { pair.place[k] - at[k] } else { f64::NAN };
    [off(0), off(1), off(2)]
}

/// Lengths of the residuals in deviations, per measured coordinate.
fn normalised(pairs: &[Pair], similarity: &Similarity) -> Vec<f64> {
    let length = |pair: &Pair| {
        let known: Vec<f64> = (0..3)
            .filter(|k| pair.deviation[*k].is_finite())
            .map(|k| (residual(pair, similarity)[k] / pair.deviation[k]).powi(2))
            .collect();
        (known.iter().sum::<f64>() / known.len().max(1) as f64).sqrt()
    };
    pairs.iter().map(length).collect()
}

/// The deviation of the sound pairs by the median, which half of the pairs cannot move far.
fn deviation_of(off: &[f64]) -> f64 {
    // The median of the length of three normal coordinates over the square root of three is 0.888 deviations. The
    // similarity takes seven coordinates out of few pairs, which makes their residuals small.
    let mut sorted = off.to_vec();
    let free = (3.0 * off.len() as f64 - 7.0).max(2.0) / (3.0 * off.len() as f64);
    median(&mut sorted) / 0.888 / free.sqrt()
}

/// The similarity of three pairs that leaves the least median of residuals.
fn sound_start(pairs: &[Pair]) -> Option<Similarity> {
    let whole: Vec<usize> = (0..pairs.len()).filter(|k| pairs[*k].deviation[2].is_finite()).collect();
    let mut best: Option<(f64, Similarity)> = None;
    let mut look = |triple: [usize; 3]| {
        let Some(found) = horn::similarity(&triple.map(|k| pairs[k])) else { return };
        let off = median(&mut normalised(pairs, &found));
        if best.is_none_or(|(least, _)| off < least) {
            best = Some((off, found));
        }
    };
    let n = whole.len();
    if n * (n - 1) * (n - 2) / 6 <= TRIPLES {
        for i in 0..n {
            for j in 0..i {
                (0..j).for_each(|k| look([whole[i], whole[j], whole[k]]));
            }
        }
    } else {
        let mut random = Random::new(1);
        for _ in 0..TRIPLES {
            let mut draw = || (random.unit() * n as f64) as usize % n;
            let [i, j, k] = [draw(), draw(), draw()];
            if i != j && j != k && i != k {
                look([whole[i], whole[j], whole[k]]);
            }
        }
    }
    // All pairs at once are better than three where nothing is wrong.
    if let Some(all) =
        horn::similarity(pairs.iter().filter(|p| p.deviation[2].is_finite()).copied().collect::<Vec<_>>().as_slice())
    {
        let off = median(&mut normalised(pairs, &all));
        if best.is_none_or(|(least, _)| off < least) {
            best = Some((off, all));
        }
    }
    best.map(|(_, similarity)| similarity)
}

#[cfg(test)]
mod tests;
