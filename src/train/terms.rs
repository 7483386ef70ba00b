//! The terms of the loss: that of colours, and those that need more than the passes and add their gradients to what the colours' left.

mod colours;
mod constrained;
mod geometry;
mod perceptual;

pub(super) use colours::{Losses, Weights};
pub(super) use constrained::Constrained;
pub(super) use geometry::Geometry;
pub(super) use perceptual::Perceptual;
