//! Photographs decoded before their steps.

use super::Trainer;
use crate::eval::{PhotographWait, Streaming};
use crate::train::pacing::Pacing;
use crate::train::photographs::FeedCounts;
use crate::train::schedule::{Kind, Schedule};

/// The views of the first steps after `step`, as many as are decoded ahead.
pub(super) fn first_views(schedule: &Schedule, step: u32, pacing: Pacing) -> Vec<usize> {
    let last = step.saturating_add(pacing.decoded_ahead.max(1) as u32).min(schedule.iterations);
    (step + 1..=last).map(|t| schedule.view_at(t)).collect()
}

impl Trainer {
    /// Begins decoding the photographs of the next steps.
    pub(super) fn look_ahead(&self) {
        let (ahead, step) = (self.engine.ahead() as u32, self.next.step);
        if ahead > 0 && self.next.kind == Kind::Step {
            let steps = step..step.saturating_add(ahead).min(self.schedule.iterations + 1);
            self.engine.look_ahead(&steps.map(|t| self.schedule.view_at(t)).collect::<Vec<_>>());
        }
    }

    /// Begins decoding the first held-out photographs while the last steps before a scoring are in flight.
    pub(super) fn look_ahead_to_scoring(&self) {
        self.truth.look_ahead(&(0..self.held_out.len().min(self.truth.ahead())).collect::<Vec<_>>());
    }

    /// How photographs came to their steps; `None` when all are on the device.
    pub fn feed_counts(&self) -> Option<FeedCounts> {
        self.engine.feed_counts()
    }

    /// The steps that had to wait for their photographs, in their order.
    pub fn photograph_waits(&self) -> Vec<PhotographWait> {
        self.engine.photograph_waits()
    }

    /// Counts and waits of streamed photographs, for the metrics of a run.
    pub fn streaming(&self) -> Option<Streaming> {
        let FeedCounts { asked, reused, decoded, .. } = self.feed_counts()?;
        Some(Streaming { asked, reused, decoded, waits: self.photograph_waits() })
    }
}
