//! Saliency maps.

use super::{Plane, Settings, SoftMask, mask};

/// Saliency of each pixel, in units of the image's mean, and its derivative with respect to sigma.
#[derive(Clone, Debug)]
pub struct Map {
    size: (u32, u32),
    values: Vec<f64>,
    slopes: Vec<f64>,
    settings: Settings,
}

impl Map {
    /// From blurred energies and their derivatives with respect to sigma. A map of zeros stays zero.
    pub(super) fn new(size: (u32, u32), mut values: Vec<f64>, mut slopes: Vec<f64>, settings: &Settings) -> Self {
        let n = values.len() as f64;
        let (mean, change) = (values.iter().sum::<f64>() / n, slopes.iter().sum::<f64>() / n);
        if mean > 0.0 {
            for (value, slope) in values.iter_mut().zip(&mut slopes) {
                *value /= mean;
                *slope = (*slope - *value * change) / mean;
            }
        }
        Self { size, values, slopes, settings: settings.clone() }
    }

    /// The values, row by row from the top: not negative, with a mean of 1, or all 0.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Derivatives of the values with respect to sigma.
    pub fn slopes(&self) -> &[f64] {
        &self.slopes
    }

    /// Width and height.
    pub fn size(&self) -> (u32, u32) {
        self.size
    }

    /// The soft mask. `level` shifts the mask's level, in units of the map's natural logarithm, from the level at which
    /// the mask's mean is [`Settings::share`].
    pub fn mask(&self, level: f64) -> SoftMask {
        mask::of(self.size, &self.values, &self.slopes, level, &self.settings)
    }

    /// The map as an image.
    pub fn plane(&self) -> Plane {
        Plane::of(self.size.0, self.size.1, self.values.iter().copied())
    }
}
