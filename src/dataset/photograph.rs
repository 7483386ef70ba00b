//! Photographs: their sizes from the headers, their pixels on demand.

use std::fs::File;
use std::io::{BufReader, Cursor, Seek};
use std::path::Path;

use image::imageops::{self, FilterType};
use image::{DynamicImage, ImageDecoder, ImageReader};

use super::error::Error;
use super::lens::{Distortion, Lens};
use super::{View, jpeg_end, masks, undistort};
use crate::format;

/// An image in memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Photograph {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Rows from the top, four bytes per pixel: red, green, blue (as encoded in the file, sRGB as a rule), alpha (the file's,
    /// 255 where it has none; 0 where a mask leaves the pixel out and where the lens has no picture).
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

/// Whether one size is that of a copy of the other: sides of reduced copies are rounded up or down.
pub(super) fn same_shape(copy: (u32, u32), of: (u32, u32)) -> bool {
    let (w, h) = (f64::from(copy.0), f64::from(copy.1));
    let ratio = f64::from(of.1) / f64::from(of.0);
    (h - w * ratio).abs() <= 1.0 + ratio
}

/// Decodes a view's photograph and makes it into the picture of the view's camera: by resampling through the lens where that
/// bends rays or pixels are left out, else by reducing it to the camera's size. Orientation tags of EXIF are not looked at,
/// because COLMAP does not either: its cameras are those of the pixels as they are stored.
///
/// Downscaling uses Catmull-Rom bicubic interpolation with its support widened by the reduction, on the encoded values: the
/// same kernel and the same space as Pillow's `resize`, which the 3DGS reference uses.
pub(super) fn decode(view: &View) -> Result<Photograph, Error> {
    let (width, height) = (view.camera.width, view.camera.height);
    let image = pixels(&view.path)?;
    let now = (image.width(), image.height());
    if now != view.size_on_disk {
        return Err(Error::Changed { file: view.path.clone(), now, before: view.size_on_disk });
    }
    if view.lens.is_none() && view.mask.is_none() && (now == (width, height) || !image.color().has_alpha()) {
        let image = if now == (width, height) {
            image.into_rgba8()
        } else {
            DynamicImage::ImageRgb8(imageops::resize(&image.into_rgb8(), width, height, FilterType::CatmullRom))
                .into_rgba8()
        };
        return Ok(Photograph { width, height, rgba: image.into_raw() });
    }
    let mut rgba = image.into_rgba8().into_raw();
    if let Some(file) = &view.mask {
        let mask = pixels(file)?.into_luma8();
        let size = (mask.width(), mask.height());
        if !same_shape(size, now) {
            return Err(Error::MaskSize { file: file.clone(), mask: size, photograph: now });
        }
        masks::apply(&mut rgba, now.0, now.1, &mask, view.mask_ignores);
    }
    if view.lens.is_none() && now == (width, height) {
        return Ok(Photograph { width, height, rgba });
    }
    let straight = || {
        let full = view.camera.resized(now.0, now.1);
        let none = Distortion::brown([0.0; 3], [0.0; 2]);
        Lens::new([full.fx, full.fy], [full.cx, full.cy], [now.0, now.1], none)
    };
    let lens = view.lens.unwrap_or_else(straight);
    Ok(Photograph { width, height, rgba: undistort::resample(&rgba, &lens, &view.camera) })
}

/// The picture in a file.
fn pixels(file: &Path) -> Result<DynamicImage, Error> {
    let bytes = std::fs::read(file).map_err(format::Error::io(file, "read"))?;
    if !jpeg_end::is_whole(&bytes) {
        return Err(Error::undecodable(file, "pixels", bytes.len() as u64, "the file ends before the picture does"));
    }
    let mut cursor = Cursor::new(bytes.as_slice());
    let decoded = decoded(file, &mut cursor);
    decoded?.map_err(|e| Error::undecodable(file, "pixels", cursor.position(), e))
}

fn decoded(file: &Path, cursor: &mut Cursor<&[u8]>) -> Result<Result<DynamicImage, image::ImageError>, Error> {
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
