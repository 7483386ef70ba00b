//! Median and quartiles.

/// Quartiles and mean of a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Quartiles {
    /// First quartile.
    pub q1: f64,
    /// Median.
    pub median: f64,
    /// Third quartile.
    pub q3: f64,
    /// Arithmetic mean: the figure that matters where steps differ by design.
    pub mean: f64,
}

impl Quartiles {
    /// Quartiles of a sample in any order, linear between its values (Hyndman and Fan's type 7); zeros for an empty
    /// sample.
    pub fn of(sample: impl IntoIterator<Item = f64>) -> Self {
        let mut sorted: Vec<f64> = sample.into_iter().collect();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let place = share * sorted.len().saturating_sub(1) as f64;
            let (low, high) = (place.floor() as usize, place.ceil() as usize);
            match (sorted.get(low), sorted.get(high)) {
                (Some(a), Some(b)) => a + (b - a) * (place - place.floor()),
                _ => 0.0,
            }
        };
        let mean = sorted.iter().sum::<f64>() / sorted.len().max(1) as f64;
        Self { q1: at(0.25), median: at(0.5), q3: at(0.75), mean }
    }
}

#[cfg(test)]
mod tests {
    use super::Quartiles;

    #[test]
    fn between_values_is_linear() {
        assert_eq!(Quartiles::of([4.0, 1.0, 3.0, 2.0]), Quartiles { q1: 1.75, median: 2.5, q3: 3.25, mean: 2.5 });
        assert_eq!(Quartiles::of([5.0, 1.0, 3.0]), Quartiles { q1: 2.0, median: 3.0, q3: 4.0, mean: 3.0 });
        assert_eq!(Quartiles::of([7.0]), Quartiles { q1: 7.0, median: 7.0, q3: 7.0, mean: 7.0 });
        assert_eq!(Quartiles::of([]), Quartiles::default());
    }
}
