//! Photographs: decoded on request, at the size of the view's camera.

use std::path::Path;

use image::DynamicImage;
use image::imageops::{self, FilterType};

use super::error::Error;
use super::lens::{Distortion, Lens};
use super::masks::{Mask, MaskUse};
use super::picture_file::{picture, read, samples, whole};
use super::pixels::{ChannelValue, Pixels};
use super::tone::{Samples, Tone};
use super::{View, alpha_composite, jpeg_reduced, undistort};
use crate::host_memory::DecodeLimit;

/// A decoded photograph.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Photograph {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Red, green, blue as encoded in the file (usually sRGB; with more than 8 bits as [`super::Tone`] says), and
    /// alpha. Alpha is the file's, opaque without an alpha channel, and 0 where a mask leaves the pixel out or the lens
    /// shows nothing.
    pub pixels: Pixels,
    /// Pixels of the file that are brighter than the white level.
    pub clipped: u64,
    /// Pixels of the file that are less than half opaque and not composited over a colour.
    pub transparent: u64,
    /// How the mask is used; `None` without a mask.
    pub mask: Option<MaskUse>,
}

impl Photograph {
    /// Decodes a file as stored, without camera, lens or mask, within half of the free memory.
    pub fn read(file: &Path) -> Result<Self, Error> {
        Self::read_within(file, DecodeLimit::new(None))
    }

    /// [`Self::read`] within a memory limit.
    pub fn read_within(file: &Path, limit: DecodeLimit) -> Result<Self, Error> {
        let bytes = read(file)?;
        let image = picture(file, &whole(file, &bytes, limit)?, limit)?;
        let deep = samples(image.color()) != Samples::Bits8;
        let (image, clipped) = if deep { Tone::default().applied(image) } else { (image, 0) };
        let (width, height) = (image.width(), image.height());
        let transparent = alpha_composite::mostly_clear(&image);
        Ok(Self { width, height, pixels: reduced(image, deep, width, height), clipped, transparent, mask: None })
    }

    /// RGBA with 8 bits per channel, rounded from 16 bits.
    pub fn rgba8(&self) -> std::borrow::Cow<'_, [u8]> {
        self.pixels.rgba8()
    }
}

/// Decodes a view's photograph and brings it to the view's camera. Where the lens has distortion or pixels are left
/// out, the photograph is resampled through the lens, else it is reduced to the camera's size. EXIF orientation tags
/// are ignored, as in COLMAP: its cameras describe the pixels as stored.
///
/// Reduction uses Catmull-Rom bicubic interpolation on encoded values, with the kernel's support widened by the
/// reduction: kernel and space of Pillow's `resize`, which the 3DGS reference uses. A very large JPEG file is first
/// decoded at a half or a quarter of its size, if at least 1.5 times the wanted pixels per side remain.
pub(super) fn decode(view: &View) -> Result<Photograph, Error> {
    decode_bytes(view, &read(&view.path)?)
}

/// [`decode`] of a file's bytes.
pub(super) fn decode_bytes(view: &View, bytes: &[u8]) -> Result<Photograph, Error> {
    let (width, height) = (view.camera.width, view.camera.height);
    let bytes = &*whole(&view.path, bytes, view.limit)?;
    let image = match jpeg_reduced::decode(bytes, view.size_on_disk, jpeg_reduced::divisor(view)) {
        Some(reduced) => reduced,
        None => {
            let image = picture(&view.path, bytes, view.limit)?;
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
        Some(colour) if has_alpha => alpha_composite::laid_over(image, colour),
        _ => image,
    };
    let transparent = alpha_composite::mostly_clear(&image);
    let now = (image.width(), image.height());
    let mask = match &view.mask {
        Some(file) => Some(Mask::read(file, view.mask_ignores, view.limit)?.for_photograph(file, now)?),
        None => None,
    };
    let used = mask.as_ref().map(|mask| mask.used());
    let pixels = if view.lens.is_none() && view.mask.is_none() && (now == (width, height) || !image.color().has_alpha())
    {
        reduced(image, deep, width, height)
    } else {
        match deep {
            false => Pixels::Rgba8(resampled(image.into_rgba8().into_raw(), now, mask.as_ref(), view)),
            true => Pixels::Rgba16(resampled(image.into_rgba16().into_raw(), now, mask.as_ref(), view)),
        }
    };
    Ok(Photograph { width, height, pixels, clipped, transparent, mask: used })
}

/// Brings an opaque image, or one that keeps its size, to a size, with alpha.
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

/// Puts the mask into the image's alpha and resamples the image for the view's camera.
fn resampled<T: ChannelValue>(mut rgba: Vec<T>, now: (u32, u32), mask: Option<&Mask>, view: &View) -> Vec<T> {
    if let Some(mask) = mask {
        mask.apply(&mut rgba, now);
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
