//! Means of values that may be missing.

/// The mean, or nothing when there are no values or it is not finite.
pub fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0u32), |(s, n), v| (s + v, n + 1));
    Some(sum / f64::from(count)).filter(|m| m.is_finite())
}

/// The mean, or nothing where a value is missing.
pub fn mean_if_all(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    mean(values.collect::<Option<Vec<_>>>()?.into_iter())
}
