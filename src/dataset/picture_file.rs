//! Reads headers and pixels of picture files within a memory limit.

use std::borrow::Cow;
use std::io::{BufRead, BufReader, Cursor, Seek};
use std::path::Path;

use image::{DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader, Limits};

use super::error::Error;
use super::jpeg_truncation::{self, End};
use super::picture_size;
use super::tone::Samples;
use crate::format::contain::contained;
use crate::format::{self, foreign, source};
use crate::host_memory::DecodeLimit;

/// Memory of decoders besides the picture: tables, colour profiles, a strip as stored.
const BESIDE: u64 = 256 << 20;
/// The formats that can be read, for messages.
const READ: &str = "JPEG, PNG, TIFF, WebP and OpenEXR";

/// The header of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) size: (u32, u32),
    pub(super) samples: Samples,
    pub(super) jpeg: bool,
}

/// Reads a header without the pixels.
pub(super) fn header(file: &Path) -> Result<Header, Error> {
    let (opened, bytes) = source::open(file)?;
    let mut reader = BufReader::new(opened);
    let begin = reader.fill_buf().map_err(format::Error::io(file, "read"))?;
    let bits = picture_size::stored_bits(begin);
    let begin = begin[..begin.len().min(foreign::LOOKED_AT)].to_vec();
    let mut guessed = ImageReader::new(&mut reader).with_guessed_format().map_err(format::Error::io(file, "read"))?;
    if let Some(problem) = unreadable(file, bytes, &begin, guessed.format()) {
        return Err(Error::undecodable(file, "header", 0, problem));
    }
    guessed.limits(limits(0));
    let format = guessed.format();
    let said = |decoder: &dyn ImageDecoder| (decoder.dimensions(), samples(decoder.color_type()));
    let found = contained(|| guessed.into_decoder().map(|decoder| said(&decoder)).map_err(complaint)).flatten();
    let at = reader.stream_position().unwrap_or(0);
    let fail = |problem| Err(Error::undecodable(file, "header", at, problem));
    match found {
        Ok((size, samples)) => match picture_size::problem(size, format, bits, bytes) {
            None => Ok(Header { size, samples, jpeg: format == Some(ImageFormat::Jpeg) }),
            Some(problem) => fail(problem),
        },
        Err(problem) => fail(problem),
    }
}

/// Reads the header of a picture to be decoded. Refuses a picture over the memory limit.
pub(super) fn header_within(file: &Path, limit: DecodeLimit) -> Result<Header, Error> {
    let found = header(file)?;
    picture_size::check(file, found.size, picture_size::decoding_bytes(found.size, found.samples), limit)?;
    Ok(found)
}

/// What the camera noted of the exposure, where it did: see [`super::View::noted_exposure`].
pub(super) fn noted_exposure(file: &Path) -> Option<f64> {
    let mut reader = BufReader::new(source::open(file).ok()?.0);
    let noted = contained(|| exif::Reader::new().read_from_container(&mut reader).ok()).ok().flatten()?;
    let number = |tag| match &noted.get_field(tag, exif::In::PRIMARY)?.value {
        exif::Value::Rational(values) => Some(values.first()?.to_f64()),
        value => value.get_uint(0).map(f64::from),
    };
    let positive = |tag| number(tag).filter(|value| value.is_finite() && *value > 0.0);
    let sensitivity = positive(exif::Tag::PhotographicSensitivity).unwrap_or(1.0);
    let aperture = positive(exif::Tag::FNumber).unwrap_or(1.0);
    Some(positive(exif::Tag::ExposureTime)? * sensitivity / aperture.powi(2))
}

/// Why a file of `bytes` bytes cannot be read, from its format and its beginning.
fn unreadable(file: &Path, bytes: u64, begin: &[u8], format: Option<ImageFormat>) -> Option<String> {
    match format {
        Some(ImageFormat::Tiff) => foreign::described_raw(file),
        Some(ImageFormat::Jpeg | ImageFormat::Png | ImageFormat::WebP | ImageFormat::OpenExr) => None,
        _ => Some(match (foreign::described(file, bytes, begin).or_else(|| foreign::described_raw(file)), format) {
            (Some(what), _) => what,
            (None, Some(other)) => {
                let name = format!("{other:?}").to_uppercase();
                format!("is of the format {name}; {READ} are read: convert it")
            }
            (None, None) => format!("is of no known format; {READ} are read"),
        }),
    }
}

