//! How far the colours of the same surfaces differ between photographs by a gain of each photograph: its exposure or white balance.
//!
//! With l the logarithm of what photograph i shows of point j in one channel, d the direction it is seen from, and r noise,
//!
//! ```text
//! l_ij = a_j + f(d_ij) + g_i + r_ij
//! ```
//!
//! a is the point's own colour, f one sum of spherical harmonics for all points, and g the photograph's gain. What the direction explains
//! (light that falls from one side, a haze, a camera that follows the light as it moves about the subject) the splats can learn by
//! themselves: so f is fitted first, and g to what f leaves. Points that had no part in the fits say how much of their squared differences
//! the gains take away.

use rayon::prelude::*;

use crate::scene::sh;

/// Spherical harmonics up to degree 3 without the constant.
const TERMS: usize = 15;
/// A quarter of the points is left out of each fit.
const FOLDS: u32 = 4;
/// Rounds of a robust fit.
const ROUNDS: usize = 4;
/// Differences beyond this many deviations count as these.
const CLIPPED: f64 = 3.0;
/// From a median of absolute values to a standard deviation, and from that of a sample to the one of the sample's
/// median.
const MEDIAN_TO_DEVIATION: f64 = 1.4826;
const MEDIAN_ERROR: f64 = 1.2533;

/// What one photograph shows of one point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// The point.
    pub(super) point: u32,
    /// The photograph.
    pub(super) view: u32,
    /// Logarithms of red, green and blue.
    pub(super) colour: [f64; 3],
    /// From the point to the camera, of length 1.
    pub(super) direction: [f64; 3],
}

/// How far gains of the photographs explain that colours differ.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ColourGains {
    /// The share of the squared differences of left-out points that the gains take away, of what the viewing direction
    /// leaves.
    pub share: f64,
    /// The standard error of the share.
    pub share_error: f64,
    /// What the gains explain, as a root mean square of logarithms: 0.05 is 5 % of a colour.
    pub spread: f64,
    /// Points that several photographs see.
    pub points: usize,
    /// The logarithms of each photograph's gains of red, green and blue, 0 in the mean, with their standard errors, if
    /// directions explain nothing; `None` where the photograph shows none of the points.
    pub gains: Vec<Option<[Gain; 3]>>,
}

/// A gain of one channel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gain {
    /// Its logarithm.
    pub log: f64,
    /// The standard error of that.
    pub error: f64,
}

/// Fits the gains of so many photographs, and tests them on points left out. Nothing without points.
pub(super) fn fitted(seen: &[Seen], views: usize) -> Option<ColourGains> {
    let all = Part::of(seen, views, |_| true)?;
    let folds: Vec<[f64; 2]> = (0..FOLDS).into_par_iter().filter_map(|fold| squares(seen, views, fold)).collect();
    if folds.is_empty() {
        return None;
    }
    let count = folds.len() as f64;
    let shares: Vec<f64> = folds.iter().map(|[before, after]| 1.0 - after / before.max(f64::MIN_POSITIVE)).collect();
    let share = shares.iter().sum::<f64>() / count;
    let variance = shares.iter().map(|s| (s - share).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    let explained = folds.iter().map(|[before, after]| (before - after) / 3.0).sum::<f64>() / count;
    let channels: Vec<Vec<Option<Gain>>> = (0..3).into_par_iter().map(|c| all.gains_with_errors(c)).collect();
    Some(ColourGains {
        share,
        share_error: (variance / count).sqrt(),
        spread: explained.max(0.0).sqrt(),
        points: all.points.ends.len(),
        gains: (0..views).map(|v| Some([channels[0][v]?, channels[1][v]?, channels[2][v]?])).collect(),
    })
}

/// The mean squared differences of the points of a fold, in the sum of the channels: without what the direction
/// explains, and without what the gains explain too. Neither was fitted to these points.
fn squares(seen: &[Seen], views: usize, fold: u32) -> Option<[f64; 2]> {
    let known = Part::of(seen, views, |point| point % FOLDS != fold)?;
    let left_out = Part::of(seen, views, |point| point % FOLDS == fold)?;
    let mut sums = [0.0; 2];
    for channel in 0..3 {
        let (known_colours, colours) = (&known.colours[channel], &left_out.colours[channel]);
        let terms = known.direction(known_colours);
        let gains = known.gains(&known.without_direction(known_colours, &terms));
        let limit = CLIPPED * deviation(&left_out.differences(colours));
        let without_direction = left_out.without_direction(colours, &terms);
        let without_gains = left_out.without(&without_direction, &gains);
        for (sum, values) in sums.iter_mut().zip([&without_direction, &without_gains]) {
            let differences = left_out.differences(values);
            let squares = differences.iter().map(|d| d.abs().min(limit).powi(2)).sum::<f64>();
            *sum += squares / differences.len() as f64;
        }
    }
    Some(sums)
}

/// Positions of observations by what they belong to.
struct Groups {
    ends: Vec<usize>,
    items: Vec<usize>,
}

impl Groups {
    /// Of keys below `count`, one for each observation.
    fn new(keys: &[usize], count: usize) -> Self {
        let mut ends = vec![0; count];
        keys.iter().for_each(|key| ends[*key] += 1);
        let mut sum = 0;
        let start = |count: &usize| {
            sum += count;
            sum - count
        };
        let mut next: Vec<usize> = ends.iter().map(start).collect();
        let mut items = vec![0; keys.len()];
        for (item, key) in keys.iter().enumerate() {
            items[next[*key]] = item;
            next[*key] += 1;
        }
        Self { ends: next, items }
    }

    fn iter(&self) -> impl Iterator<Item = &[usize]> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, end)| &self.items[start..*end])
    }
}

