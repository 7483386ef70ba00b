//! Quality over a set of held-out views.

use super::metrics::ImageScore;
use crate::numbers::mean;

/// Means over held-out views, and each view.
#[derive(Clone, Debug, PartialEq)]
pub struct Quality {
    /// Mean PSNR in decibels; NaN without views.
    pub psnr: f64,
    /// Mean SSIM; NaN without views.
    pub ssim: f64,
    /// Each view.
    pub images: Vec<ImageScore>,
}

impl Quality {
    /// The means over `images`.
    pub fn of(images: Vec<ImageScore>) -> Self {
        let psnr = mean(images.iter().map(|i| i.psnr)).unwrap_or(f64::NAN);
        let ssim = mean(images.iter().map(|i| i.ssim)).unwrap_or(f64::NAN);
        Self { psnr, ssim, images }
    }
}
