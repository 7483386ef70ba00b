//! The header of a PLY file.

use std::io::BufRead;
use std::path::Path;

use crate::format::source::whole;
use crate::format::{At, Error, MARK, foreign};

/// Most bytes of a header.
const MAX_HEADER: u64 = 1 << 20;
const MAX_LINE: u64 = 1 << 12;
/// Most properties of an element: each new one is compared with all earlier ones.
const MAX_PROPERTIES: usize = 1 << 10;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// The type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Kind {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    pub(super) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The number in the first [`Kind::bytes`] bytes, in little endian.
    pub(super) fn decode(self, bytes: [u8; 8]) -> f64 {
        let [a, b, c, d, ..] = bytes;
        match self {
            Self::I8 => f64::from(a as i8),
            Self::U8 => f64::from(a),
            Self::I16 => f64::from(i16::from_le_bytes([a, b])),
            Self::U16 => f64::from(u16::from_le_bytes([a, b])),
            Self::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Self::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Self::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Self::F64 => f64::from_le_bytes(bytes),
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: Kind,
    /// Type of the count if the property is a list.
    pub(super) count: Option<Kind>,
}

#[derive(Clone, Debug)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    /// Position of the count, for errors.
    pub(super) at: u64,
    pub(super) properties: Vec<Property>,
    /// Whether a property is a list, so that rows have no fixed size.
    pub(super) has_list: bool,
}

impl Element {
    pub(super) fn row_bytes(&self) -> usize {
        self.properties.iter().map(|p| p.kind.bytes()).sum()
    }
}

#[derive(Clone, Debug)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    /// Comments with the byte offsets of their lines.
    pub(super) comments: Vec<(u64, String)>,
    pub(super) elements: Vec<Element>,
    /// Bytes of the header; the data follows.
    pub(super) bytes: u64,
    /// Number of lines of the header.
    pub(super) lines: u64,
}

/// Reads a header up to its line `end_header`. `bytes` is the file's length.
pub(super) fn read(file: &Path, bytes: u64, reader: &mut impl BufRead) -> Result<Header, Error> {
    let mut header =
        Header { encoding: Encoding::Ascii, comments: Vec::new(), elements: Vec::new(), bytes: 0, lines: 0 };
    let mut format_seen = false;
    // Editors may put a byte order mark before a text.
    if reader.fill_buf().map_err(Error::io(file, "read"))?.starts_with(MARK) {
        reader.consume(MARK.len());
        header.bytes = MARK.len() as u64;
    }
    let begin = reader.fill_buf().map_err(Error::io(file, "read"))?;
    if !begin.starts_with(b"ply") {
        return Err(Error::malformed(file, "magic", At::Byte(0), no_ply(file, bytes, begin)));
    }
    loop {
        let at = header.bytes;
        let fail = |field: &str, problem: String| Error::malformed(file, field, At::Byte(at), problem);
        let line = next_line(file, reader, at)?;
        header.bytes += line.len() as u64;
        header.lines += 1;
        let line = line.trim_end_matches(['\n', '\r']);
        let words: Vec<&str> = line.split_whitespace().collect();
        if header.lines == 1 {
            if words != ["ply"] {
                return Err(fail("magic", "a PLY file begins with a line 'ply'".to_owned()));
            }
            continue;
        }
        match words.as_slice() {
            ["format", encoding, "1.0"] => {
                format_seen = true;
                header.encoding = match *encoding {
                    "ascii" => Encoding::Ascii,
                    "binary_little_endian" => Encoding::LittleEndian,
                    "binary_big_endian" => Encoding::BigEndian,
                    other => return Err(fail("format", format!("'{other}' is unknown"))),
                };
            }
            ["comment", ..] => header.comments.push((at, words[1..].join(" "))),
            ["obj_info", ..] | [] => {}
            ["element", name, count] => {
                let count = whole(count).ok_or_else(|| fail("element", format!("'{count}' is not a count")))?;
                let name = (*name).to_owned();
                header.elements.push(Element { name, count, at, properties: Vec::new(), has_list: false });
            }
            ["property", rest @ ..] => {
                let Some(element) = header.elements.last_mut() else {
                    return Err(fail("property", "stands before any element".to_owned()));
                };
                let (count, kind, name) = match rest {
                    ["list", count, kind, name] => (Some(count), kind, name),
                    [kind, name] => (None, kind, name),
                    _ => return Err(fail("property", format!("'{line}' is not one"))),
                };
                let known = |word: &str| {
                    Kind::named(word)
                        .ok_or_else(|| fail("property", format!("the type '{word}' of '{name}' is unknown")))
                };
                let (count, kind) = (count.map(|word| known(word)).transpose()?, known(kind)?);
                if element.properties.iter().any(|p| p.name == *name) {
                    return Err(fail("property", format!("'{name}' occurs twice")));
                }
                if element.properties.len() == MAX_PROPERTIES {
                    return Err(fail("property", format!("'{}' has more than {MAX_PROPERTIES}", element.name)));
                }
                element.has_list |= count.is_some();
                element.properties.push(Property { name: (*name).to_owned(), kind, count });
            }
            ["end_header"] if format_seen => return Ok(header),
            ["end_header"] => return Err(fail("header", "it names no format".to_owned())),
            _ => return Err(fail("header", format!("'{line}' is not understood"))),
        }
        if header.bytes > MAX_HEADER {
            return Err(fail("header", format!("it has no end in the first {MAX_HEADER} bytes")));
        }
    }
}

/// Why a file does not begin like a PLY file.
fn no_ply(file: &Path, bytes: u64, begin: &[u8]) -> String {
    let begin = &begin[..begin.len().min(foreign::LOOKED_AT)];
    let known = foreign::described(file, bytes, begin);
    known.unwrap_or_else(|| "a PLY file begins with a line 'ply'".to_owned())
}

fn next_line(file: &Path, reader: &mut impl BufRead, at: u64) -> Result<String, Error> {
    let mut raw = Vec::new();
    std::io::Read::take(&mut *reader, MAX_LINE).read_until(b'\n', &mut raw).map_err(Error::io(file, "read"))?;
    if raw.last() != Some(&b'\n') {
        let problem = if raw.len() as u64 == MAX_LINE { "the line is too long" } else { "the file ends in the header" };
        return Err(Error::malformed(file, "header", At::Byte(at), problem));
    }
    String::from_utf8(raw).map_err(|_| Error::malformed(file, "header", At::Byte(at), "is not text"))
}
