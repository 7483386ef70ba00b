//! Detects truncated JPEG files: decoders fill missing parts of a photograph with grey without an error.

use image::DynamicImage;

/// How a JPEG file ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    /// With the end marker, or the file is no JPEG file.
    Whole,
    /// Among the pixels, all of which may be there.
    Missing,
    /// Before any pixel.
    Truncated,
}

/// The end marker.
const MARK: [u8; 2] = [0xff, 0xd9];

/// Walks the markers of a JPEG file (ITU-T T.81, annex B) to the end of the image. Data after the end is ignored: some
/// cameras append their own.
pub(super) fn end(bytes: &[u8]) -> End {
    if bytes.starts_with(&[0xff, 0xd8]) { walk(bytes, |_, _| ()) } else { End::Whole }
}

/// Passes on each marker with its parameters.
fn walk(bytes: &[u8], mut tell: impl FnMut(u8, &[u8])) -> End {
    let (mut at, mut pixels) = (2, false);
    loop {
        // The next marker: 0xff, but no stuffed zero, fill byte or restart inside the entropy-coded data.
        let Some(found) = bytes[at.min(bytes.len())..]
            .windows(2)
            .position(|w| w[0] == 0xff && !matches!(w[1], 0x00 | 0xff | 0xd0..=0xd7))
        else {
            return if pixels { End::Missing } else { End::Truncated };
        };
        at += found + 2;
        let marker = bytes[at - 1];
        match marker {
            0xd9 => return End::Whole,
            // Markers without parameters.
            0x01 | 0xd8 => {}
            _ => {
                let Some(length) = bytes.get(at..at + 2) else { return End::Truncated };
                let length = usize::from(u16::from_be_bytes([length[0], length[1]]));
                let Some(parameters) = bytes.get(at + 2..at + length.max(2)) else { return End::Truncated };
                tell(marker, parameters);
                at += length;
                pixels |= marker == 0xda;
            }
        }
    }
}

/// Bytes that are appended to the pixels. Where pixels are missing, different bytes change the picture.
const TAILS: [u8; 4] = [0x00, 0x55, 0xaa, 0x33];

/// Appends the end marker to a file that lacks it, if all of its pixels are there: then bytes after them change no
/// pixel. `decode` gives the picture in a file.
pub(super) fn mended(bytes: &[u8], decode: impl Fn(&[u8]) -> Option<DynamicImage>) -> Option<Vec<u8>> {
    let mut scans = Scans::default();
    if walk(bytes, |marker, parameters| scans.take(marker, parameters)) != End::Missing || !scans.are_complete() {
        return None;
    }
    // Half of a stuffed byte at the end.
    let pixels = bytes.strip_suffix(&[0xff]).unwrap_or(bytes);
    let ended = |tail: &[u8]| [pixels, tail, &MARK].concat();
    let whole = ended(&[]);
    let picture = decode(&whole)?;
    let same = |tail: &[u8]| decode(&ended(tail)).is_some_and(|other| other == picture);
    // Missing pixels begin inside the data between two restarts, or at the next restart.
    let changes_nothing = |byte: &u8| {
        let noise = [*byte; 64];
        let restarts: Vec<u8> = (0xd0..=0xd7).flat_map(|restart| [&[0xff, restart][..], &noise].concat()).collect();
        same(&noise) && (!scans.restarts || same(&restarts))
    };
    TAILS.iter().all(changes_nothing).then_some(whole)
}

/// The coefficients of each component in the scans so far.
#[derive(Default)]
struct Scans {
    progressive: bool,
    restarts: bool,
    /// Per component: its identifier, and for each coefficient whether all of its bits are there.
    components: Vec<(u8, u64)>,
}

impl Scans {
    fn take(&mut self, marker: u8, parameters: &[u8]) {
        match (marker, parameters) {
            // Start of a frame: bits, height, width, then three bytes of each component.
            (0xc0..=0xc3 | 0xc5..=0xc7 | 0xc9..=0xcb | 0xcd..=0xcf, [_, _, _, _, _, _, components @ ..]) => {
                self.progressive = marker == 0xc2;
                self.components = components.chunks_exact(3).map(|c| (c[0], 0)).collect();
            }
            (0xdd, [high, low, ..]) => self.restarts |= (*high, *low) != (0, 0),
            (0xda, [count, rest @ ..]) => self.scan(usize::from(*count), rest),
            _ => {}
        }
    }

