//! JSON files whose complaints name the key and the line.

use std::fmt::Display;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

use crate::format::{At, Error};

/// The text of a file.
pub(super) struct Json {
    pub(super) file: PathBuf,
    text: String,
}

impl Json {
    pub(super) fn open(file: &Path) -> Result<Self, Error> {
        let bytes = std::fs::read(file).map_err(Error::io(file, "read"))?;
        match String::from_utf8(bytes) {
            Ok(text) => Ok(Self { file: file.to_owned(), text }),
            Err(e) => {
                let at = At::Byte(e.utf8_error().valid_up_to() as u64);
                Err(Error::malformed(file, "text", at, "is not UTF-8"))
            }
        }
    }

    pub(super) fn parse<T: DeserializeOwned>(&self) -> Result<T, Error> {
        serde_json::from_str(&self.text).map_err(|e| {
            let said = e.to_string();
            // The place is told apart.
            let problem = said.split(" at line ").next().unwrap_or(&said);
            let line = e.line().max(1) as u64;
            let field = match problem.split('`').nth(1) {
                Some(missing) if problem.starts_with("missing field") => missing.to_owned(),
                _ => self.key_before(e.line(), e.column()).unwrap_or_else(|| "JSON".to_owned()),
            };
            Error::malformed(&self.file, field, At::Line(line), problem)
        })
    }

    /// The key whose value the text is in at a line and a column, both counted from 1.
    fn key_before(&self, line: usize, column: usize) -> Option<String> {
        let start: usize = self.text.split_inclusive('\n').take(line.saturating_sub(1)).map(str::len).sum();
        let bytes = self.text.as_bytes().get(..(start + column).min(self.text.len()))?;
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

    /// Complains of a field of the entry in which a text stands in quotation marks.
    pub(super) fn error(&self, entry: &str, field: impl Display, problem: impl Display) -> Error {
        let quoted = serde_json::to_string(entry).unwrap_or_default();
        let at = self.text.find(&quoted).or_else(|| self.text.find(entry)).unwrap_or(0);
        let line = self.text.as_bytes()[..at].iter().filter(|b| **b == b'\n').count() as u64 + 1;
        Error::malformed(&self.file, field, At::Line(line), problem)
    }
}
