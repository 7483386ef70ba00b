//! How photographs are exposed that nothing was learned from.

use std::collections::BTreeMap;
use std::ops::Bound::{Excluded, Unbounded};

/// An affine map of colours, row by row: what a photograph shows of (r, g, b, 1) of the model, colours from 0 to 1.
pub type ExposureMatrix = [[f64; 4]; 3];

const IDENTITY: ExposureMatrix = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
/// Means of the products of (r, g, b, 1) where colours are spread evenly from 0 to 1.
const PRODUCTS: [[f64; 4]; 4] =
    [[1.0 / 3.0, 0.25, 0.25, 0.5], [0.25, 1.0 / 3.0, 0.25, 0.5], [0.25, 0.25, 1.0 / 3.0, 0.5], [0.5, 0.5, 0.5, 1.0]];
/// Exposures whose colours differ by less than this, root mean square, do not differ.
const NO_DIFFERENCE: f64 = 1e-6;

/// The exposures of a training, by which those of other photographs are expected: a camera's exposure drifts with the light, so that a
/// photograph is exposed as those before and after it, in the order of their names, as far as the photographs of the training
/// themselves are. No pixel of the other photographs is looked at.
///
/// A photograph differs from the model, which is the mean of all, by a deviation from the identity. What is expected of it is
/// [`follows`](Self::follows) times the mean of its two neighbours' deviations; that number is the one which is best, in least squares
/// of the colours, for the photographs of the training, each left out in its turn. Where exposures are drawn anew for each photograph
/// it is near zero, and so the model's own colours are expected.
#[derive(Clone, Debug, PartialEq)]
pub struct Exposures {
    known: BTreeMap<String, ExposureMatrix>,
    follows: f64,
}

impl Exposures {
    /// From what was learned, by name.
    pub fn new(known: BTreeMap<String, ExposureMatrix>) -> Self {
        let (mut along, mut squares) = (0.0, 0.0);
        for (name, own) in &known {
            let Some(expected) = neighbours(&known, name) else { continue };
            along += product(&deviation(own), &expected);
            squares += product(&expected, &expected);
        }
        let differ = squares > NO_DIFFERENCE * NO_DIFFERENCE * known.len() as f64;
        let follows = if differ { (along / squares).clamp(0.0, 1.0) } else { 0.0 };
        Self { known, follows }
    }

    /// How far a photograph's exposure follows those before and after it, from 0 to 1.
    pub fn follows(&self) -> f64 {
        self.follows
    }

    /// Whether the photograph's exposure was learned.
    pub fn knows(&self, name: &str) -> bool {
        self.known.contains_key(name)
    }

    /// The exposure of a photograph: its own where it was learned, else what is expected.
    pub fn of(&self, name: &str) -> ExposureMatrix {
        if let Some(own) = self.known.get(name) {
            return *own;
        }
        let expected = neighbours(&self.known, name).unwrap_or_default();
        std::array::from_fn(|row| std::array::from_fn(|k| IDENTITY[row][k] + self.follows * expected[row][k]))
    }
}

fn deviation(of: &ExposureMatrix) -> ExposureMatrix {
    std::array::from_fn(|row| std::array::from_fn(|k| of[row][k] - IDENTITY[row][k]))
}

/// The mean deviation of the photographs before and after this name, without its own; `None` where there is neither.
fn neighbours(known: &BTreeMap<String, ExposureMatrix>, name: &str) -> Option<ExposureMatrix> {
    let before = known.range::<str, _>((Unbounded, Excluded(name))).next_back();
    let after = known.range::<str, _>((Excluded(name), Unbounded)).next();
    let both: Vec<ExposureMatrix> = before.into_iter().chain(after).map(|(_, own)| deviation(own)).collect();
    let share = 1.0 / both.len() as f64;
    let mean = |row: usize, k: usize| both.iter().map(|d| d[row][k]).sum::<f64>() * share;
    (!both.is_empty()).then(|| std::array::from_fn(|row| std::array::from_fn(|k| mean(row, k))))
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

    fn learned(gains: impl IntoIterator<Item = (usize, f64)>) -> Exposures {
        Exposures::new(gains.into_iter().map(|(i, by)| (format!("{i:03}.jpg"), gain(by))).collect())
    }

    #[test]
    fn a_drift_is_followed_to_photographs_between_and_at_the_ends() {
        let drift = |i: usize| 1.0 + 0.1 * (i as f64 * 0.05).sin();
        let exposures = learned((1..100).filter(|i| i % 8 != 0).map(|i| (i, drift(i))));
        assert!(exposures.follows() > 0.98, "{}", exposures.follows());
        for held in (8..97).step_by(8) {
            let expected = exposures.of(&format!("{held:03}.jpg"));
            assert!((expected[1][1] - drift(held)).abs() < 0.003, "{held}: {expected:?}");
            assert_eq!([expected[1][0], expected[1][3]], [0.0, 0.0]);
        }
        // Before the first and after the last there is one neighbour.
        assert!((exposures.of("000.jpg")[0][0] - drift(1)).abs() < 0.001);
        assert!((exposures.of("zzz.jpg")[0][0] - drift(99)).abs() < 0.003);
    }

    #[test]
    fn exposures_without_order_are_not_followed() {
        let mut state = 7_u64;
        let mut drawn = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            1.0 + 0.2 * ((state >> 40) as f64 / f64::from(1 << 24) - 0.5)
        };
        let exposures = learned((0..400).map(|i| (i, drawn())));
        assert!(exposures.follows() < 0.15, "{}", exposures.follows());
        // Every second one darker: what follows is the opposite of its neighbours, and nothing is better than that.
        let flicker = learned((0..50).map(|i| (i, if i % 2 == 0 { 0.9 } else { 1.1 })));
        assert_eq!(flicker.follows(), 0.0);
        assert_eq!(flicker.of("0075.jpg"), IDENTITY);
    }

    #[test]
    fn what_was_learned_is_given_as_it_is() {
        let exposures = learned([(1, 0.9), (2, 1.1), (3, 1.0)]);
        assert!(exposures.knows("002.jpg") && !exposures.knows("004.jpg"));
        assert_eq!(exposures.of("002.jpg"), gain(1.1));
    }

    #[test]
    fn few_photographs_and_equal_ones_expect_the_model_s_own_colours() {
        for none in [learned([]), learned([(1, 0.8)]), learned((0..9).map(|i| (i, 1.0)))] {
            assert_eq!((none.follows(), none.of("x.jpg")), (0.0, IDENTITY));
        }
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
