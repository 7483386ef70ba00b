//! Reads files field by field, so that every error names the field and its position.

use std::fmt::Display;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::error::{At, Error};
use super::text::{self, MARK};

/// Opens a file and returns its length. Refuses anything but a regular file before opening it: a pipe would block, and
/// has no length to check sizes against.
pub(crate) fn open(file: &Path) -> Result<(File, u64), Error> {
    let known = std::fs::metadata(file).map_err(Error::io(file, "open"))?;
    if !known.is_file() {
        return Err(Error::io(file, "open")(io::Error::new(io::ErrorKind::InvalidInput, "this is not a regular file")));
    }
    let opened = File::open(file).map_err(Error::io(file, "open"))?;
    let len = opened.metadata().map_err(Error::io(file, "read"))?.len();
    Ok((opened, len))
}

/// A little-endian binary file.
pub(crate) struct Source {
    file: PathBuf,
    reader: BufReader<File>,
    at: u64,
    len: u64,
}

impl Source {
    pub(crate) fn open(file: &Path) -> Result<Self, Error> {
        let (opened, len) = open(file)?;
        Ok(Self { file: file.to_owned(), reader: BufReader::with_capacity(1 << 16, opened), at: 0, len })
    }

    /// Byte offset in the file.
    pub(crate) fn at(&self) -> u64 {
        self.at
    }

    pub(crate) fn remaining(&self) -> u64 {
        self.len - self.at
    }

    pub(crate) fn error(&self, at: u64, field: impl Display, problem: impl Display) -> Error {
        Error::malformed(&self.file, field, At::Byte(at), problem)
    }

    fn need(&self, bytes: u64, field: impl Display) -> Result<(), Error> {
        if bytes <= self.remaining() {
            return Ok(());
        }
        Err(self.error(self.at, field, format_args!("needs {bytes} bytes, the file has {} more", self.remaining())))
    }

    fn fill(&mut self, out: &mut [u8]) -> Result<(), Error> {
        self.reader.read_exact(out).map_err(Error::io(&self.file, "read"))?;
        self.at += out.len() as u64;
        Ok(())
    }

    pub(crate) fn array<const N: usize>(&mut self, field: impl Display) -> Result<[u8; N], Error> {
        self.need(N as u64, field)?;
        let mut out = [0; N];
        self.fill(&mut out)?;
        Ok(out)
    }

    /// Reads `bytes` bytes. Allocates memory only if the file has them.
    pub(crate) fn bytes(&mut self, bytes: u64, field: impl Display) -> Result<Vec<u8>, Error> {
        self.need(bytes, &field)?;
        let size = usize::try_from(bytes).map_err(|_| self.error(self.at, &field, "is too large for this machine"))?;
        let mut out = vec![0; size];
        self.fill(&mut out)?;
        Ok(out)
    }

    pub(crate) fn u32(&mut self, field: impl Display) -> Result<u32, Error> {
        self.array(field).map(u32::from_le_bytes)
    }

    pub(crate) fn i32(&mut self, field: impl Display) -> Result<i32, Error> {
        self.array(field).map(i32::from_le_bytes)
    }

    pub(crate) fn u64(&mut self, field: impl Display) -> Result<u64, Error> {
        self.array(field).map(u64::from_le_bytes)
    }

    /// An f64, which may be infinite or NaN.
    pub(crate) fn f64(&mut self, field: impl Display) -> Result<f64, Error> {
        self.array(field).map(f64::from_le_bytes)
    }

    /// A u64 count of records of at least `record` bytes each.
    pub(crate) fn count(&mut self, record: u64, field: impl Display) -> Result<usize, Error> {
        let at = self.at;
        let count = self.u64(&field)?;
        let fits = count.checked_mul(record).is_some_and(|bytes| bytes <= self.remaining());
        match usize::try_from(count) {
            Ok(count) if fits => Ok(count),
            _ => Err(self.error(
                at,
                field,
                format_args!(
                    "is {count}, which needs at least {record} bytes each; the file has {} more",
                    self.remaining()
                ),
            )),
        }
    }

