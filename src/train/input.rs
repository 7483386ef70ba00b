//! What a training is given: views with their photographs, and a first model.

use crate::scene::{Camera, Gaussians};

/// A photograph with its camera in scene coordinates.
#[derive(Clone, Debug)]
pub struct View {
    /// Name of the photograph.
    pub name: String,
    /// Camera, of the size of `rgba`.
    pub camera: Camera,
    /// 8-bit RGBA, row-major. Where alpha is 0 the pixel is masked: it has no part in losses and metrics.
    pub rgba: Vec<u8>,
}

impl View {
    /// Number of masked pixels.
    pub fn masked(&self) -> u32 {
        self.rgba.chunks_exact(4).filter(|p| p[3] == 0).count() as u32
    }
}

/// The input of a training, in scene coordinates.
#[derive(Clone, Debug)]
pub struct Input {
    /// Views to train on.
    pub train: Vec<View>,
    /// Views to evaluate on; training never reads them.
    pub held_out: Vec<View>,
    /// Splats to begin with.
    pub initial: Gaussians,
    /// Extent of the training cameras in scene units (1.1 x the largest distance from their mean).
    pub extent: f32,
}
