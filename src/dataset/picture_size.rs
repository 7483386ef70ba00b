//! The memory of a picture, from its header and before any is allocated: whether the file can hold the picture, and
//! whether decoding stays within a limit.

use std::io::Cursor;
use std::path::Path;

use exr::meta::{BlockDescription, MetaData};
use image::ImageFormat;

use super::error::Error;
use super::tone::Samples;
use crate::format::contain::contained;
use crate::host_memory::{DecodeLimit, NoMemory};

/// Most bytes of an uncompressed picture per byte of its file. Deflate (PNG, OpenEXR) reaches 1032, and the Huffman
/// codes of JPEG (at least a bit per block of 64 pixels) 512.
const MOST: u64 = 1100;
/// The first bytes of a PNG file, up to the size in its header.
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR";
/// Most rows that OpenEXR compresses together.
const EXR_ROWS: u64 = 256;

/// Bits of an uncompressed pixel, judged by the beginning of the file. A PNG header has the number (1 in some masks).
/// Other formats count with the fewest bits that they allow.
pub(super) fn stored_bits(begin: &[u8]) -> u64 {
    match (begin.strip_prefix(PNG), begin) {
        // Width, height, bit depth, colour type.
        (Some([_, _, _, _, _, _, _, _, depth, colour, ..]), _) => {
            let channels = match colour {
                2 => 3,
                4 => 2,
                6 => 4,
                _ => 1,
            };
            u64::from(*depth).max(1) * channels
        }
        _ => 8,
    }
}

/// Why a file of `bytes` bytes cannot hold a picture of this size; `None` where it can.
pub(super) fn problem(
    (width, height): (u32, u32),
    format: Option<ImageFormat>,
    bits: u64,
    bytes: u64,
) -> Option<String> {
    if width == 0 || height == 0 {
        return Some(format!("the size is {width}x{height}"));
    }
    // These formats compress a uniform picture of any size to almost nothing.
    if matches!(format, Some(ImageFormat::WebP | ImageFormat::Tiff)) {
        return None;
    }
    let stored = u128::from(width) * u128::from(height) * u128::from(bits) / 8;
    let held = u128::from(MOST) * u128::from(bytes);
    (stored > held).then(|| format!("{width}x{height} pixels cannot be in a file of {bytes} bytes"))
}

/// Bytes per pixel while a picture is decoded: in the decoder's form and in the kept form.
pub(super) fn decoding_bytes_per_pixel(samples: Samples) -> u64 {
    match samples {
        Samples::Bits8 => 3 + 4,
        Samples::Bits16 => 6 + 8,
        Samples::Float => 16 + 8 + 8,
    }
}

/// Approximate bytes for decoding a picture at full size: the file (assumed to have a byte per pixel), and its pixels
/// in two forms.
pub(super) fn decoding_bytes((width, height): (u32, u32), samples: Samples) -> u64 {
    (u64::from(width) * u64::from(height)).saturating_mul(1 + decoding_bytes_per_pixel(samples))
}

/// Bytes that an OpenEXR decoder needs for parts that are not shown: pixels outside the display window, further
/// channels, and tiles, one of which may be as large as the picture.
pub(super) fn hidden_bytes(bytes: &[u8]) -> u64 {
    let read = contained(|| MetaData::read_from_buffered(Cursor::new(bytes), false).ok());
    let Ok(Some(meta)) = read else { return 0 };
    let of = |header: &exr::meta::header::Header| {
        let (width, height) = (header.layer_size.0 as u64, header.layer_size.1 as u64);
        let channels = header.channels.list.len().max(1) as u64;
        let rows = match header.blocks {
            BlockDescription::ScanLines => height.min(EXR_ROWS),
            BlockDescription::Tiles(_) => height,
        };
        2_u64.saturating_mul(width).saturating_mul(rows).saturating_mul(4 * channels)
    };
    meta.headers.iter().map(of).fold(0, u64::saturating_add)
}

/// Refuses a picture whose decoding takes more memory than allowed.
pub(super) fn check(file: &Path, size: (u32, u32), needed: u64, limit: DecodeLimit) -> Result<(), Error> {
    limit.allows(needed).map_err(|reason| refusal(file, size, needed, limit, reason))
}

/// [`check`], which also refuses a picture for which the system has too little free memory.
pub(super) fn check_now(file: &Path, size: (u32, u32), needed: u64, limit: DecodeLimit) -> Result<(), Error> {
    limit.has_room_for(needed).map_err(|reason| refusal(file, size, needed, limit, reason))
}

fn refusal(file: &Path, size: (u32, u32), needed: u64, limit: DecodeLimit, reason: NoMemory) -> Error {
    let file = file.to_owned();
    match reason {
        NoMemory::OverLimit => Error::PictureTooLarge { file, size, needed, limit },
        NoMemory::Refused => Error::NoMemoryForPicture { file, size, needed },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_most_compressible_pictures_pass_and_claims_beyond_do_not() {
        let mut png = PNG.to_vec();
        png.extend([0, 0, 0x40, 0, 0, 0, 0x40, 0, 1, 0]);
        assert_eq!(stored_bits(&png), 1, "a mask");
        png[24..26].copy_from_slice(&[16, 6]);
        assert_eq!(stored_bits(&png), 64);
        assert_eq!((stored_bits(&png[..25]), stored_bits(b"\xff\xd8\xff")), (8, 8));
        // 2^28 pixels of one bit are 32 MiB, which deflate compresses to a little over 32 KiB.
        let of = |size, bits, bytes| problem(size, Some(ImageFormat::Png), bits, bytes);
        assert_eq!(of((1 << 14, 1 << 14), 1, 33_000), None);
        assert!(of((1 << 14, 1 << 14), 1, 30_000).is_some());
        assert!(of((u32::MAX, u32::MAX), 64, 1 << 40).is_some());
        assert!(of((0, 5), 8, 1 << 20).is_some_and(|p| p.contains("0x5")));
        // A lossless WebP of one colour has 26 bytes at any size. Group 4 stores a blank page with one bit per row.
        for format in [ImageFormat::WebP, ImageFormat::Tiff] {
            assert_eq!(problem((1 << 14, 1 << 14), Some(format), 8, 26), None);
        }
    }

    #[test]
    fn decoding_is_held_against_the_limit() {
        let file = Path::new("a.exr");
        let needed = decoding_bytes((60_000, 60_000), Samples::Float);
        assert!(needed > 100 << 30, "{needed}");
        let limit = DecodeLimit { most: 8 << 30, asked: false };
        let error = check(file, (60_000, 60_000), needed, limit).expect_err("too large").to_string();
        assert!(error.contains("a.exr") && error.contains("60000x60000") && error.contains("8.00 GiB"), "{error}");
        assert!(check_now(file, (1, 1), 1 << 20, limit).is_ok());
        assert!(decoding_bytes((u32::MAX, u32::MAX), Samples::Float) > 1 << 62);
    }
}
