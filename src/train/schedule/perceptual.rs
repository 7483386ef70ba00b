//! What a step with the perceptual distance looks at.

/// Most views beside a step's own.
pub const MOST_BESIDE: usize = 7;

/// The perceptual distance in a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PerceptualStep {
    /// What the weight of each window is multiplied by.
    pub times: f64,
    beside: [Beside; MOST_BESIDE],
    count: usize,
}

/// A view beside the step's own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Beside {
    /// The view.
    pub view: usize,
    /// How often it has been looked at by its last step.
    pub seen: u32,
}

impl PerceptualStep {
    /// One that carries the weight of `times` steps and looks at `view`; `before` are the views of the steps before it, the last first,
    /// of which the first `most` are looked at too. A view is looked at once.
    pub(super) fn new(times: f64, view: usize, before: impl Iterator<Item = Beside>, most: usize) -> Self {
        let mut found: Vec<Beside> = Vec::new();
        for other in before.take(most.min(MOST_BESIDE)) {
            if other.view != view && found.iter().all(|known| known.view != other.view) {
                found.push(other);
            }
        }
        // In the order in which they were looked at: where photographs lie in places that are given up by age, none changes its rank.
        found.reverse();
        let mut beside = [Beside::default(); MOST_BESIDE];
        beside.iter_mut().zip(&found).for_each(|(to, from)| *to = *from);
        Self { times: times / (1 + found.len()) as f64, beside, count: found.len() }
    }

    /// The views beside the step's own, in the order of the steps that looked at them.
    pub fn beside(&self) -> &[Beside] {
        self.beside.get(..self.count).unwrap_or_default()
    }
}