/// A decoder's message, with a remedy where the decoder does not support a variant of its format.
fn complaint(error: ImageError) -> String {
    let remedy = if matches!(error, ImageError::Unsupported(_)) { "; convert it to PNG or JPEG" } else { "" };
    format!("{error}{remedy}")
}

/// Limits of a decoder for a picture of `needed` bytes.
fn limits(needed: u64) -> Limits {
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(needed.saturating_add(BESIDE));
    limits
}

/// The kind of values of a decoded picture.
pub(super) fn samples(colour: image::ColorType) -> Samples {
    match colour.bytes_per_pixel() / colour.channel_count().max(1) {
        1 => Samples::Bits8,
        2 => Samples::Bits16,
        _ => Samples::Float,
    }
}

/// The bytes of a file.
pub(super) fn read(file: &Path) -> Result<Vec<u8>, Error> {
    let (mut opened, _) = source::open(file)?;
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut opened, &mut bytes).map_err(format::Error::io(file, "read"))?;
    Ok(bytes)
}

/// Appends a missing end marker to a JPEG file. Refuses a file with missing pixels, which decoders would fill with grey
/// without an error.
pub(super) fn whole<'a>(file: &Path, bytes: &'a [u8], limit: DecodeLimit) -> Result<Cow<'a, [u8]>, Error> {
    let mended = match jpeg_truncation::end(bytes) {
        End::Whole => return Ok(Cow::Borrowed(bytes)),
        End::Missing => {
            let needed = opened(file, bytes, limit)?;
            jpeg_truncation::mended(bytes, |bytes| decoded(bytes, needed).ok())
        }
        End::Truncated => None,
    };
    mended.map(Cow::Owned).ok_or_else(|| {
        let problem = "the file ends before the picture does: copy it again from where it came from";
        Error::undecodable(file, "pixels", bytes.len() as u64, problem)
    })
}

/// Checks that a picture may be decoded. Returns the bytes that decoding takes.
fn opened(file: &Path, bytes: &[u8], limit: DecodeLimit) -> Result<u64, Error> {
    let mut cursor = Cursor::new(bytes);
    let reader = ImageReader::new(&mut cursor).with_guessed_format().map_err(format::Error::io(file, "read"))?;
    let begin = &bytes[..bytes.len().min(foreign::LOOKED_AT)];
    let format = reader.format();
    if let Some(problem) = unreadable(file, bytes.len() as u64, begin, format) {
        return Err(Error::undecodable(file, "pixels", 0, problem));
    }
    let said = |decoder: &dyn ImageDecoder| (decoder.dimensions(), samples(decoder.color_type()));
    let found = contained(|| reader.into_decoder().map(|decoder| said(&decoder)).map_err(complaint)).flatten();
    let fail = |problem| Error::undecodable(file, "pixels", cursor.position(), problem);
    let (size, samples) = found.map_err(fail)?;
    let bits = picture_size::stored_bits(bytes);
    if let Some(problem) = picture_size::problem(size, format, bits, bytes.len() as u64) {
        return Err(fail(problem));
    }
    let hidden = if format == Some(ImageFormat::OpenExr) { picture_size::hidden_bytes(bytes) } else { 0 };
    let needed = picture_size::decoding_bytes(size, samples).saturating_add(hidden);
    picture_size::check_now(file, size, needed, limit)?;
    Ok(needed)
}

/// Decodes the picture in a file's bytes within the limit.
pub(super) fn picture(file: &Path, bytes: &[u8], limit: DecodeLimit) -> Result<DynamicImage, Error> {
    let needed = opened(file, bytes, limit)?;
    decoded(bytes, needed).map_err(|(at, problem)| Error::undecodable(file, "pixels", at, problem))
}

/// The decoded picture of `needed` bytes, or the position of the decoder and its message.
fn decoded(bytes: &[u8], needed: u64) -> Result<DynamicImage, (u64, String)> {
    let mut cursor = Cursor::new(bytes);
    let decode = || {
        let mut reader = ImageReader::new(&mut cursor).with_guessed_format().map_err(|e| e.to_string())?;
        reader.limits(limits(needed));
        let decoder = reader.into_decoder().map_err(complaint)?;
        DynamicImage::from_decoder(decoder).map_err(complaint)
    };
    let found = contained(decode).flatten();
    found.map_err(|problem| (cursor.position(), problem))
}
