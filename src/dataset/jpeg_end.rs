//! Whether a JPEG file is whole: decoders fill what is missing of a truncated photograph with grey and say nothing.

/// Walks the markers of a JPEG file (ITU-T T.81, annex B) to the end of the image. What follows it, as some cameras append
/// data of their own, does not matter. False only for what begins as a JPEG file and lacks its end.
pub(super) fn is_whole(bytes: &[u8]) -> bool {
    if !bytes.starts_with(&[0xff, 0xd8]) {
        return true;
    }
    let mut at = 2;
    loop {
        // The next marker: 0xff and neither a stuffed zero, nor filling, nor a restart inside the entropy-coded data.
        let Some(found) = bytes[at.min(bytes.len())..]
            .windows(2)
            .position(|w| w[0] == 0xff && !matches!(w[1], 0x00 | 0xff | 0xd0..=0xd7))
        else {
            return false;
        };
        at += found + 2;
        match bytes[at - 1] {
            0xd9 => return true,
            // Without parameters.
            0x01 | 0xd8 => {}
            _ => match bytes.get(at..at + 2) {
                Some(length) => at += usize::from(u16::from_be_bytes([length[0], length[1]])),
                None => return false,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::is_whole;

    #[test]
    fn ends_inside_segments_do_not_count_and_trailers_do_no_harm() {
        // A thumbnail's end inside an application segment, a scan with a stuffed byte and a restart, the end.
        let head = [0xff, 0xd8, 0xff, 0xe1, 0, 6, 0xff, 0xd9, 1, 2];
        let scan = [0xff, 0xda, 0, 3, 9, 77, 0xff, 0x00, 0xff, 0xd3, 5];
        let whole = [&head[..], &scan, &[0xff, 0xff, 0xd9]].concat();
        assert!(is_whole(&whole));
        assert!(is_whole(&[&whole[..], b"trailer"].concat()));
        for length in 2..whole.len() {
            assert!(!is_whole(&whole[..length]), "{length} bytes");
        }
        assert!(is_whole(b"\x89PNG"), "another format is not judged");
    }
}