/// Some of the points with what photographs show of them.
struct Part {
    colours: [Vec<f64>; 3],
    terms: Vec<[f64; TERMS]>,
    view: Vec<usize>,
    points: Groups,
    views: Groups,
}

impl Part {
    /// Of the points for which `wanted` is true; nothing without any.
    fn of(seen: &[Seen], views: usize, wanted: impl Fn(u32) -> bool) -> Option<Self> {
        let of: Vec<&Seen> = seen.iter().filter(|seen| wanted(seen.point)).collect();
        let mut numbers: Vec<u32> = of.iter().map(|seen| seen.point).collect();
        numbers.sort_unstable();
        numbers.dedup();
        let point: Vec<usize> = of.iter().filter_map(|seen| numbers.binary_search(&seen.point).ok()).collect();
        let view: Vec<usize> = of.iter().map(|seen| seen.view as usize).collect();
        (!of.is_empty()).then(|| Self {
            colours: std::array::from_fn(|c| of.iter().map(|seen| seen.colour[c]).collect()),
            terms: of.iter().map(|seen| terms(seen.direction)).collect(),
            points: Groups::new(&point, numbers.len()),
            views: Groups::new(&view, views),
            view,
        })
    }

    /// What of a channel's values depends on the direction, by its terms: least squares in which far-off values weigh
    /// little.
    fn direction(&self, colours: &[f64]) -> [f64; TERMS] {
        let mut weights = vec![1.0; colours.len()];
        let mut found = [0.0; TERMS];
        for _ in 0..ROUNDS {
            let (mut squares, mut right) = ([[0.0; TERMS]; TERMS], [0.0; TERMS]);
            for point in self.points.iter() {
                let sum: f64 = point.iter().map(|i| weights[*i]).sum();
                let mean = |of: &dyn Fn(usize) -> f64| point.iter().map(|i| weights[*i] * of(*i)).sum::<f64>() / sum;
                let colour = mean(&|i| colours[i]);
                let terms: [f64; TERMS] = std::array::from_fn(|k| mean(&|i| self.terms[i][k]));
                for &i in point {
                    let x: [f64; TERMS] = std::array::from_fn(|k| self.terms[i][k] - terms[k]);
                    for k in 0..TERMS {
                        right[k] += weights[i] * x[k] * (colours[i] - colour);
                        (0..=k).for_each(|m| squares[k][m] += weights[i] * x[k] * x[m]);
                    }
                }
            }
            found = solved(squares, right);
            let rest = self.differences(&self.without_direction(colours, &found));
            let scale = 2.0 * deviation(&rest).max(1e-9);
            weights = rest.iter().map(|r| 1.0 / (1.0 + (r / scale).powi(2))).collect();
        }
        found
    }

