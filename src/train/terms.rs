//! Terms of the loss beside that of colours, where they need more than the passes: each adds its gradient to what the colours' left.

mod constrained;
mod geometry;
mod perceptual;

pub(super) use constrained::Constrained;
pub(super) use geometry::Geometry;
pub(super) use perceptual::Perceptual;
