//! Passes composed into a differentiable renderer.

pub mod scan;
pub mod sort;
pub mod tiles;
