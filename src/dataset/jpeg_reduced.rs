//! Decodes very large JPEG photographs at a fraction of their size where that is enough. Takes a third of the memory
//! and less than half of the time.

use image::{DynamicImage, GrayImage, RgbImage};
use jpeg_decoder::{Decoder, PixelFormat};

use super::View;
use crate::format::contain::contained;

/// Smaller photographs are decoded at full size: it costs little.
const LARGE: u32 = 3000;
/// Least ratio of decoded to wanted pixels along a side. The resampling afterwards decides how the image looks, and not
/// the decoder's averages.
const MARGIN: f64 = 1.5;

/// The divisor of both sides for decoding a view's photograph; 1 for full size.
pub(super) fn divisor(view: &View) -> u32 {
    let (width, height) = view.size_on_disk;
    if !view.jpeg || width.max(height) < LARGE {
        return 1;
    }
    let camera = &view.camera;
    // Pixels wanted per pixel on disk.
    let ratio = match &view.lens {
        Some(lens) => (camera.fx / lens.focal[0]).max(camera.fy / lens.focal[1]),
        None => (f64::from(camera.width) / f64::from(width)).max(f64::from(camera.height) / f64::from(height)),
    };
    // A side that the divisor does not divide would be rounded up, which shifts the image against its camera.
    let fits = |n: &u32| width % n == 0 && height % n == 0 && 1.0 >= MARGIN * ratio * f64::from(*n);
    // At an eighth, only block means are left, and fine texture loses contrast.
    [4, 2].into_iter().find(fits).unwrap_or(1)
}

/// The picture at a fraction of its size. `None` for another format, other pixel types or a damaged file: the decoder
/// for whole pictures handles these and reports their errors.
pub(super) fn decode(bytes: &[u8], size: (u32, u32), divisor: u32) -> Option<DynamicImage> {
    if divisor <= 1 {
        return None;
    }
    contained(|| decode_reduced(bytes, size, divisor)).ok().flatten()
}

fn decode_reduced(bytes: &[u8], size: (u32, u32), divisor: u32) -> Option<DynamicImage> {
    let (width, height) = (size.0 / divisor, size.1 / divisor);
    let mut decoder = Decoder::new(bytes);
    decoder.read_info().ok()?;
    let info = decoder.info()?;
    if (u32::from(info.width), u32::from(info.height)) != size {
        return None;
    }
    let scaled = decoder.scale(u16::try_from(width).ok()?, u16::try_from(height).ok()?).ok()?;
    if (u32::from(scaled.0), u32::from(scaled.1)) != (width, height) {
        return None;
    }
    let pixels = decoder.decode().ok()?;
    match info.pixel_format {
        PixelFormat::RGB24 => RgbImage::from_raw(width, height, pixels).map(DynamicImage::ImageRgb8),
        PixelFormat::L8 => GrayImage::from_raw(width, height, pixels).map(DynamicImage::ImageLuma8),
        _ => None,
    }
}
