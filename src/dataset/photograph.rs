//! Photographs: their sizes from the headers, their pixels on demand.

use std::io::{BufRead, BufReader, Cursor, Seek};
use std::path::Path;

use image::imageops::{self, FilterType};
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};

use super::error::Error;
use super::lens::{Distortion, Lens};
use super::pixels::{Pixels, Sample};
use super::tone::{Samples, Tone};
use super::{View, behind, jpeg_end, jpeg_reduced, masks, picture_size, undistort};
use crate::format::contain::contained;
use crate::format::{self, source};

/// An image in memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Photograph {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Red, green, blue (as encoded in the file, sRGB as a rule; with more than 8 bits as [`super::Tone`] says), alpha (the
    /// file's, opaque where it has none; 0 where a mask leaves the pixel out and where the lens has no picture).
    pub pixels: Pixels,
    /// Pixels of the file that are brighter than the white level.
    pub clipped: u64,
    /// Pixels of the file that are less than half opaque and not laid over a colour.
    pub transparent: u64,
}

impl Photograph {
    /// Decodes a file as it is stored, without camera, lens or mask.
    pub fn read(file: &Path) -> Result<Self, Error> {
        let bytes = read(file)?;
        check_whole(file, &bytes)?;
        let image = picture(file, &bytes)?;
        let deep = samples(image.color()) != Samples::Bits8;
        let (image, clipped) = if deep { Tone::default().applied(image) } else { (image, 0) };
        let (width, height) = (image.width(), image.height());
        let transparent = behind::mostly_clear(&image);
        Ok(Self { width, height, pixels: reduced(image, deep, width, height), clipped, transparent })
    }

    /// RGBA with 8 bits per channel, rounded where there are more.
    pub fn rgba8(&self) -> std::borrow::Cow<'_, [u8]> {
        self.pixels.rgba8()
    }
}

/// What the header of a photograph says; the pixels are not decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) size: (u32, u32),
    pub(super) samples: Samples,
    pub(super) jpeg: bool,
}

/// Reads a header.
pub(super) fn header(file: &Path) -> Result<Header, Error> {
    let (opened, bytes) = source::open(file)?;
    let mut reader = BufReader::new(opened);
    let bits = picture_size::stored_bits(reader.fill_buf().map_err(format::Error::io(file, "read"))?);
    let guessed = ImageReader::new(&mut reader).with_guessed_format().map_err(format::Error::io(file, "read"))?;
    if let Some(problem) = unreadable(bytes, guessed.format()) {
        return Err(Error::undecodable(file, "header", 0, problem));
    }
    let jpeg = guessed.format() == Some(ImageFormat::Jpeg);
    let said = |decoder: &dyn ImageDecoder| (decoder.dimensions(), samples(decoder.color_type()));
    let found = contained(|| guessed.into_decoder().map(|decoder| said(&decoder)).map_err(|e| e.to_string())).flatten();
    let at = reader.stream_position().unwrap_or(0);
    match found {
        Ok((size, samples)) => match picture_size::problem(size, bits, bytes) {
            None => Ok(Header { size, samples, jpeg }),
            Some(problem) => Err(Error::undecodable(file, "header", at, problem)),
        },
        Err(problem) => Err(Error::undecodable(file, "header", at, problem)),
    }
}

/// The formats that are read, in words.
const READ: &str = "JPEG, PNG, TIFF, WebP and OpenEXR";

/// Why nothing can be read of so many bytes of a format, as their beginning tells it.
fn unreadable(bytes: u64, format: Option<ImageFormat>) -> Option<String> {
    let name = match format {
        _ if bytes == 0 => return Some("the file is empty".to_owned()),
        Some(ImageFormat::Jpeg | ImageFormat::Png | ImageFormat::Tiff | ImageFormat::WebP | ImageFormat::OpenExr) => {
            return None;
        }
        None => return Some(format!("is of no known format; {READ} are read")),
        Some(other) => format!("{other:?}").to_uppercase(),
    };
    Some(format!("is of the format {name}; {READ} are read: convert it"))
}