    fn without_direction(&self, values: &[f64], of: &[f64; TERMS]) -> Vec<f64> {
        let along = |terms: &[f64; TERMS]| terms.iter().zip(of).map(|(a, b)| a * b).sum::<f64>();
        values.iter().zip(&self.terms).map(|(value, terms)| value - along(terms)).collect()
    }

    fn without(&self, values: &[f64], gains: &[f64]) -> Vec<f64> {
        values.iter().zip(&self.view).map(|(value, view)| value - gains[*view]).collect()
    }

    /// The gain of each photograph, 0 in the mean: the median over its points of what is above the point's own median
    /// over photographs, and so on in turns.
    fn gains(&self, values: &[f64]) -> Vec<f64> {
        let mut gains = vec![0.0; self.views.ends.len()];
        for _ in 0..ROUNDS {
            let rest = self.without(values, &gains);
            let mut above = values.to_vec();
            for point in self.points.iter() {
                let own = median(point.iter().map(|i| rest[*i]).collect());
                point.iter().for_each(|i| above[*i] -= own);
            }
            let seen: Vec<Option<f64>> = self
                .views
                .iter()
                .map(|view| (!view.is_empty()).then(|| median(view.iter().map(|i| above[*i]).collect())))
                .collect();
            let mean = seen.iter().flatten().sum::<f64>() / seen.iter().flatten().count().max(1) as f64;
            gains = seen.into_iter().map(|gain| gain.map_or(0.0, |gain| gain - mean)).collect();
        }
        gains
    }

    /// The gains as maps of the photographs would have them: nothing is left to the direction.
    fn gains_with_errors(&self, channel: usize) -> Vec<Option<Gain>> {
        let colours = &self.colours[channel];
        let gains = self.gains(colours);
        let rest = self.differences(&self.without(colours, &gains));
        let gain = |(view, log): (&[usize], f64)| {
            let scatter = deviation(&view.iter().map(|i| rest[*i]).collect::<Vec<_>>());
            let error = MEDIAN_ERROR * scatter / (view.len() as f64).sqrt();
            (!view.is_empty()).then_some(Gain { log, error })
        };
        self.views.iter().zip(gains).map(gain).collect()
    }

    /// How far each value is from the mean of its point's; larger where these are few, by what their mean has taken in.
    fn differences(&self, values: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; values.len()];
        for point in self.points.iter() {
            let count = point.len() as f64;
            let mean = point.iter().map(|i| values[*i]).sum::<f64>() / count;
            let freedom = (count / (count - 1.0).max(1.0)).sqrt();
            point.iter().for_each(|i| out[*i] = freedom * (values[*i] - mean));
        }
        out
    }
}

fn terms(direction: [f64; 3]) -> [f64; TERMS] {
    let basis = sh::basis(direction, 3);
    std::array::from_fn(|k| basis[k + 1])
}

/// The standard deviation, by the median of absolute values.
fn deviation(differences: &[f64]) -> f64 {
    MEDIAN_TO_DEVIATION * median(differences.iter().map(|d| d.abs()).collect())
}

/// The middle value, or the mean of the two; 0 of none.
fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() {
        return 0.0;
    }
    let odd = values.len() % 2 == 1;
    let (below, upper, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    let lower = if odd { *upper } else { below.iter().copied().fold(f64::MIN, f64::max) };
    (lower + *upper) / 2.0
}