    fn scan(&mut self, count: usize, rest: &[u8]) {
        let (names, band) = rest.split_at(rest.len().min(2 * count));
        let &[first, last, bits, ..] = band else { return };
        let last = last.min(63);
        let mut held = if first <= last { (u64::MAX >> (63 - (last - first))) << first.min(63) } else { 0 };
        if self.progressive && bits & 15 != 0 {
            held = 0;
        }
        for name in names.chunks_exact(2).map(|n| n[0]) {
            self.components.iter_mut().filter(|(known, _)| *known == name).for_each(|(_, all)| *all |= held);
        }
    }

    /// Whether no whole scan is missing.
    fn are_complete(&self) -> bool {
        !self.components.is_empty() && self.components.iter().all(|(_, held)| *held == u64::MAX)
    }
}

#[cfg(test)]
mod tests {
    use image::codecs::jpeg::JpegEncoder;
    use image::{ImageFormat, Rgb, RgbImage};

    use super::*;

    #[test]
    fn ends_inside_segments_do_not_count_and_trailers_do_no_harm() {
        // A thumbnail's end inside an application segment, a scan with a stuffed byte and a restart, the end.
        let head = [0xff, 0xd8, 0xff, 0xe1, 0, 6, 0xff, 0xd9, 1, 2];
        let scan = [0xff, 0xda, 0, 3, 9, 77, 0xff, 0x00, 0xff, 0xd3, 5];
        let whole = [&head[..], &scan, &[0xff, 0xff, 0xd9]].concat();
        assert_eq!(end(&whole), End::Whole);
        assert_eq!(end(&[&whole[..], b"trailer"].concat()), End::Whole);
        for length in 2..whole.len() {
            let found = end(&whole[..length]);
            assert!(found != End::Whole, "{length} bytes");
            assert_eq!(
                found == End::Missing,
                length >= 15,
                "{length} bytes: pixels begin behind the parameters of a scan"
            );
        }
        assert_eq!(end(b"\x89PNG"), End::Whole, "another format is not judged");
    }

    fn decode(bytes: &[u8]) -> Option<DynamicImage> {
        image::load_from_memory_with_format(bytes, ImageFormat::Jpeg).ok()
    }

    /// Cuts a picture off at every byte of its last part. Only a missing end marker counts as whole.
    fn cut_everywhere(bytes: &[u8]) {
        let picture = decode(bytes).expect("a picture");
        let pixels = bytes.len() - 2;
        assert_eq!(bytes[pixels..], MARK);
        for without in [&bytes[..pixels], &bytes[..pixels + 1]] {
            let mended = mended(without, decode).expect("all pixels are there");
            assert_eq!(decode(&mended).expect("a picture"), picture);
        }
        let data = bytes.windows(2).rposition(|w| w == [0xff, 0xda]).expect("a scan") + 14;
        for length in (data..pixels - 1).rev().take(40).chain((data..pixels - 1).step_by(29)) {
            if let Some(mended) = mended(&bytes[..length], decode) {
                // The last bits may be padding.
                assert!(decode(&mended).expect("a picture") == picture, "{length} of {} bytes", bytes.len());
            }
        }
    }

    #[test]
    fn a_jpeg_without_its_end_is_whole_where_all_pixels_are_there() {
        let noise = |x: u32, y: u32, c: u32| ((x * 7 + y * 13 + c * 31).wrapping_mul(2_654_435_761) >> 24) as u8;
        let picture = RgbImage::from_fn(40, 24, |x, y| Rgb([0, 1, 2].map(|c| noise(x / 2, y / 3, c))));
        let mut bytes = Vec::new();
        JpegEncoder::new_with_quality(&mut bytes, 85).encode_image(&picture).expect("encoded");
        cut_everywhere(&bytes);
    }

    /// Made by other encoders: scans by bits and bands, restarts, one component.
    #[test]
    fn every_kind_of_jpeg_is_judged_by_its_pixels() {
        for bytes in [
            &include_bytes!("../../tests/dataset/pictures/progressive.jpg")[..],
            include_bytes!("../../tests/dataset/pictures/restarts.jpg"),
            include_bytes!("../../tests/dataset/pictures/grey.jpg"),
        ] {
            cut_everywhere(bytes);
        }
        let bytes = include_bytes!("../../tests/dataset/pictures/progressive.jpg");
        let scans: Vec<usize> = (0..bytes.len() - 1).filter(|at| bytes[*at..*at + 2] == [0xff, 0xda]).collect();
        assert!(scans.len() > 3, "{} scans", scans.len());
        for scan in scans {
            assert_eq!(mended(&bytes[..scan], decode), None, "a scan is missing at byte {scan}");
        }
    }
}
