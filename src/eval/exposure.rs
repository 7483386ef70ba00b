//! How photographs are exposed that nothing was learned from.

use std::collections::BTreeMap;
use std::ops::Bound::{Excluded, Unbounded};

use glam::DVec3;

use crate::scene::ExposureMatrix;

const IDENTITY: ExposureMatrix = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
/// Means of the products of (r, g, b, 1) where colours are spread evenly from 0 to 1.
const PRODUCTS: [[f64; 4]; 4] =
    [[1.0 / 3.0, 0.25, 0.25, 0.5], [0.25, 1.0 / 3.0, 0.25, 0.5], [0.25, 0.25, 1.0 / 3.0, 0.5], [0.5, 0.5, 0.5, 1.0]];
/// Exposures whose colours differ by less than this, root mean square, do not differ.
const NO_DIFFERENCE: f64 = 1e-6;
/// Photographs that stand nearest, of which a mean is taken that goes by nearness.
const NEAREST: usize = 3;

/// The weights with which an exposure follows other exposures: from 0 to 1 each, and at most 1 in all.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Follows {
    /// The weight of the photographs before and after in the order of names: light and cameras drift.
    pub order: f64,
    /// The weight of the three photographs taken nearest to the place.
    pub place: f64,
}

/// The learned exposure of a photograph.
#[derive(Clone, Debug, PartialEq)]
struct Learned {
    matrix: ExposureMatrix,
    centre: DVec3,
}

/// The exposures of a training, by which those of other photographs are expected: as those before and after them, and
/// as those taken nearby. No pixel of the other photographs is looked at.
///
/// A photograph differs from the model, which is the mean of all, by a deviation from the identity. What is expected of
/// it is a sum of the mean deviation of its two neighbours by name and of that of its three neighbours in space;
/// [`Follows`] says how much of each, which are the numbers that are best, in least squares of the colours, for the
/// photographs of the training, each left out in its turn. Where exposures are drawn anew for every photograph both are
/// near zero, and so the model's own colours are expected.
#[derive(Clone, Debug, PartialEq)]
pub struct Exposures {
    learned: BTreeMap<String, Learned>,
    follows: Follows,
}

impl Exposures {
    /// From names, what was learned of them, and where they were taken from.
    pub fn new(learned: impl IntoIterator<Item = (String, ExposureMatrix, [f64; 3])>) -> Self {
        let kept = |(name, matrix, centre): (String, ExposureMatrix, [f64; 3])| {
            (name, Learned { matrix, centre: DVec3::from_array(centre) })
        };
        let mut out = Self { learned: learned.into_iter().map(kept).collect(), follows: Follows::default() };
        out.follows = out.fitted();
        out
    }

    /// How far exposures follow others.
    pub fn follows(&self) -> Follows {
        self.follows
    }

    /// The exposure of a photograph with a name and a camera centre: its own where it was learned,
    /// else what is expected.
    pub fn of(&self, name: &str, centre: [f64; 3]) -> ExposureMatrix {
        if let Some(own) = self.learned.get(name) {
            return own.matrix;
        }
        let order = self.by_order(name).unwrap_or_default();
        let place = self.by_place(name, DVec3::from_array(centre)).unwrap_or_default();
        let Follows { order: a, place: b } = self.follows;
        std::array::from_fn(|row| std::array::from_fn(|k| IDENTITY[row][k] + a * order[row][k] + b * place[row][k]))
    }

    /// The numbers, neither negative nor more than 1 in all, with the least squares.
    fn fitted(&self) -> Follows {
        let (mut aa, mut ab, mut bb, mut a, mut b) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (name, own) in &self.learned {
            let (Some(order), Some(place)) = (self.by_order(name), self.by_place(name, own.centre)) else { continue };
            let own = deviation(&own.matrix);
            aa += product(&order, &order);
            ab += product(&order, &place);
            bb += product(&place, &place);
            a += product(&own, &order);
            b += product(&own, &place);
        }
        if aa.max(bb) <= NO_DIFFERENCE * NO_DIFFERENCE * self.learned.len() as f64 {
            return Follows::default();
        }
        let ratio = |x: f64, y: f64| if y > 0.0 { x / y } else { 0.0 };
        let determinant = aa * bb - ab * ab;
        let free = [ratio(a * bb - b * ab, determinant), ratio(b * aa - a * ab, determinant)];
        let whole = ratio(a - b + bb - ab, aa + bb - 2.0 * ab).clamp(0.0, 1.0);
        let candidates = [
            [0.0, 0.0],
            [ratio(a, aa).clamp(0.0, 1.0), 0.0],
            [0.0, ratio(b, bb).clamp(0.0, 1.0)],
            [whole, 1.0 - whole],
            free,
        ];
        // Less what is the same for all.
        let squares = |[x, y]: &[f64; 2]| x * x * aa + y * y * bb + 2.0 * (x * y * ab - x * a - y * b);
        let allowed = |[x, y]: &[f64; 2]| *x >= 0.0 && *y >= 0.0 && x + y <= 1.0;
        let best = candidates.into_iter().filter(allowed).min_by(|x, y| squares(x).total_cmp(&squares(y)));
        best.map_or_else(Follows::default, |[order, place]| Follows { order, place })
    }

