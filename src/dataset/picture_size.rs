//! Whether a file can hold the picture that its header speaks of, before memory is taken for it.

/// Bytes as stored that a byte of a file can stand for: deflate (PNG, OpenEXR) ends at 1032; the Huffman codes of JPEG, a bit for a
/// block of 64 pixels at the least, at 512.
const MOST: u64 = 1100;
/// What PNG files begin with, up to the sides in their header.
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR";

/// Bits that a pixel has before it is compressed, as far as the beginning of a file tells: of a PNG file what its header says (a mask
/// may have 1), of others those that the least have.
pub(super) fn stored_bits(begin: &[u8]) -> u64 {
    match (begin.strip_prefix(PNG), begin) {
        // Sides, bits of a channel, kind of colour.
        (Some([_, _, _, _, _, _, _, _, depth, color, ..]), _) => {
            let channels = match color {
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

/// What is wrong with a size for a file of so many bytes.
pub(super) fn problem((width, height): (u32, u32), bits: u64, bytes: u64) -> Option<String> {
    if width == 0 || height == 0 {
        return Some(format!("the size is {width}x{height}"));
    }
    let stored = u128::from(width) * u128::from(height) * u128::from(bits) / 8;
    let held = u128::from(MOST) * u128::from(bytes);
    (stored > held).then(|| format!("{width}x{height} pixels cannot be in a file of {bytes} bytes"))
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
        // 2^28 pixels of one bit are 32 MiB, which deflate brings to 32 KiB and a little.
        assert_eq!(problem((1 << 14, 1 << 14), 1, 33_000), None);
        assert!(problem((1 << 14, 1 << 14), 1, 30_000).is_some());
        assert!(problem((u32::MAX, u32::MAX), 64, 1 << 40).is_some());
        assert!(problem((0, 5), 8, 1 << 20).is_some_and(|p| p.contains("0x5")));
    }
}
