//! Maps files with more than 8 bits per channel to encoded 16-bit values.

use std::fmt;

use image::{DynamicImage, ImageBuffer, Rgba};
use rayon::prelude::*;

/// How photographs with more than 8 bits per channel are interpreted. Photographs with 8 bits are used unchanged.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tone {
    /// The value of white in the file's units; larger values are clipped. `None`: 65535 for integers, 1 for
    /// floating-point numbers.
    pub white_level: Option<f64>,
    /// The transfer curve between light and values.
    pub transfer: Transfer,
}

/// The transfer curve between light and a file's values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Transfer {
    /// Integers are encoded, floating-point numbers are linear: the meaning of PNG and OpenEXR.
    #[default]
    Auto,
    /// Values are encoded like those of an 8-bit photograph and stay unchanged.
    Srgb,
    /// Values are proportional to light and get encoded with the sRGB curve.
    Linear,
}

/// The kind of values in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
pub enum Samples {
    /// Integers of 8 bits or fewer.
    Bits8,
    /// Integers of 16 bits.
    Bits16,
    /// Floating-point numbers.
    Float,
}

impl Samples {
    /// Bits per channel in memory.
    pub const fn depth(self) -> super::Depth {
        match self {
            Self::Bits8 => super::Depth::Eight,
            Self::Bits16 | Self::Float => super::Depth::Sixteen,
        }
    }
}

impl Tone {
    fn white(self, samples: Samples) -> f64 {
        self.white_level.unwrap_or(match samples {
            Samples::Bits8 => 255.0,
            Samples::Bits16 => 65535.0,
            Samples::Float => 1.0,
        })
    }

    fn is_linear(self, samples: Samples) -> bool {
        match self.transfer {
            Transfer::Auto => samples == Samples::Float,
            Transfer::Srgb => false,
            Transfer::Linear => true,
        }
    }

    /// Describes how such files are treated.
    pub fn of(self, samples: Samples) -> impl fmt::Display {
        match samples {
            Samples::Bits8 => "8 bits per channel, as they are".to_owned(),
            _ => {
                let kind = if samples == Samples::Bits16 { "16 bits per channel" } else { "floating point" };
                let curve = match self.is_linear(samples) {
                    true => "linear, encoded with the curve of sRGB",
                    false => "taken as encoded with the curve of sRGB",
                };
                format!("{kind}, white at {}, {curve}; kept with 16 bits", self.white(samples))
            }
        }
    }

    /// The picture with 16 bits per channel, and the number of pixels brighter than white.
    pub(super) fn applied(self, image: DynamicImage) -> (DynamicImage, u64) {
        let samples = if is_float(&image) { Samples::Float } else { Samples::Bits16 };
        let (white, linear) = (self.white(samples), self.is_linear(samples));
        if samples == Samples::Float {
            return from_floats(image, white as f32, linear);
        }
        if white == 65535.0 && !linear {
            return (image, 0);
        }
        let table: Vec<u16> = (0..=u16::MAX).map(|v| code(f64::from(v) / white, linear)).collect();
        let over = |v: u16| f64::from(v) > white;
        let mut clipped = 0;
        let mut of = |pixel: &mut [u16], colours: usize| {
            clipped += u64::from(pixel[..colours].iter().any(|v| over(*v)));
            pixel[..colours].iter_mut().for_each(|v| *v = table[usize::from(*v)]);
        };
        let image = if image.color().has_alpha() {
            let mut rgba = image.into_rgba16();
            rgba.pixels_mut().for_each(|p| of(&mut p.0, 3));
            DynamicImage::ImageRgba16(rgba)
        } else {
            let mut rgb = image.into_rgb16();
            rgb.pixels_mut().for_each(|p| of(&mut p.0, 3));
            DynamicImage::ImageRgb16(rgb)
        };
        (image, clipped)
    }
}

pub(super) fn is_float(image: &DynamicImage) -> bool {
    matches!(image, DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_))
}

/// 16-bit code of a value where 1 is white.
fn code(value: f64, linear: bool) -> u16 {
    let value = value.clamp(0.0, 1.0);
    let encoded = if linear { encode(value) } else { value };
    (65535.0 * encoded).round() as u16
}

/// The sRGB curve (IEC 61966-2-1) from light to encoded values, both from 0 to 1.
fn encode(light: f64) -> f64 {
    if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

/// OpenEXR premultiplies colours with alpha. Pixels that are not finite numbers are masked.
fn from_floats(image: DynamicImage, white: f32, linear: bool) -> (DynamicImage, u64) {
    let opaque = !image.color().has_alpha();
    let (width, height) = (image.width(), image.height());
    let floats = image.into_rgba32f().into_raw();
    let mut codes = vec![0_u16; floats.len()];
    let clipped: u64 = codes
        .par_chunks_mut(4 * width.max(1) as usize)
        .zip(floats.par_chunks(4 * width.max(1) as usize))
        .map(|(codes, floats)| {
            let mut clipped = 0;
            for (code_of, p) in codes.chunks_exact_mut(4).zip(floats.chunks_exact(4)) {
                let known = p.iter().all(|v| !v.is_nan());
                let alpha = if known { p[3].clamp(0.0, 1.0) } else { 0.0 };
                let by = if alpha > 0.0 { white * alpha } else { white };
                clipped += u64::from(alpha > 0.0 && p[..3].iter().any(|v| *v > by));
                for c in 0..3 {
                    code_of[c] = if known { code(f64::from(p[c]) / f64::from(by), linear) } else { 0 };
                }
                code_of[3] = (65535.0 * alpha).round() as u16;
            }
            clipped
        })
        .sum();
    let whole = codes.chunks_exact(4).all(|p| p[3] == u16::MAX);
    let image = ImageBuffer::<Rgba<u16>, _>::from_raw(width, height, codes).unwrap_or_default();
    let image = DynamicImage::ImageRgba16(image);
    (if opaque && whole { DynamicImage::ImageRgb16(image.into_rgb16()) } else { image }, clipped)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_is_that_of_srgb() {
        // Values of the standard: the pieces meet, 18 % grey is about 46 %, and the ends are fixed.
        assert!((encode(0.003_130_8) - 0.040_449_936).abs() < 1e-9 && (encode(0.003_130_81) - 0.040_45).abs() < 1e-5);
        assert!((encode(0.18) - 0.461_356).abs() < 1e-6);
        assert_eq!((code(0.0, true), code(1.0, true), code(7.0, true), code(-1.0, false)), (0, 65535, 65535, 0));
    }

    #[test]
    fn what_is_done_is_said() {
        let said = |tone: Tone, samples| tone.of(samples).to_string();
        let exr = said(Tone::default(), Samples::Float);
        assert!(exr.contains("white at 1, linear, encoded with the curve of sRGB"), "{exr}");
        let png = said(Tone { white_level: Some(4095.0), transfer: Transfer::Auto }, Samples::Bits16);
        assert!(png.contains("16 bits") && png.contains("white at 4095") && png.contains("as encoded"), "{png}");
    }
}
