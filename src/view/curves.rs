//! Curves of a training at a bounded number of points.

use std::collections::BTreeMap;

use serde_json::{Value, json};

/// Points of a curve from which on every second one is dropped.
const MOST_POINTS: usize = 1024;

/// Curves by name. Values of neighbouring steps are averaged where there are more than [`MOST_POINTS`].
#[derive(Clone, Debug, Default)]
pub(super) struct Curves(BTreeMap<&'static str, Curve>);

#[derive(Clone, Debug, Default)]
struct Curve {
    points: Vec<(u32, f64)>,
    /// Values that make one point.
    width: u32,
    open: (u32, f64),
}

impl Curves {
    pub(super) fn add(&mut self, name: &'static str, step: u32, value: f64) {
        let curve = self.0.entry(name).or_default();
        curve.open = (curve.open.0 + 1, curve.open.1 + value);
        if curve.open.0 >= curve.width.max(1) {
            curve.points.push((step, curve.open.1 / f64::from(curve.open.0)));
            curve.open = (0, 0.0);
        }
        if curve.points.len() >= MOST_POINTS {
            let halved = curve.points.chunks(2).filter_map(|pair| {
                let mean = pair.iter().map(|p| p.1).sum::<f64>() / pair.len() as f64;
                pair.last().map(|last| (last.0, mean))
            });
            curve.points = halved.collect();
            curve.width = 2 * curve.width.max(1);
        }
    }

    pub(super) fn json(&self) -> Value {
        self.0
            .iter()
            .map(|(name, curve)| ((*name).to_owned(), json!(curve.points)))
            .collect::<serde_json::Map<_, _>>()
            .into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_curves_are_averaged_and_keep_their_ends() {
        let mut curves = Curves::default();
        (1..=30_000).for_each(|step| curves.add("loss", step, f64::from(step)));
        let points = &curves.0["loss"].points;
        assert!(points.len() < MOST_POINTS && points.len() > MOST_POINTS / 4, "{}", points.len());
        assert!(points.last().is_some_and(|p| p.0 > 29_900));
        for pair in points.windows(2) {
            let width = f64::from(pair[1].0 - pair[0].0);
            assert!((pair[1].1 - (f64::from(pair[1].0) - 0.5 * (width - 1.0))).abs() < 1e-6, "{pair:?}");
        }
    }
}