fn samples(color: image::ColorType) -> Samples {
    match color.bytes_per_pixel() / color.channel_count().max(1) {
        1 => Samples::Bits8,
        2 => Samples::Bits16,
        _ => Samples::Float,
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
/// same kernel and the same space as Pillow's `resize`, which the 3DGS reference uses. A very large JPEG file is decoded at a
/// half or a quarter of its size first, where at least 1.5 times the pixels that are wanted are left.
pub(super) fn decode(view: &View) -> Result<Photograph, Error> {
    decode_bytes(view, &read(&view.path)?)
}

/// The file as it is.
pub(super) fn read(file: &Path) -> Result<Vec<u8>, Error> {
    Ok(std::fs::read(file).map_err(format::Error::io(file, "read"))?)
}

/// [`decode`] of a file that was read before.
pub(super) fn decode_bytes(view: &View, bytes: &[u8]) -> Result<Photograph, Error> {
    let (width, height) = (view.camera.width, view.camera.height);
    check_whole(&view.path, bytes)?;
    let image = match jpeg_reduced::decode(bytes, view.size_on_disk, jpeg_reduced::divisor(view)) {
        Some(reduced) => reduced,
        None => {
            let image = picture(&view.path, bytes)?;
            let now = (image.width(), image.height());
            if now != view.size_on_disk {
                return Err(Error::Changed { file: view.path.clone(), now, before: view.size_on_disk });
            }
            image
        }
    };
    let deep = samples(image.color()) != Samples::Bits8;
    let has_alpha = image.color().has_alpha();
    let (image, clipped) = if deep { view.tone.applied(image) } else { (image, 0) };
    let image = match view.behind {
        Some(colour) if has_alpha => behind::laid_over(image, colour),
        _ => image,
    };
    let transparent = behind::mostly_clear(&image);
    let now = (image.width(), image.height());
    let pixels = if view.lens.is_none() && view.mask.is_none() && (now == (width, height) || !image.color().has_alpha())
    {
        reduced(image, deep, width, height)
    } else {
        let mask = view.mask.as_deref().map(|file| read_mask(file, now)).transpose()?;
        match deep {
            false => Pixels::Rgba8(resampled(image.into_rgba8().into_raw(), now, mask.as_ref(), view)),
            true => Pixels::Rgba16(resampled(image.into_rgba16().into_raw(), now, mask.as_ref(), view)),
        }
    };
    Ok(Photograph { width, height, pixels, clipped, transparent })
}

/// An opaque picture, or one that keeps its size, with alpha.
fn reduced(image: DynamicImage, deep: bool, width: u32, height: u32) -> Pixels {
    let same = (image.width(), image.height()) == (width, height);
    let kernel = FilterType::CatmullRom;
    match (deep, same) {
        (false, true) => Pixels::Rgba8(image.into_rgba8().into_raw()),
        (false, false) => {
            let small = imageops::resize(&image.into_rgb8(), width, height, kernel);
            Pixels::Rgba8(DynamicImage::ImageRgb8(small).into_rgba8().into_raw())
        }
        (true, true) => Pixels::Rgba16(image.into_rgba16().into_raw()),
        (true, false) => {
            let small = imageops::resize(&image.into_rgb16(), width, height, kernel);
            Pixels::Rgba16(DynamicImage::ImageRgb16(small).into_rgba16().into_raw())
        }
    }
}

/// A picture with its mask in its alpha, seen by the view's camera.
fn resampled<T: Sample>(mut rgba: Vec<T>, now: (u32, u32), mask: Option<&image::GrayImage>, view: &View) -> Vec<T> {
    if let Some(mask) = mask {
        masks::apply(&mut rgba, now.0, now.1, mask, view.mask_ignores);
    }
    if view.lens.is_none() && now == (view.camera.width, view.camera.height) {
        return rgba;
    }
    let straight = || {
        let full = view.camera.resized(now.0, now.1);
        let none = Distortion::brown([0.0; 3], [0.0; 2]);
        Lens::new([full.fx, full.fy], [full.cx, full.cy], [now.0, now.1], none)
    };
    let lens = match view.lens {
        Some(lens) if now == view.size_on_disk => lens,
        Some(lens) => lens.resized(now.0, now.1),
        None => straight(),
    };
    undistort::resample(&rgba, &lens, &view.camera)
}

fn read_mask(file: &Path, photograph: (u32, u32)) -> Result<image::GrayImage, Error> {
    let bytes = read(file)?;
    check_whole(file, &bytes)?;
    let mask = picture(file, &bytes)?.into_luma8();
    let size = (mask.width(), mask.height());
    if !same_shape(size, photograph) {
        return Err(Error::MaskSize { file: file.to_owned(), mask: size, photograph });
    }
    Ok(mask)
}

fn check_whole(file: &Path, bytes: &[u8]) -> Result<(), Error> {
    if jpeg_end::is_whole(bytes) {
        return Ok(());
    }
    Err(Error::undecodable(file, "pixels", bytes.len() as u64, "the file ends before the picture does"))
}

/// The picture in a file.
fn picture(file: &Path, bytes: &[u8]) -> Result<DynamicImage, Error> {
    let mut cursor = Cursor::new(bytes);
    let reader = ImageReader::new(&mut cursor).with_guessed_format().map_err(format::Error::io(file, "read"))?;
    if let Some(problem) = unreadable(bytes.len() as u64, reader.format()) {
        return Err(Error::undecodable(file, "pixels", 0, problem));
    }
    let decode = || {
        let decoder = reader.into_decoder().map_err(|e| e.to_string())?;
        let (size, bits) = (decoder.dimensions(), picture_size::stored_bits(bytes));
        match picture_size::problem(size, bits, bytes.len() as u64) {
            None => DynamicImage::from_decoder(decoder).map_err(|e| e.to_string()),
            Some(problem) => Err(problem),
        }
    };
    contained(decode).flatten().map_err(|problem| Error::undecodable(file, "pixels", cursor.position(), problem))
}
