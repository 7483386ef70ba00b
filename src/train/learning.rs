//! What a training learns, and by what: the splats, the photographs' exposures and the widths of the saliency filter.

pub(super) mod exposures;
pub(super) mod optimiser;
pub(super) mod sigma;
