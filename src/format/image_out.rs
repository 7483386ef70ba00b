//! Writes images: 8-bit PNG, and OpenEXR for values with units.

use std::path::Path;

use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};

use super::{Error, atomic};

mod open_exr;

pub use open_exr::{
    DepthMap, NormalMap, read_depth, read_depth_within, read_normals, read_normals_within, write_depth,
    write_luminance, write_normals,
};

/// A value from 0 to 1 as 8 bits, rounded to the nearest as in evaluation. NaN becomes 0.
pub fn to_u8(value: f32) -> u8 {
    // The cast saturates and turns NaN into 0.
    (value.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// The first three of every `floats_per_pixel` values as 8-bit RGB.
pub fn to_rgb8(pixels: &[f32], floats_per_pixel: usize) -> Vec<u8> {
    pixels.chunks_exact(floats_per_pixel.max(3)).flat_map(|p| [to_u8(p[0]), to_u8(p[1]), to_u8(p[2])]).collect()
}

/// Writes rows of 8-bit RGB.
pub fn write_png(file: &Path, width: u32, height: u32, rgb: &[u8]) -> Result<(), Error> {
    check_size(file, width, height, rgb.len() / 3, rgb.len().is_multiple_of(3))?;
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes)
        .write_image(rgb, width, height, ExtendedColorType::Rgb8)
        .map_err(|e| Error::Unwritable { file: file.to_owned(), what: "the PNG", problem: e.to_string() })?;
    atomic::write(file, |out| out.write_all(&bytes))
}

fn check_size(file: &Path, width: u32, height: u32, pixels: usize, whole: bool) -> Result<(), Error> {
    if whole && width > 0 && height > 0 && u64::from(width) * u64::from(height) == pixels as u64 {
        return Ok(());
    }
    let problem = format!("{pixels} pixels are not {width}x{height}");
    Err(Error::Unwritable { file: file.to_owned(), what: "the picture", problem })
}
