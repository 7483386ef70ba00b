//! How a photograph's colours differ from the model's.

/// An affine map of colours, row by row: what a photograph shows of (r, g, b, 1) of the model, colours from 0 to 1.
pub type ExposureMatrix = [[f64; 4]; 3];