    /// The mean deviation of the photographs before and after this name, without its own.
    fn by_order(&self, name: &str) -> Option<ExposureMatrix> {
        let before = self.learned.range::<str, _>((Unbounded, Excluded(name))).next_back();
        let after = self.learned.range::<str, _>((Excluded(name), Unbounded)).next();
        mean(before.into_iter().chain(after).map(|(_, other)| (1.0, &other.matrix)))
    }

    /// The mean deviation of the photographs taken nearest, without that of this name, by the inverse of the distance.
    fn by_place(&self, name: &str, centre: DVec3) -> Option<ExposureMatrix> {
        let others = self.learned.iter().filter(|(other, _)| *other != name);
        let mut near: Vec<(f64, &Learned)> = others.map(|(_, other)| (centre.distance(other.centre), other)).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.truncate(NEAREST);
        // Photographs taken from the same place share all of it.
        let least = near.last().map_or(0.0, |farthest| 1e-9 * farthest.0).max(f64::MIN_POSITIVE);
        mean(near.iter().map(|(distance, other)| (least / distance.max(least), &other.matrix)))
    }
}

fn deviation(of: &ExposureMatrix) -> ExposureMatrix {
    std::array::from_fn(|row| std::array::from_fn(|k| of[row][k] - IDENTITY[row][k]))
}

/// The weighted mean deviation; `None` of nothing.
fn mean<'a>(of: impl Iterator<Item = (f64, &'a ExposureMatrix)>) -> Option<ExposureMatrix> {
    let (mut sum, mut weights) = (ExposureMatrix::default(), 0.0);
    for (weight, matrix) in of {
        for (sum, value) in sum.iter_mut().flatten().zip(deviation(matrix).iter().flatten()) {
            *sum += weight * value;
        }
        weights += weight;
    }
    (weights > 0.0).then(|| sum.map(|row| row.map(|value| value / weights)))
}