/// Solves symmetric equations of which the lower half is given, by Cholesky's method. What the directions do not tell
/// stays near 0.
fn solved(mut squares: [[f64; TERMS]; TERMS], mut right: [f64; TERMS]) -> [f64; TERMS] {
    let trace: f64 = (0..TERMS).map(|k| squares[k][k]).sum();
    let ridge = 1e-6 * trace / TERMS as f64 + f64::MIN_POSITIVE;
    for k in 0..TERMS {
        squares[k][k] += ridge;
        for m in 0..=k {
            let product: f64 = (0..m).map(|n| squares[k][n] * squares[m][n]).sum();
            let rest = squares[k][m] - product;
            squares[k][m] = if m == k { rest.max(ridge).sqrt() } else { rest / squares[m][m] };
        }
        let known: f64 = (0..k).map(|m| squares[k][m] * right[m]).sum();
        right[k] = (right[k] - known) / squares[k][k];
    }
    for k in (0..TERMS).rev() {
        let known: f64 = (k + 1..TERMS).map(|m| squares[m][k] * right[m]).sum();
        right[k] = (right[k] - known) / squares[k][k];
    }
    right
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::random::Random;

    const VIEWS: usize = 30;
    const POINTS: u32 = 400;

    /// Cameras in rows above a square of points, each of which looks at the points below it.
    fn flight(colour: impl Fn(u32, usize, [f64; 3], usize) -> f64) -> Vec<Seen> {
        let mut random = Random::stream(5, 1);
        let mut seen = Vec::new();
        for point in 0..POINTS {
            let [x, y] = [f64::from(point % 20), f64::from(point / 20)];
            let own = [(); 3].map(|()| random.range(-2.0, -0.2));
            for view in 0..VIEWS {
                let away = [4.0 * (view % 6) as f64 - x, 5.0 * (view / 6) as f64 - y, 8.0];
                let length = away.iter().map(|v| v * v).sum::<f64>().sqrt();
                if length > 12.0 {
                    continue;
                }
                let direction = away.map(|v| v / length);
                let noise = [(); 3].map(|()| 0.03 * (random.range(-1.0, 1.0) + random.range(-1.0, 1.0)));
                let colour = std::array::from_fn(|c| own[c] + noise[c] + colour(point, view, direction, c));
                seen.push(Seen { point, view: view as u32, colour, direction });
            }
        }
        seen
    }

    /// The logarithm of a gain, which has nothing to do with the order of the photographs.
    fn gain(view: usize, channel: usize) -> f64 {
        0.1 * ((view * view * 7 + 3 * channel * view) as f64).sin()
    }

    #[test]
    fn gains_are_found_again_within_their_errors() {
        let found = fitted(&flight(|_, view, _, c| gain(view, c)), VIEWS).expect("points");
        assert!(found.share > 0.6 && found.share_error < 0.02 && found.spread > 0.05, "{found:?}");
        assert_eq!(found.points, POINTS as usize);
        for c in 0..3 {
            let mean = (0..VIEWS).map(|v| gain(v, c)).sum::<f64>() / VIEWS as f64;
            for (v, gains) in found.gains.iter().enumerate() {
                let found = gains.expect("seen")[c];
                let off = found.log - gain(v, c) + mean;
                assert!(off.abs() < 0.02 && found.error < 0.006, "photograph {v}: {found:?}, off by {off}");
            }
        }
    }

    #[test]
    fn noise_is_no_gain_of_photographs() {
        let found = fitted(&flight(|_, _, _, _| 0.0), VIEWS).expect("points");
        assert!(found.share.abs() < 0.03 && found.spread < 0.01, "{found:?}");
        assert_eq!(fitted(&[], VIEWS), None);
    }

    /// Colours that change with the direction alike everywhere, and surfaces that shine each in its own direction.
    #[test]
    fn what_the_viewing_direction_explains_is_no_gain() {
        let hazy = |_, _, d: [f64; 3], _| 0.4 * d[0] - 0.3 * d[1] * d[2];
        let found = fitted(&flight(hazy), VIEWS).expect("points");
        assert!(found.share < 0.1, "{found:?}");
        let shiny = |point: u32, _, d: [f64; 3], _| {
            let turn = f64::from(point * 37 % 101) / 16.0;
            0.5 * (0.6 * turn.cos() * d[0] + 0.6 * turn.sin() * d[1] + 0.5 * d[2]).max(0.0).powi(8)
        };
        let found = fitted(&flight(shiny), VIEWS).expect("points");
        assert!(found.share < 0.1, "{found:?}");
        // Gains are found beside.
        let both = |point, view, d, c| hazy(point, view, d, c) + gain(view, c);
        let found = fitted(&flight(both), VIEWS).expect("points");
        assert!(found.share > 0.5, "{found:?}");
    }

    #[test]
    fn a_median_lies_in_the_middle() {
        assert_eq!(median(vec![3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(vec![4.0, 1.0, 2.0, 30.0]), 3.0);
        assert_eq!(median(Vec::new()), 0.0);
    }
}
