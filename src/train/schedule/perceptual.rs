//! The views that a step with the perceptual distance looks at.

/// Most views beside a step's own.
pub const MOST_BESIDE: usize = 7;

/// The perceptual distance in a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PerceptualStep {
    /// Factor of the weight of each window.
    pub times: f64,
    beside: [Beside; MOST_BESIDE],
    count: usize,
}

/// A view beside the step's own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Beside {
    /// Index of the view.
    pub view: usize,
    /// How often the view has been looked at, up to its last step.
    pub seen: u32,
}

impl PerceptualStep {
    /// A step that carries the weight of `times` steps and looks at `view`, and at the first `most` of `before`: the
    /// views of earlier steps, the latest first. No view is looked at twice.
    pub(super) fn new(times: f64, view: usize, before: impl Iterator<Item = Beside>, most: usize) -> Self {
        let mut found: Vec<Beside> = Vec::new();
        for other in before.take(most.min(MOST_BESIDE)) {
            if other.view != view && found.iter().all(|known| known.view != other.view) {
                found.push(other);
            }
        }
        // In the order in which the steps looked at them, so that the ages of uploaded photographs keep their order.
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
