//! Photographs: their sizes from the headers, their pixels on demand.

use std::fs::File;
use std::io::{BufReader, Cursor, Seek};
use std::path::Path;

use image::imageops::{self, FilterType};
use image::{DynamicImage, ImageDecoder, ImageReader, RgbaImage};

use super::error::Error;
use super::jpeg_end;
use crate::format;

/// An image in memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Photograph {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Rows from the top, four bytes per pixel: red, green, blue (as encoded in the file, sRGB as a rule), alpha (255 where
    /// the file has none).
    pub rgba: Vec<u8>,
}

/// Width and height from the header; the pixels are not decoded.
pub(super) fn size_on_disk(file: &Path) -> Result<(u32, u32), Error> {
    let mut reader = BufReader::new(File::open(file).map_err(format::Error::io(file, "open"))?);
    let found = ImageReader::new(&mut reader)
        .with_guessed_format()
        .map_err(format::Error::io(file, "read"))?
        .into_dimensions()
        .map_err(|e| e.to_string());
    let at = reader.stream_position().unwrap_or(0);
    match found {
        Ok((width, height)) if width > 0 && height > 0 => Ok((width, height)),
        Ok((width, height)) => {
            Err(Error::undecodable(file, "header", at, format_args!("the size is {width}x{height}")))
        }
        Err(problem) => Err(Error::undecodable(file, "header", at, problem)),
    }
}

/// Decodes a photograph whose header said `expected` and brings it to `width` x `height`, which is not larger.
///
/// Downscaling uses Catmull-Rom bicubic interpolation with its support widened by the reduction, on the encoded values: the
/// same kernel and the same space as Pillow's `resize`, which the 3DGS reference uses.
pub(super) fn decode(file: &Path, expected: (u32, u32), width: u32, height: u32) -> Result<Photograph, Error> {
    let bytes = std::fs::read(file).map_err(format::Error::io(file, "read"))?;
    if !jpeg_end::is_whole(&bytes) {
        return Err(Error::undecodable(file, "pixels", bytes.len() as u64, "the file ends before the picture does"));
    }
    let mut cursor = Cursor::new(bytes.as_slice());
    let decoded = pixels(file, &mut cursor);
    let image = decoded?.map_err(|e| Error::undecodable(file, "pixels", cursor.position(), e))?;
    let now = (image.width(), image.height());
    if now != expected {
        return Err(Error::Changed { file: file.to_owned(), now, before: expected });
    }
    let image = if now == (width, height) {
        image.into_rgba8()
    } else if image.color().has_alpha() {
        resize_with_alpha(image.into_rgba8(), width, height)
    } else {
        DynamicImage::ImageRgb8(imageops::resize(&image.into_rgb8(), width, height, FilterType::CatmullRom))
            .into_rgba8()
    };
    Ok(Photograph { width, height, rgba: image.into_raw() })
}

fn pixels(file: &Path, cursor: &mut Cursor<&[u8]>) -> Result<Result<DynamicImage, image::ImageError>, Error> {
    let reader = ImageReader::new(cursor).with_guessed_format().map_err(format::Error::io(file, "read"))?;
    let decoder = match reader.into_decoder() {
        Ok(decoder) => decoder,
        Err(e) => return Ok(Err(e)),
    };
    let color = decoder.color_type();
    if color.bytes_per_pixel() != color.channel_count() {
        return Err(Error::UnsupportedPixels { file: file.to_owned(), pixels: format!("{color:?}") });
    }
    Ok(DynamicImage::from_decoder(decoder))
}

/// Colours are weighted with their alpha while they are mixed, so that what is transparent does not bleed.
fn resize_with_alpha(mut image: RgbaImage, width: u32, height: u32) -> RgbaImage {
    let scaled = |value: u8, alpha: u8| ((u32::from(value) * u32::from(alpha) + 127) / 255) as u8;
    for p in image.pixels_mut() {
        let [r, g, b, a] = p.0;
        p.0 = [scaled(r, a), scaled(g, a), scaled(b, a), a];
    }
    let mut out = imageops::resize(&image, width, height, FilterType::CatmullRom);
    for p in out.pixels_mut() {
        let [r, g, b, a] = p.0;
        let alpha = u32::from(a.max(1));
        let restored = |value: u8| ((u32::from(value) * 255 + alpha / 2) / alpha).min(255) as u8;
        p.0 = [restored(r), restored(g), restored(b), a];
    }
    out
}
