//! Text files of all systems: a byte order mark may precede the text and may declare UTF-16.

use std::io;
use std::path::Path;

/// The byte order mark of UTF-8.
pub(crate) const MARK: &[u8] = b"\xef\xbb\xbf";

/// The text of a file in UTF-8, or in UTF-16 with a byte order mark. The mark is dropped.
pub fn read_text(file: &Path) -> io::Result<String> {
    decode(std::fs::read(file)?).map_err(|_| io::Error::new(io::ErrorKind::InvalidData, "the file is not UTF-8 text"))
}

/// Decodes bytes as text. The error is the number of valid bytes.
pub(crate) fn decode(mut bytes: Vec<u8>) -> Result<String, usize> {
    if let Some(from_bytes) = units(&bytes) {
        return utf16(&bytes[2..], from_bytes).map_err(|at| at + 2);
    }
    let mark = if bytes.starts_with(MARK) { MARK.len() } else { 0 };
    bytes.drain(..mark);
    String::from_utf8(bytes).map_err(|error| error.utf8_error().valid_up_to() + mark)
}

/// Reads a UTF-16 unit in the byte order of the mark; `None` without a UTF-16 mark.
pub(crate) fn units(bytes: &[u8]) -> Option<fn([u8; 2]) -> u16> {
    match bytes {
        [0xff, 0xfe, ..] => Some(u16::from_le_bytes),
        [0xfe, 0xff, ..] => Some(u16::from_be_bytes),
        _ => None,
    }
}

fn utf16(bytes: &[u8], from_bytes: fn([u8; 2]) -> u16) -> Result<String, usize> {
    let pairs = bytes.chunks_exact(2);
    let rest = pairs.remainder().len();
    let mut text = String::with_capacity(bytes.len() / 2);
    let mut at = 0;
    for unit in char::decode_utf16(pairs.map(|pair| from_bytes([pair[0], pair[1]]))) {
        let letter = unit.map_err(|_| at)?;
        text.push(letter);
        at += 2 * letter.len_utf16();
    }
    if rest == 0 { Ok(text) } else { Err(at) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn byte_order_marks_are_left_out_and_say_the_encoding() {
        let text = "{\"name\": \"\u{e9}\u{1f600}\"}\r\n";
        let utf16 = |mark: &[u8], bytes: fn(u16) -> [u8; 2]| {
            mark.iter().copied().chain(text.encode_utf16().flat_map(bytes)).collect::<Vec<u8>>()
        };
        for bytes in [
            text.as_bytes().to_vec(),
            [MARK, text.as_bytes()].concat(),
            utf16(b"\xff\xfe", u16::to_le_bytes),
            utf16(b"\xfe\xff", u16::to_be_bytes),
        ] {
            assert_eq!(decode(bytes).as_deref(), Ok(text));
        }
        assert_eq!(decode(b"\xef\xbb\xbfab\xff".to_vec()), Err(5));
        assert_eq!(decode(b"\xff\xfea\0\0\xd8b\0".to_vec()), Err(4));
        assert_eq!(decode(b"\xff\xfea\0b".to_vec()), Err(4));
    }
}
