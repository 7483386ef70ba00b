//! How many splats blending looks at.

use serde::Serialize;

/// Mean numbers of splats per pixel.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PerPixel {
    /// Looked at by the forward.
    pub forward_evaluated: f64,
    /// Blended by the forward.
    pub forward_blended: f64,
    /// Looked at by the backward.
    pub backward_evaluated: f64,
    /// Given a gradient by the backward.
    pub backward_blended: f64,
}
