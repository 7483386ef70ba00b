//! Streamed photographs, and the photographs that a finished model is scored on.

use std::sync::Arc;

use super::Engine;
use crate::dataset::Pixels;
use crate::eval::PhotographWait;
use crate::train::Error;
use crate::train::photographs::FeedCounts;

impl Engine {
    /// How many views [`Self::look_ahead`] can use; 0 when all photographs are on the device or decoded.
    pub fn ahead(&self) -> usize {
        self.views.photographs.ahead()
    }

    /// Names the views of the next steps, so that their photographs are decoded meanwhile.
    pub fn look_ahead(&self, views: &[usize]) {
        self.views.photographs.look_ahead(views);
    }

    /// Frees the photographs that the host keeps. No step may follow.
    pub fn release_photographs(&mut self) {
        self.views.photographs.release();
    }

    /// A photograph of [`crate::eval::TrainingScores::sample`], also after [`Self::release_photographs`]. Waits.
    pub(in crate::train) fn sampled_photograph(&self, view: usize) -> Result<Arc<Pixels>, Error> {
        self.views.photographs.sampled(&self.gpu, view)
    }

    /// Counts of the photographs of the steps so far; `None` when all photographs are on the device.
    pub fn feed_counts(&self) -> Option<FeedCounts> {
        self.views.photographs.counts()
    }

    /// The steps so far that had to wait for their photographs.
    pub fn photograph_waits(&self) -> Vec<PhotographWait> {
        self.views.photographs.waits()
    }
}