    /// Bytes up to a zero byte, which is dropped.
    pub(crate) fn word(&mut self, field: impl Display) -> Result<Vec<u8>, Error> {
        let at = self.at;
        let mut out = Vec::new();
        self.reader.read_until(0, &mut out).map_err(Error::io(&self.file, "read"))?;
        self.at += out.len() as u64;
        match out.pop() {
            Some(0) => Ok(out),
            _ => Err(self.error(at, field, "is not ended by a zero byte")),
        }
    }

    pub(crate) fn skip(&mut self, bytes: u64, field: impl Display) -> Result<(), Error> {
        self.need(bytes, &field)?;
        let step = i64::try_from(bytes).map_err(|_| self.error(self.at, field, "is too large"))?;
        self.reader.seek_relative(step).map_err(Error::io(&self.file, "read"))?;
        self.at += bytes;
        Ok(())
    }

    /// Fails if bytes are left.
    pub(crate) fn end(&self, field: impl Display) -> Result<(), Error> {
        match self.remaining() {
            0 => Ok(()),
            left => {
                Err(self.error(self.at, field, format_args!("{left} bytes follow that do not belong to the format")))
            }
        }
    }
}

/// A text file, read line by line.
pub(crate) struct Lines {
    file: PathBuf,
    reader: Box<dyn BufRead>,
    number: u64,
    raw: Vec<u8>,
}

impl Lines {
    pub(crate) fn open(file: &Path) -> Result<Self, Error> {
        let (opened, _) = open(file)?;
        let mut reader = BufReader::with_capacity(1 << 16, opened);
        let start = reader.fill_buf().map_err(Error::io(file, "read"))?;
        let (marked, wide) = (start.starts_with(MARK), text::units(start).is_some());
        if marked {
            reader.consume(MARK.len());
        }
        let reader: Box<dyn BufRead> = if wide { Box::new(Self::narrow(file, reader)?) } else { Box::new(reader) };
        Ok(Self { file: file.to_owned(), reader, number: 0, raw: Vec::new() })
    }

    /// The text of a file in UTF-16, as UTF-8.
    fn narrow(file: &Path, mut reader: BufReader<File>) -> Result<Cursor<String>, Error> {
        let mut bytes = Vec::new();
        reader.read_to_end(&mut bytes).map_err(Error::io(file, "read"))?;
        let text = text::decode(bytes).map_err(|at| {
            Error::malformed(file, "text", At::Byte(at as u64), "is not UTF-16, as the first bytes say")
        })?;
        Ok(Cursor::new(text))
    }

    /// The next line without its newline; `None` after the last.
    pub(crate) fn next(&mut self) -> Result<Option<Line<'_>>, Error> {
        if self.reader.fill_buf().map_err(Error::io(&self.file, "read"))?.is_empty() {
            return Ok(None);
        }
        self.raw.clear();
        self.reader.read_until(b'\n', &mut self.raw).map_err(Error::io(&self.file, "read"))?;
        self.number += 1;
        let text = std::str::from_utf8(&self.raw)
            .map_err(|_| Error::malformed(&self.file, "text", At::Line(self.number), "is not UTF-8"))?;
        let ended = text.ends_with('\n');
        let text = text.trim_end_matches(['\n', '\r']);
        Ok(Some(Line { file: &self.file, number: self.number, ended, text, rest: text }))
    }

    /// Whether the last line ended with a newline.
    pub(crate) fn ended(&self) -> bool {
        self.raw.last() == Some(&b'\n')
    }

    /// Position of the last line.
    pub(crate) fn at(&self) -> At {
        At::Line(self.number)
    }

    pub(crate) fn error(&self, field: impl Display, problem: impl Display) -> Error {
        Error::malformed(&self.file, field, At::Line(self.number), problem)
    }
}

/// A line and its remaining fields.
pub(crate) struct Line<'a> {
    file: &'a Path,
    number: u64,
    /// Whether the line ended with a newline. The last line of a truncated file has none.
    pub(crate) ended: bool,
    pub(crate) text: &'a str,
    rest: &'a str,
}

