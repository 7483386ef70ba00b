//! Images of one value per pixel.

use super::{Error, resample};
use crate::dataset::Pixels;

/// One finite value per pixel, row by row from the top; at least one pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    width: u32,
    height: u32,
    values: Vec<f32>,
}

impl Plane {
    /// An image of `values`. Fails for a side of 0, a wrong number of values, or a value that is not finite.
    pub fn new(width: u32, height: u32, values: Vec<f32>) -> Result<Self, Error> {
        if width == 0 || height == 0 {
            return Err(Error::Empty { width, height });
        }
        Error::check("the image", values.len(), width as usize * height as usize)?;
        match values.iter().position(|v| !v.is_finite()) {
            Some(index) => Err(Error::NotFinite { index, value: values[index] }),
            None => Ok(Self { width, height, values }),
        }
    }

    /// An image of values that are known to be valid.
    pub(super) fn of(width: u32, height: u32, values: impl Iterator<Item = f64>) -> Self {
        Self { width, height, values: values.map(|v| v as f32).collect() }
    }

    /// Luma from 0 to 1 by the weights of BT.709, of the encoded values. Masked pixels (alpha 0) get the mean of the
    /// others, so that they add no detail.
    pub fn luma(width: u32, height: u32, pixels: &Pixels) -> Result<Self, Error> {
        Error::check("the photograph", pixels.len(), width as usize * height as usize)?;
        let luma = |[r, g, b, a]: [f64; 4]| (a > 0.0).then_some((0.2126 * r + 0.7152 * g + 0.0722 * b) as f32);
        let values = of_pixels(pixels, luma);
        let there = values.iter().flatten();
        let mean = there.clone().map(|v| f64::from(*v)).sum::<f64>() / there.count().max(1) as f64;
        Self::new(width, height, values.iter().map(|v| v.unwrap_or(mean as f32)).collect())
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The values, row by row from the top.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The image at another size: means where the image shrinks, linear interpolation where it grows. A side of 0
    /// becomes 1.
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let (width, height) = (width.max(1), height.max(1));
        if (width, height) == (self.width, self.height) {
            return self.clone();
        }
        let size = (self.width as usize, self.height as usize);
        let values = resample::resize(&self.values, size, (width as usize, height as usize));
        Self { width, height, values }
    }

    /// The image reduced until its shorter side has at most `side` pixels; never enlarged.
    pub fn reduced(self, side: u32) -> Self {
        let (width, height) = Self::reduced_size(self.width, self.height, side);
        if (width, height) == (self.width, self.height) { self } else { self.resized(width, height) }
    }

    /// The size that [`Self::reduced`] gives an image of this size.
    pub fn reduced_size(width: u32, height: u32, side: u32) -> (u32, u32) {
        let shorter = width.min(height);
        if shorter <= side {
            return (width, height);
        }
        let scaled = |v: u32| ((f64::from(v) * f64::from(side) / f64::from(shorter)).round() as u32).max(1);
        (scaled(width), scaled(height))
    }
}

/// A function of every pixel's red, green, blue and alpha, from 0 to 1.
pub(super) fn of_pixels<T>(pixels: &Pixels, f: impl Fn([f64; 4]) -> T) -> Vec<T> {
    match pixels {
        Pixels::Rgba8(values) => {
            values.chunks_exact(4).map(|p| f([p[0], p[1], p[2], p[3]].map(|v| f64::from(v) / 255.0))).collect()
        }
        Pixels::Rgba16(values) => {
            values.chunks_exact(4).map(|p| f([p[0], p[1], p[2], p[3]].map(|v| f64::from(v) / 65535.0))).collect()
        }
    }
}

/// Splits a photograph I by its texture mask M into `(1 - M) I` and `M I`, red, green and blue from 0 to 1 per pixel.
/// Their sum is the photograph. The mask may have another size.
pub fn split(width: u32, height: u32, pixels: &Pixels, mask: &Plane) -> Result<[Vec<f32>; 2], Error> {
    Error::check("the photograph", pixels.len(), width as usize * height as usize)?;
    let mask = mask.resized(width, height);
    let colours = of_pixels(pixels, |[r, g, b, _]| [r as f32, g as f32, b as f32]);
    let part = |share: &dyn Fn(f32) -> f32| -> Vec<f32> {
        colours.iter().zip(mask.values()).flat_map(|(c, m)| c.map(|v| share(*m) * v)).collect()
    };
    Ok([part(&|m| 1.0 - m), part(&|m| m)])
}
