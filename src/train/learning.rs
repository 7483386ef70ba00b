//! What a training learns: splats, exposures of photographs, and widths of the saliency filter.

pub(super) mod exposures;
pub(super) mod optimiser;
pub(super) mod sigma;