impl<'a> Line<'a> {
    pub(crate) fn error(&self, field: impl Display, problem: impl Display) -> Error {
        Error::malformed(self.file, field, At::Line(self.number), problem)
    }

    pub(crate) fn word(&mut self, field: impl Display) -> Result<&'a str, Error> {
        let rest = self.rest.trim_start();
        let (word, after) = rest.split_at(rest.find(char::is_whitespace).unwrap_or(rest.len()));
        self.rest = after;
        if word.is_empty() { Err(self.error(field, "is missing")) } else { Ok(word) }
    }

    /// A number, which may be infinite or NaN.
    pub(crate) fn f64(&mut self, field: impl Display) -> Result<f64, Error> {
        let word = self.word(&field)?;
        word.parse().map_err(|_| self.error(field, format_args!("'{word}' is not a number")))
    }

    /// A finite number.
    pub(crate) fn finite(&mut self, field: impl Display) -> Result<f64, Error> {
        let value = self.f64(&field)?;
        if value.is_finite() { Ok(value) } else { Err(self.error(field, format_args!("is {value}"))) }
    }

    /// A whole number, also in floating-point notation.
    pub(crate) fn whole<T: FromStr + TryFrom<u64>>(&mut self, field: impl Display) -> Result<T, Error> {
        let word = self.word(&field)?;
        whole(word).ok_or_else(|| self.error(field, format_args!("'{word}' is not a number of the kind it should be")))
    }

    pub(crate) fn at(&self) -> At {
        At::Line(self.number)
    }

    /// The line after its first `words` words.
    pub(crate) fn beyond(&self, words: usize) -> &'a str {
        let after = |rest: &'a str, _| rest.find(char::is_whitespace).map_or("", |end| rest[end..].trim_start());
        (0..words).fold(self.text.trim(), after)
    }

    /// The remaining text without surrounding white space.
    pub(crate) fn rest(&self) -> &'a str {
        self.rest.trim()
    }

    /// Whether no field is left. ([`Line::left`] scans the rest of the line.)
    pub(crate) fn is_done(&self) -> bool {
        self.rest.trim_start().is_empty()
    }

    /// Removes the text after a `#`. For lines whose fields cannot contain a `#`.
    pub(crate) fn without_comment(mut self) -> Self {
        let end = self.text.find('#').unwrap_or(self.text.len());
        (self.text, self.rest) = (&self.text[..end], &self.text[..end]);
        self
    }

    /// Number of remaining fields.
    pub(crate) fn left(&self) -> usize {
        self.rest.split_whitespace().count()
    }
}

/// An f64 represents every smaller whole number exactly.
const WHOLE: f64 = 9_007_199_254_740_992.0;

/// A whole number in any notation: 640, or 640.0 and 6.4e2 of programs that write floating-point numbers.
pub(crate) fn whole<T: FromStr + TryFrom<u64>>(word: &str) -> Option<T> {
    if let Ok(value) = word.parse() {
        return Some(value);
    }
    let value: f64 = word.parse().ok()?;
    let exact = value.fract() == 0.0 && (0.0..=WHOLE).contains(&value);
    if exact { T::try_from(value as u64).ok() } else { None }
}

#[cfg(test)]
mod tests {
    use super::whole;

    #[test]
    fn whole_numbers_may_be_written_as_floating_point_ones() {
        for word in ["640", "640.0", "640.", "6.4e2", "+640", "6.40E+02"] {
            assert_eq!(whole::<u32>(word), Some(640), "{word}");
        }
        for word in ["640.5", "-1", "-640.0", "nan", "inf", "1e30", "", "6 40", "4294967296.0"] {
            assert_eq!(whole::<u32>(word), None, "{word}");
        }
        assert_eq!((whole::<u8>("255.0"), whole::<u8>("256")), (Some(255), None));
        assert_eq!(whole::<u64>("18446744073709551615"), Some(u64::MAX));
    }
}
