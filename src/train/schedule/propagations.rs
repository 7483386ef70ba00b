//! The steps before which depths are propagated.

use crate::train::settings::{DepthPrior, Geometry};

/// The steps, ascending: multiples of an interval, at most one for each photograph.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Propagations {
    steps: Vec<u32>,
    from: u32,
    until: u32,
    /// Depth ratio from which on splats are added, at the first step and at the last.
    ratio: [f64; 2],
}

impl Propagations {
    /// With step numbers of the settings scaled by `scaled`; `view_at` is the view of a step.
    pub(super) fn new(settings: &Geometry, scaled: impl Fn(u32) -> u32, view_at: impl Fn(u32) -> usize) -> Self {
        if settings.depth_prior != DepthPrior::Propagation {
            return Self::default();
        }
        let (from, until) = (scaled(settings.propagate_from), scaled(settings.propagate_until));
        let every = scaled(settings.propagate_every).max(1);
        let mut seen = Vec::new();
        let mut due = |t: &u32| {
            let view = view_at(*t);
            let first = !seen.contains(&view);
            seen.push(view);
            first
        };
        let steps = (from + 1..until).filter(|t| t.is_multiple_of(every)).filter(|t| due(t)).collect();
        Self { steps, from, until, ratio: [settings.propagate_ratio, settings.propagate_ratio_final] }
    }

    /// The ratio of a step, linear between the two ends; `None` if no depths are propagated before the step.
    pub(super) fn at(&self, t: u32) -> Option<f64> {
        self.steps.binary_search(&t).ok()?;
        let u = f64::from(t - self.from) / f64::from((self.until - self.from).max(1));
        Some(self.ratio[0] + (self.ratio[1] - self.ratio[0]) * u)
    }
}
