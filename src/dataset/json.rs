//! JSON files. Errors name the key and the line.

use std::fmt::{self, Display};
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde::de::{MapAccess, Visitor};
use serde_json::value::RawValue;

use crate::format::{At, Error, decode};

/// The text of a JSON file.
pub(super) struct Json {
    pub(super) file: PathBuf,
    text: String,
}

impl Json {
    pub(super) fn open(file: &Path) -> Result<Self, Error> {
        let bytes = std::fs::read(file).map_err(Error::io(file, "read"))?;
        match decode(bytes) {
            Ok(text) => Ok(Self { file: file.to_owned(), text: quote_no_numbers(text) }),
            Err(at) => Err(Error::malformed(file, "text", At::Byte(at as u64), "is not UTF-8")),
        }
    }

    /// Parses the whole text.
    pub(super) fn parse<'a, T: Deserialize<'a>>(&'a self) -> Result<T, Error> {
        self.parse_part(&self.text)
    }

    /// Parses a part of the text.
    pub(super) fn parse_part<'a, T: Deserialize<'a>>(&'a self, part: &'a str) -> Result<T, Error> {
        serde_json::from_str(part).map_err(|e| {
            let said = e.to_string();
            // The line is added separately.
            let problem = said.split(" at line ").next().unwrap_or(&said);
            let before: usize = part.split_inclusive('\n').take(e.line().saturating_sub(1)).map(str::len).sum();
            let end = self.place(part) + (before + e.column()).min(part.len());
            let field = match problem.split('`').nth(1) {
                Some(missing) if problem.starts_with("missing field") => missing.to_owned(),
                _ => self.key_before(end).unwrap_or_else(|| "JSON".to_owned()),
            };
            let lines = self.lines_before(self.place(part));
            Error::malformed(&self.file, field, At::Line(lines + e.line().max(1) as u64), problem)
        })
    }

    /// Byte offset of a part of the text.
    fn place(&self, part: &str) -> usize {
        (part.as_ptr() as usize).saturating_sub(self.text.as_ptr() as usize).min(self.text.len())
    }

    fn lines_before(&self, at: usize) -> u64 {
        self.text.as_bytes()[..at].iter().filter(|b| **b == b'\n').count() as u64
    }

    /// The key whose value contains the byte before `end`.
    fn key_before(&self, end: usize) -> Option<String> {
        let bytes = self.text.as_bytes().get(..end)?;
        let mut end = bytes.len();
        loop {
            let colon = bytes[..end].iter().rposition(|b| *b == b':')?;
            let before = bytes[..colon].trim_ascii_end();
            if let Some(name) = before.strip_suffix(b"\"") {
                let open = name.iter().rposition(|b| *b == b'"')?;
                return Some(String::from_utf8_lossy(&name[open + 1..]).into_owned());
            }
            end = colon;
        }
    }

    /// An error about a field of an entry, which the text names in quotation marks.
    pub(super) fn error(&self, entry: &str, field: impl Display, problem: impl Display) -> Error {
        let quoted = serde_json::to_string(entry).unwrap_or_default();
        let at = self.text.find(&quoted).or_else(|| self.text.find(entry)).unwrap_or(0);
        Error::malformed(&self.file, field, At::Line(self.lines_before(at) + 1), problem)
    }
}

/// Values by name in the order of the file, repeated names included.
#[derive(Default)]
pub(super) struct Entries<'a>(pub(super) Vec<(String, &'a RawValue)>);

impl<'de: 'a, 'a> Deserialize<'de> for Entries<'a> {
    fn deserialize<D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        struct Each;
        impl<'de> Visitor<'de> for Each {
            type Value = Entries<'de>;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a map")
            }
            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
                let mut all = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    all.push(entry);
                }
                Ok(Entries(all))
            }
        }
        from.deserialize_map(Each)
    }
}

/// Puts NaN and Infinity, which JSON does not have but programs write, into quotation marks. A quoted word is an error
/// only where it stands for a needed number; the rest of the file can be read.
fn quote_no_numbers(text: String) -> String {
    let may = |letter: u8| matches!(letter, b'N' | b'n' | b'I' | b'i');
    let (bytes, mut out) = (text.as_bytes(), String::new());
    let (mut quoted, mut copied, mut at) = (false, 0, 0);
    while at < bytes.len() {
        match bytes[at] {
            b'\\' if quoted => at += 1,
            b'"' => quoted = !quoted,
            letter if !quoted && (letter == b'-' || may(letter)) => {
                let end = at + 1 + bytes[at + 1..].iter().take_while(|b| b.is_ascii_alphabetic()).count();
                let word = &text[at..end];
                if ["nan", "inf", "infinity"].contains(&word.trim_start_matches('-').to_ascii_lowercase().as_str()) {
                    out.push_str(&text[copied..at]);
                    out.push_str(&format!("\"{word}\""));
                    copied = end;
                }
                at = end - 1;
            }
            _ => {}
        }
        at += 1;
    }
    if copied == 0 {
        return text;
    }
    out.push_str(&text[copied..]);
    out
}

#[cfg(test)]
mod tests {
    use super::quote_no_numbers;

    #[test]
    fn numbers_that_are_none_are_put_in_quotation_marks() {
        for (text, want) in [
            (r#"{"a": NaN, "b": [-Infinity,inf,-nan]}"#, r#"{"a": "NaN", "b": ["-Infinity","inf","-nan"]}"#),
            (r#"{"NaN \" NaN": null, "n": [1e-5, -2, true]}"#, r#"{"NaN \" NaN": null, "n": [1e-5, -2, true]}"#),
            ("NaN", "\"NaN\""),
            ("\"\\", "\"\\"),
            ("-", "-"),
        ] {
            assert_eq!(quote_no_numbers(text.to_owned()), want);
        }
    }
}