/// The mean product of the changes that two deviations make to colours.
fn product(a: &ExposureMatrix, b: &ExposureMatrix) -> f64 {
    let of = |row: usize, j: usize, k: usize| a[row][j] * PRODUCTS[j][k] * b[row][k];
    (0..3).flat_map(|row| (0..16).map(move |jk| of(row, jk / 4, jk % 4))).sum::<f64>() / 3.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gain(by: f64) -> ExposureMatrix {
        std::array::from_fn(|row| std::array::from_fn(|k| if row == k { by } else { 0.0 }))
    }

    /// Evenly spread from 0 to 1, by number.
    fn drawn(i: usize) -> f64 {
        let mixed = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        ((mixed ^ (mixed >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f64 / f64::from(1 << 24)
    }

    /// Somewhere, without order.
    fn place(i: usize) -> [f64; 3] {
        [drawn(3 * i), drawn(3 * i + 1), 0.0]
    }

    fn name(i: usize) -> String {
        format!("{i:03}.jpg")
    }

    fn learned(gains: impl IntoIterator<Item = (usize, f64)>) -> Exposures {
        Exposures::new(gains.into_iter().map(|(i, by)| (name(i), gain(by), place(i))))
    }

    #[test]
    fn a_drift_is_followed_to_photographs_between_and_at_the_ends() {
        let drift = |i: usize| 1.0 + 0.1 * (i as f64 * 0.05).sin();
        let exposures = learned((1..100).filter(|i| i % 8 != 0).map(|i| (i, drift(i))));
        let Follows { order, place: by_place } = exposures.follows();
        assert!(order > 0.95 && by_place < 0.05, "{order}, {by_place}");
        for held in (8..97).step_by(8) {
            let expected = exposures.of(&name(held), place(held));
            assert!((expected[1][1] - drift(held)).abs() < 0.01, "{held}: {expected:?}");
            assert_eq!([expected[1][0], expected[1][3]], [0.0, 0.0]);
        }
        // Before the first and after the last there is one neighbour.
        for (name, nearest) in [("000.jpg", 1), ("zzz.jpg", 99)] {
            assert!((exposures.of(name, place(0))[0][0] - drift(nearest)).abs() < 0.01, "{name}");
        }
    }

    #[test]
    fn exposures_that_go_by_place_are_followed_whatever_the_names() {
        let here = |[x, y, _]: [f64; 3]| 1.0 + 0.1 * (2.0 * x - y);
        let exposures = learned((0..300).map(|i| (i, here(place(i)))));
        let Follows { order, place: by_place } = exposures.follows();
        assert!(by_place > 0.95 && order < 0.05, "{order}, {by_place}");
        for at in [[0.3, 0.3, 0.0], [0.8, 0.2, 0.0]] {
            assert!((exposures.of("new.jpg", at)[2][2] - here(at)).abs() < 0.02, "{at:?}");
        }
        // Where one was taken, it is what it was.
        let same = exposures.of("new.jpg", place(17))[0][0];
        assert!((same - (1.0 + by_place * (here(place(17)) - 1.0))).abs() < 0.01, "{same}");
    }

    #[test]
    fn exposures_without_order_are_not_followed() {
        let exposures = learned((0..400).map(|i| (i, 0.9 + 0.2 * drawn(7 * i + 5000))));
        let Follows { order, place } = exposures.follows();
        assert!(order + place < 0.25, "{order}, {place}");
        // Every second one darker: what follows is the opposite of its neighbours, and nothing is better than that.
        let flicker = learned((0..50).map(|i| (i, if i % 2 == 0 { 0.9 } else { 1.1 })));
        assert_eq!(flicker.follows().order, 0.0);
    }

    #[test]
    fn no_other_numbers_have_less_squares() {
        for salt in 0..20 {
            let exposures = learned((0..30).map(|i| {
                let drift = 0.1 * (i as f64 * 0.3).sin() * drawn(salt);
                (i, 1.0 + drift + 0.1 * place(i)[0] * drawn(salt + 50) + 0.1 * drawn(100 * salt + i))
            }));
            let squares = |[a, b]: [f64; 2]| -> f64 {
                let off = |(name, own): (&String, &Learned)| {
                    let order = exposures.by_order(name).unwrap();
                    let place = exposures.by_place(name, own.centre).unwrap();
                    let own = deviation(&own.matrix);
                    let left: ExposureMatrix = std::array::from_fn(|row| {
                        std::array::from_fn(|k| own[row][k] - a * order[row][k] - b * place[row][k])
                    });
                    product(&left, &left)
                };
                exposures.learned.iter().map(off).sum()
            };
            let Follows { order, place } = exposures.follows();
            let found = squares([order, place]);
            for (x, y) in (0..=20).flat_map(|x| (0..=20 - x).map(move |y| (x, y))) {
                let other = [f64::from(x) / 20.0, f64::from(y) / 20.0];
                assert!(found <= squares(other) * (1.0 + 1e-9), "{order}, {place} is worse than {other:?}");
            }
        }
    }

    #[test]
    fn what_was_learned_is_given_as_it_is() {
        let exposures = learned([(1, 0.9), (2, 1.1), (3, 1.0)]);
        assert_eq!(exposures.of("002.jpg", [0.0; 3]), gain(1.1));
    }

    #[test]
    fn few_or_equal_exposures_expect_the_colours_of_the_model() {
        for none in [learned([]), learned([(1, 0.8)]), learned((0..9).map(|i| (i, 1.0)))] {
            assert_eq!((none.follows(), none.of("x.jpg", [0.0; 3])), (Follows::default(), IDENTITY));
        }
        // All from one place.
        let one = Exposures::new((0..9).map(|i| (name(i), gain(1.0 + 0.01 * i as f64), [1.0; 3])));
        assert!(one.of("004.jpg", [1.0; 3]).iter().flatten().all(|v| v.is_finite()));
        assert!(one.of("0045.jpg", [1.0; 3]).iter().flatten().all(|v| v.is_finite()));
    }

    #[test]
    fn the_measure_of_changes_is_that_of_evenly_spread_colours() {
        // The mean square of what a map changes, over a grid of colours.
        let d: ExposureMatrix = [[0.1, -0.05, 0.02, 0.03], [0.0, 0.2, 0.0, -0.1], [0.01, 0.02, -0.3, 0.0]];
        let n = 40;
        let level = |i: usize| (i as f64 + 0.5) / n as f64;
        let mut sum = 0.0;
        for (r, g, b) in (0..n * n * n).map(|i| (level(i % n), level(i / n % n), level(i / n / n))) {
            sum += d.iter().map(|row| (row[0] * r + row[1] * g + row[2] * b + row[3]).powi(2)).sum::<f64>() / 3.0;
        }
        assert!((product(&d, &d) / (sum / (n * n * n) as f64) - 1.0).abs() < 1e-3);
    }
}
