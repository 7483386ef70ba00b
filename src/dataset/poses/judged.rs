//! Photographs that the colours of points are held against.

use std::sync::Arc;

use super::Coarse;
use crate::scene::Camera;

/// ... and the correlation of half of them has to be this: below, the colours of points say nothing.
pub(super) const TELLING: f64 = 0.5;

/// A photograph that the colours of the points are held against.
pub(super) struct Judged {
    /// Its position among those of its role.
    pub(super) at: usize,
    pub(super) camera: Camera,
    pub(super) coarse: Arc<Coarse>,
    /// How well they fit from its own pose.
    pub(super) own: f64,
}
